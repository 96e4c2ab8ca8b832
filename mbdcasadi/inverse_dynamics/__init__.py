"""Inverse dynamics: reactions and efforts of a motion that is prescribed."""
