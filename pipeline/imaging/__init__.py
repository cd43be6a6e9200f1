"""Photographs, maps and panoramas: the only modules that read and write image files."""
