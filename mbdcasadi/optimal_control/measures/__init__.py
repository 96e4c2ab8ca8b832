"""Errors of a solved motion, by which its mesh is refined."""
