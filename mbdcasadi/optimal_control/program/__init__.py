"""The nonlinear program of a problem: unknowns, rows, limits, scales."""
