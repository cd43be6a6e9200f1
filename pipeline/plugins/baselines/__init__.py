"""Fog as others put it into a photograph, one file each."""
