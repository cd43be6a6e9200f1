"""A shape and a medium that the pipeline knows by its entry points alone."""
