"""Starts in singular poses, and the passage through them."""
