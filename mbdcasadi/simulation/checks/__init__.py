"""Checks of a run: whether its steps resolved what happened, and why an integrator stopped."""
