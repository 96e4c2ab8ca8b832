"""Random motions of mechanisms with an input for each coordinate."""
