"""How elements are shown: one :class:`Glyph` for each class of elements, found by :func:`glyph`."""

from . import bodies, cams, contacts, coordinates, forces, gears, lower_pairs, motions, springs, stops  # these register
from .base import Glyph, glyph, glyph_of

__all__ = [
    "Glyph", "bodies", "cams", "contacts", "coordinates", "forces", "gears", "glyph", "glyph_of", "lower_pairs",
    "motions", "springs", "stops",
]  # fmt: skip
