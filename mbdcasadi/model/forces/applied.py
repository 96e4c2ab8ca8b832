"""Forces and couples applied to bodies."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ...errors import ModelError
from ..bodies import Body, Marker, as_body, as_marker, bodies_of_couple, ground, rotation
from ..element import BEYOND_COORDINATES, Element, owners, refuse_kinds, work_at
from ..quantities import entries, one_of, quantity, vector2
from ..symbols import Scalar, Vector


class Force(Element):
    """Point force: ``δW = F · δr^P``, with P as a point of the body.

    Parameters
    ----------
    name : str
        Its name.
    at : Marker
        Point of application P.
    vector : (expression, expression)
        Components, N.
    frame : {"global", "body"}, default "global"
        Axes of the components: global, or the marker's own, which turn with the body.
    opposite : Body, default ground
        Body that takes the reaction, ``-F`` at the same point. The ground takes that of a gas force, through the
        cylinder head; ``shaking_force`` includes it. For a force from outside, such as wind, subtract it there:
        ``shaking.force - wind.force``.

    Attributes
    ----------
    force : casadi.SX
        Force on the marker's body (2,), global axes, N.

    Raises
    ------
    ModelError
        For a force whose reaction the same body takes.

    References
    ----------
    Haug 1989, section 6.1, eq. (6.1.20).

    Examples
    --------
    A force plate with a centre of pressure that moves; the foot takes the reaction, at that place::

        Force("plate", ground.at(centre, 0), (-fx, -fy), opposite=foot)  # inputs, whose samples inputs= takes
    """

    kind = "force"

    def __init__(self, name: str, at: Marker, vector: Vector, frame: str = "global", opposite: Body = ground):
        super().__init__(name)
        self.at = as_marker(at, self.description, "at")
        self.opposite = ground if opposite is None else as_body(opposite, self.description, "opposite")
        if self.opposite is self.at.body:
            raise ModelError(
                f"{self.description} acts on '{self.at.body.name}', which takes the reaction too: it would do nothing; "
                "at= is a marker on the body that moves, opposite= another body"
            )
        components = vector2(vector, self.description, "vector")
        self.frame = one_of(frame, ("global", "body"), self.description, "frame")
        self.force = components if self.frame == "global" else rotation(self.at.angle) @ components
        self.markers = (self.at,)
        place = self.at.position
        self.virtual_work = work_at(self.at.body, place, self.force) + work_at(self.opposite, place, -self.force)
        self.__dict__["bodies"] = (self.at.body, self.opposite)


class Torque(Element):
    """Couple: ``δW = n (δphi - δphi_opposite)``.

    Parameters
    ----------
    name : str
        Its name.
    body : Body
        Body on which the couple acts.
    value : float or expression
        Couple n, N m, counter-clockwise.
    opposite : Body, default ground
        Body that takes the reaction.

    Attributes
    ----------
    torque : casadi.SX
        Couple on the body, N m.
    """

    kind = "torque"

    def __init__(self, name: str, body: Body, value: Scalar, opposite: Body = ground):
        super().__init__(name)
        self.body, self.opposite = bodies_of_couple(body, opposite, self.description)
        self.torque = ca.SX(quantity(value, self.description, "value"))
        self.virtual_work = ((self.body.phi - self.opposite.phi, self.torque),)
        self.__dict__["bodies"] = (self.body, self.opposite)


class GeneralizedForce(Element):
    """Any force, given by its virtual work: ``δW = Σ force · δexpression``.

    Parameters
    ----------
    name : str
        Its name.
    pairs : sequence of (expression, force)
        Expressions in coordinates, and the force (N) or couple (N m) along each. The ground takes the part of the
        forces on the bodies that does not balance.

    Attributes
    ----------
    forces : casadi.SX
        Forces (k,) along all components of the expressions, in their order, N or N m.

    Examples
    --------
    A motor between two bodies that are not neighbours::

        GeneralizedForce("belt motor", [(b.phi - 2 * a.phi, tau)])
    """

    kind = "force"

    def __init__(self, name: str, pairs: Sequence[tuple[Scalar, Scalar]]):
        super().__init__(name)
        checked = []
        for entry in entries(pairs, f"{self.description}: pairs"):
            try:
                expression, force = (ca.vec(ca.SX(part)) for part in entry)
            except (TypeError, ValueError, NotImplementedError):
                raise ModelError(f"{self.description}: takes pairs (expression, force), got {entry!r}") from None
            if expression.numel() != force.numel():
                raise ModelError(
                    f"{self.description}: an expression of {expression.numel()} components is paired "
                    f"with a force of {force.numel()}"
                )
            refuse_kinds(
                expression, BEYOND_COORDINATES, self.description, "a virtual displacement depends on coordinates only"
            )
            quantities = [quantity(part, self.description, "force") for part in ca.vertsplit(force)]
            checked.append((expression, ca.vertcat(*[ca.SX(part) for part in quantities])))
        if not checked:
            raise ModelError(f"{self.description}: takes at least one pair (expression, force)")
        self.virtual_work = tuple(checked)
        self.forces = ca.vertcat(*[force for _, force in checked])
        # the ground takes the rest: the housing of a motor, the bearings of a belt
        self.__dict__["bodies"] = (*dict.fromkeys(b for e, _ in checked for b in owners(e)), ground)
