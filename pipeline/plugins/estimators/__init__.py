"""Estimators: light strengths and sun direction from the photograph."""
