"""Solvers of the nonlinear program, one a file."""
