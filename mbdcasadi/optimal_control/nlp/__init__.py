"""The nonlinear program of a problem: rows, limits, scales, and its solver."""
