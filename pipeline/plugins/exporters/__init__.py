"""Exporters: the placed scene in a renderer's language."""
