"""Linear models of small motions, their modes and transfer functions."""
