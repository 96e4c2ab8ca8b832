"""Friction: its laws, and friction in joints."""
