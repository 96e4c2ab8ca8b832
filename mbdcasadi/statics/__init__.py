"""Equilibria: states at rest, their stability, and paths of them along a parameter."""
