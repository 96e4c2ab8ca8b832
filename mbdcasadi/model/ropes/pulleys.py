"""Pulleys over which ropes run, and drums on which they wind up."""

from __future__ import annotations

from typing import Any

from ...errors import ModelError
from ..bodies import Body, Marker, as_body, as_marker, ground
from ..forces.friction.laws import as_law
from ..immutable import Immutable
from ..quantities import HasQuantities, one_of, whole, yes_or_no
from ..symbols import Scalar

#: Sense in which a rope turns round a pulley, positive counter-clockwise.
TURNS = {"counter-clockwise": 1, "clockwise": -1}


class RopeWheel(Immutable, HasQuantities):
    """Base class of what a rope turns round.

    Attributes
    ----------
    sense : int
        Sense in which the rope turns round it, positive counter-clockwise.
    """

    def __init__(self, marker: Marker, radius: Scalar, turn: str, carrier: Body | None):
        kind = type(self).__name__
        self.marker = as_marker(marker, kind, "marker")
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        self.turn = one_of(turn, TURNS, kind, "turn")
        self.carrier = ground if carrier is None else as_body(carrier, kind, "carrier")
        self.sense = TURNS[self.turn]

    @property
    def description(self) -> str:
        """Kind and body, as messages give it."""
        kind = type(self).__name__
        return f"{kind.lower()} on '{self.marker.body.name}'" if hasattr(self, "marker") else kind

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.marker!r}, {self.radius}, {self.turn!r})"


class Pulley(RopeWheel):
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
    carrier : Body, optional
        Of a pulley that grips, the body on which it turns; see :class:`Drum`.

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
        carrier: Body | None = None,
    ):
        super().__init__(marker, radius, turn, carrier)
        self.grips = yes_or_no(grips, "Pulley", "grips")
        self.turns = whole(turns, "Pulley", "turns", 0)
        self.friction = None if friction is None else as_law(friction, "Pulley")
        if self.grips and friction is not None:
            raise ModelError("Pulley: a rope that grips does not rub; give grips=True or friction=, not both")
        if carrier is not None and not self.grips:
            raise ModelError("Pulley: carrier= is for a pulley that grips; on a free one nothing winds up")


class Drum(RopeWheel):
    """A drum on which an end of a rope is fixed and winds up, over any number of turns.

    Parameters
    ----------
    marker : Marker
        Its centre, on the body that turns with it.
    radius : float or expression in parameters
        Radius to the middle of the rope, m.
    turn : {"clockwise", "counter-clockwise"}
        Sense in which the rope turns round it, on its way from the first end to the last.
    carrier : Body, optional
        Body on which it turns, if that turns far, too: an arm with a winch. Relative to it, a strand may turn by up to
        135° from the estimated poses; by default relative to the ground.
    """

    def __init__(self, marker: Marker, radius: Scalar, turn: str, carrier: Body | None = None):
        super().__init__(marker, radius, turn, carrier)
