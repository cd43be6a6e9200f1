"""The page of `make annotate` and its server."""
