"""User study of Zhao et al. 2013, section 6.3: its stimuli, its page, and what people answered."""
