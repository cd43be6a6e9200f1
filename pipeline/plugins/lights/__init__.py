"""Sources of light."""
