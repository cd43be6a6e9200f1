"""Physically based fog for a single photograph: C = R * T + V in linear light."""

__version__ = "0.1.0"
