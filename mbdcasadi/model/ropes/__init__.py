"""Ropes and cables over pulleys."""
