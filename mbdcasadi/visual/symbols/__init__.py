"""Symbols of elements, as in textbooks: one function for each kind, found by :func:`symbol`."""

from . import cams, constraints, contacts, forces, gears, lower_pairs, stops  # each registers its symbols
from .base import symbol

__all__ = ["cams", "constraints", "contacts", "forces", "gears", "lower_pairs", "stops", "symbol"]
