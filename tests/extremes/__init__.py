"""Scenes at the ends of what may be asked for, run through the public command line."""
