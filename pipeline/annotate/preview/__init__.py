"""A scene that is being annotated, as it looks: lines over the photograph, what is wrong, and a draft of its fog."""
