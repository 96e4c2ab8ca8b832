"""Symbols of elements: one :class:`Glyph` or function for each class of elements, in the table :func:`glyph`."""

from . import (  # these register
    bodies,
    cams,
    contacts,
    coordinates,
    forces,
    gears,
    lower_pairs,
    motions,
    ropes,
    springs,
    stops,
)
from .base import Glyph, glyph, glyph_of

__all__ = [
    "Glyph", "bodies", "cams", "contacts", "coordinates", "forces", "gears", "glyph", "glyph_of", "lower_pairs",
    "motions", "ropes", "springs", "stops",
]  # fmt: skip
