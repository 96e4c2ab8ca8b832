"""Plots of motions, equilibria, modes, identifications and optimal solutions."""
