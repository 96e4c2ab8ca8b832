"""Checks of problems before they are solved, of solutions, and of failures."""
