"""One symbol for each kind of element: found by its class, as methods are.

A new kind of element brings one function here; one of a user's own may bring a
method ``glyph(pen)`` instead, or register a function with :data:`mbdcasadi.glyph`, which is :func:`symbol`.
"""

from __future__ import annotations

from functools import singledispatch
from itertools import pairwise
from typing import Any

import casadi as ca

from ..drawing.pen import Pen


@singledispatch
def symbol(element: Any, pen: Pen) -> None:
    """Draw the symbol of an element: by its own ``glyph(pen)``, else lines between its markers.

    Parameters
    ----------
    element : Element
        A joint, driver or force.
    pen : Pen
        What to draw with.

    Examples
    --------
    A symbol for a class of one's own::

        @mbd.glyph.register
        def _(element: MyJoint, pen):
            pen.pin(pen.on(element.a))
    """
    glyph = getattr(element, "glyph", None)
    if glyph is not None:
        glyph(pen)
        return
    markers = list(getattr(element, "markers", ()))
    places = [marker.position for marker in markers]
    if not places:
        # what is given by expressions alone is tied between the bodies that it connects
        places = [body.position for body in element.bodies if not body.is_ground]
    if len(places) > 1:
        for first, second in pairwise(places):
            tie(pen, first, second)
    for marker in markers:
        pen.dot(pen.on(marker))


def tie(pen: Pen, first: Any, second: Any) -> None:
    """A dashed line between two points."""
    if not ca.is_equal(ca.SX(first), ca.SX(second), 8):
        pen.between(first, second).draw("tie", [[0, 0, 0, 0], [0, 1, 0, 0]])


def nothing(element: Any, pen: Pen) -> None:
    """For what has no place: weight, controllers, friction in a joint that is drawn itself."""
