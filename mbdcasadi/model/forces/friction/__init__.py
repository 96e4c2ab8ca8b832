"""Friction: laws, and where they act."""
