"""Participating media: the fog itself."""
