"""Solid things: what fog ends at and what throws shadows."""
