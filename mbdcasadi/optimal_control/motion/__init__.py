"""A solved program as a motion: guesses, limits along it, verification, files."""
