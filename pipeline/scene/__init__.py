"""The scene file: its model, reading it with line numbers, overriding its values."""
