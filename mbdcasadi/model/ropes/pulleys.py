"""Pulleys over which ropes run, and drums on which they wind up."""

from __future__ import annotations

from typing import Any

from ...errors import ModelError
from ..bodies import Marker, as_marker
from ..forces.friction.laws import as_law
from ..immutable import Immutable
from ..quantities import HasQuantities, one_of, whole, yes_or_no
from ..symbols import Scalar

#: Sense in which a rope turns round a pulley, positive counter-clockwise.
TURNS = {"counter-clockwise": 1, "clockwise": -1}


class Pulley(Immutable, HasQuantities):
    """A round pulley or post that a rope runs over.

    Parameters
    ----------
    marker : Marker
        Its centre, on the body that turns with it.
    radius : float or expression in parameters
        Radius to the middle of the rope, m.
    turn : {"clockwise", "counter-clockwise"}
        Sense in which the rope turns round it, on its way from the first end to the last.
    grips : bool, default False
        True if the rope does not slip on it: the rope then turns the body. Else it runs over it freely.
    friction : FrictionLaw, optional
        Law by which the rope rubs on it; ``DryFriction`` sticks and slips exactly. Only a :class:`Cable` rubs.
    turns : int, default 0
        Whole turns of the rope in addition to the turn from strand to strand, which counts from a quarter turn back
        to three quarters ahead.

    Raises
    ------
    ModelError
        For a radius that is not positive, an unknown sense, and a pulley that grips and rubs.

    See Also
    --------
    Cable, Rope : what runs over it.
    Drum : an end that winds up.
    """

    def __init__(
        self,
        marker: Marker,
        radius: Scalar,
        turn: str,
        grips: bool = False,
        friction: Any = None,
        turns: int = 0,
    ):
        self.marker = as_marker(marker, "Pulley", "marker")
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        self.turn = one_of(turn, TURNS, "Pulley", "turn")
        self.grips = yes_or_no(grips, "Pulley", "grips")
        self.turns = whole(turns, "Pulley", "turns", 0)
        self.friction = None if friction is None else as_law(friction, "Pulley")
        if self.grips and friction is not None:
            raise ModelError("Pulley: a rope that grips does not rub; give grips=True or friction=, not both")

    @property
    def description(self) -> str:
        """Kind and body, as messages give it."""
        return f"pulley on '{self.marker.body.name}'" if hasattr(self, "marker") else "Pulley"

    @property
    def sense(self) -> int:
        """Positive counter-clockwise."""
        return TURNS[self.turn]

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.marker!r}, {self.radius}, {self.turn!r})"


class Drum(Immutable, HasQuantities):
    """A drum on which an end of a rope is fixed and winds up, over any number of turns.

    Parameters
    ----------
    marker : Marker
        Its centre, on the body that turns with it.
    radius : float or expression in parameters
        Radius to the middle of the rope, m.
    turn : {"clockwise", "counter-clockwise"}
        Sense in which the rope turns round it, on its way from the first end to the last.
    """

    def __init__(self, marker: Marker, radius: Scalar, turn: str):
        self.marker = as_marker(marker, "Drum", "marker")
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        self.turn = one_of(turn, TURNS, "Drum", "turn")

    @property
    def sense(self) -> int:
        """Positive counter-clockwise."""
        return TURNS[self.turn]

    def __repr__(self) -> str:
        return f"Drum({self.marker!r}, {self.radius}, {self.turn!r})"
