"""Table of glyphs: symbol, loads and tooltip of each class of elements, looked up as methods are."""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from itertools import pairwise
from typing import Any, ClassVar

import casadi as ca

from ...results.columns import reaction_body
from ..drawing.loads import Load
from ..drawing.pen import Pen


@singledispatch
def glyph(element: Any, pen: Pen) -> None:
    """Draw the symbol of an element.

    ``glyph.register`` takes a function that draws the elements of a class instead; a class
    of elements may also have a method ``glyph(pen)``. What neither knows is
    drawn as dashed lines between its markers. To show loads and tooltips too,
    derive from :class:`Glyph`.

    Parameters
    ----------
    element : Element
        A joint, driver or force.
    pen : Pen
        Pen to draw with.

    Examples
    --------
    A symbol for a user's own class::

        @mbd.glyph.register
        def _(element: MyJoint, pen):
            pen.pin(pen.on(element.a))
    """
    Glyph(element, pen).draw()


class Glyph:
    """One element as a drawing shows it: its symbol, the loads that it exerts, and its tooltip.

    A subclass that names a class of elements, ``class Spring(Glyph, of=TSDA)``,
    is used for these elements and for those of derived classes.

    Parameters
    ----------
    element : Body or Element
        The element.
    pen : Pen
        Pen to draw with.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> class Magnet(mbd.TSDA):
    ...     pass
    >>> class MagnetGlyph(mbd.Glyph, of=Magnet):
    ...     def draw(self):
    ...         for marker in self.element.markers:
    ...             self.pen.dot(self.pen.on(marker))
    ...
    ...     def tooltip(self):
    ...         return {"gap, m": self.element.length}
    """

    #: attributes of the element that its tooltip shows, by label with the unit after a comma; none: the reaction
    readings: ClassVar[Mapping[str, str]] = {}

    def __init__(self, element: Any, pen: Pen):
        self.element, self.pen = element, pen

    def __init_subclass__(cls, *, of: type | tuple[type, ...] = (), **more: Any):
        super().__init_subclass__(**more)
        for kind in of if isinstance(of, tuple) else (of,):
            glyph.register(kind, cls._drawn)

    @classmethod
    def _drawn(cls, element: Any, pen: Pen) -> None:
        cls(element, pen).draw()

    def draw(self) -> None:
        """Draw the symbol: by the element's own ``glyph(pen)``, else lines between its markers."""
        element, pen = self.element, self.pen
        method = getattr(element, "glyph", None)
        if method is not None:
            method(pen)
            return
        markers = list(getattr(element, "markers", ()))
        places = [marker.position for marker in markers]
        if not places:
            # an element of expressions alone is tied between the bodies that it connects
            places = [body.position for body in element.bodies if not body.is_ground]
        for first, second in pairwise(places):
            tie(pen, first, second)
        for marker in markers:
            pen.dot(pen.on(marker))

    def loads(self) -> list[Load]:
        """Return forces and couples that the element exerts: of a joint, those on the second of its bodies."""
        reaction = self._reaction()
        if reaction is None:
            return []
        place = reaction.marker
        return [Load(place, reaction.force, "reaction"), Load(place, ca.SX(reaction.torque), "reaction")]

    def tooltip(self) -> dict[str, ca.SX]:
        """Return scalars by label: :attr:`readings`, or of a joint its reaction, if multipliers are known."""
        if self.readings:
            return {label: ca.SX(getattr(self.element, name)) for label, name in self.readings.items()}
        reaction = self._reaction()
        if reaction is None:
            return {}
        body = reaction_body(self.element)
        return {
            f"force on {body.name}, x, N": reaction.force[0],  # type: ignore[union-attr]
            f"force on {body.name}, y, N": reaction.force[1],  # type: ignore[union-attr]
            f"couple on {body.name}, N m": ca.SX(reaction.torque),  # type: ignore[union-attr]
        }

    def _reaction(self) -> Any:
        """Reaction on the body on which it is reported; None if the element has none, or it is not known."""
        if not hasattr(self.element, "reaction_on") or not self.pen.sample.has_multipliers:
            return None
        body = reaction_body(self.element)
        return None if body is None else self.element.reaction_on(body)


# until a class has a glyph of its own, that of all objects
glyph.register(object, Glyph._drawn)


def glyph_of(element: Any, pen: Pen) -> Glyph:
    """Return the loads and the tooltip of an element, by its next base class that has a :class:`Glyph`.

    It may have a symbol that is drawn by a registered function; :func:`glyph` draws it.
    """
    entries = (getattr(glyph.registry.get(kind), "__self__", None) for kind in type(element).__mro__)
    return next(entry for entry in entries if isinstance(entry, type))(element, pen)


class Hidden(Glyph):
    """Glyph of elements without a place: weight, controllers, friction in a joint that is drawn itself."""

    def draw(self) -> None:
        """Draw nothing."""


def tie(pen: Pen, first: Any, second: Any) -> None:
    """Draw a dashed line between two points."""
    if not ca.is_equal(ca.SX(first), ca.SX(second), 8):
        pen.between(first, second).draw("tie", [[0, 0, 0, 0], [0, 1, 0, 0]])
