"""From the placed scene to `.pov` files, and from those to float images."""
