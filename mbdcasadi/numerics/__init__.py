"""Numerical methods that know nothing of mechanics: Newton's method, least squares, homotopy, rank."""
