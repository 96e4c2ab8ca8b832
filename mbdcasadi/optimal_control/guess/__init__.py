"""Initial guesses: key poses, motions between them, and several starts."""
