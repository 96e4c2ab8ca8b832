"""Drawings: mechanisms as scenes, and scenes in Matplotlib."""
