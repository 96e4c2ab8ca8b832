"""Steppers: what advances the state of a run over a piece, by an integrator or by code of its own."""
