"""Steppers, which advance the state of a run over a piece, by an integrator or by code of their own."""
