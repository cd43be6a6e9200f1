"""Phase functions: how fog scatters light over the sphere."""
