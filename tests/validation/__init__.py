"""Fig. 8, 9 and 10 of Zhao et al. 2013 as experiments: `make validation`."""
