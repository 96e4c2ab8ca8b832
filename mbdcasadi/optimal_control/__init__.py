"""Optimal control of mechanisms by direct collocation on the equations that are simulated."""
