"""A whole simulation as one ``casadi.Function``: differentiable, and fit to travel to other processes."""
