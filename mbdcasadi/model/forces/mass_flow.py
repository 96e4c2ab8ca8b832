"""Mass that leaves bodies or enters them: jets, hoppers, chains that are picked up."""

from __future__ import annotations

import casadi as ca

from ...errors import ModelError
from ..bodies import Marker, as_marker, rotation
from ..element import Element, work_at
from ..quantities import one_of, quantity, vector2
from ..symbols import Scalar, Vector


class MassFlow(Element):
    """Mass that leaves a body or enters it at a point, with a velocity relative to it.

    ``δW = mdot w · δr^P``: the force at the point P is the rate ``mdot`` of the body's mass times
    the velocity ``w`` of what flows relative to P. With the mass ``m(z)`` of the body it gives
    ``m a = F + mdot w`` (Meshchersky): what leaves moved with P before, and what has entered moves with it.

    The mass of the body is an expression in states, ``mass=40.0 + fuel``, whose rate is the sum of the
    rates of its flows. Its centre of mass stays where it is in the body; what the flow inside a body that turns adds is
    not part of the element, since it depends on the way inside. Of mass ``-mdot`` that goes straight from the centre of
    mass to a nozzle at the distance l in the direction ``e``, that is the jet damping ``(mdot l² - dJ/dt) omega``, by
    which the inertia J(z) changes as well, and the force of Coriolis ``2 mdot l omega × e``; see the second example.

    Parameters
    ----------
    name : str
        Its name.
    marker : Marker
        Point P of the body at which mass flows.
    rate : float or expression
        Rate ``mdot`` of the body's mass, kg/s: negative for what leaves, positive for what enters.
    velocity : (expression, expression)
        Velocity ``w`` of what flows relative to P, m/s.
    frame : {"body", "global"}, default "body"
        Axes of the velocity: the marker's own, which turn with the body, or global.

    Attributes
    ----------
    force : casadi.SX
        Force on the body (2,), global axes, N.

    Raises
    ------
    ModelError
        When a mechanism is made of it, if the mass of the body changes by another rate than the sum of its flows.

    References
    ----------
    Meriam, Kraige, *Engineering Mechanics: Dynamics*, 2012, section 4/7 (variable mass).

    Examples
    --------
    A rocket::

        fuel = mbd.StateVariable("fuel", 60.0)
        rocket = mbd.Body("rocket", mass=40.0 + fuel, inertia=10.0)
        jet = mbd.MassFlow("jet", rocket.at(0, -1), rate=-2.0, velocity=(0, -2500.0))
        mbd.Mechanism([rocket], forces=[jet], states={fuel: -2.0})

    Its jet damping, with a radius of gyration of 0.5 m, ``inertia=0.25 * (40.0 + fuel)``, and the force of Coriolis for
    a nozzle at the distance of one metre::

        damping = mbd.Torque("jet damping", rocket, (-2.0 * 1.0**2 + 2.0 * 0.25) * rocket.omega)
        coriolis = mbd.Force("coriolis", rocket.at(0, 0), (2 * -2.0 * 1.0 * rocket.omega, 0), frame="body")
    """

    kind = "mass flow"
    external = True

    def __init__(self, name: str, marker: Marker, rate: Scalar, velocity: Vector, frame: str = "body"):
        super().__init__(name)
        self.marker = as_marker(marker, self.description, "marker")
        body = self.marker.body
        if body.is_ground:
            raise ModelError(f"{self.description}: the ground has no mass that could change; take a marker on a body")
        self.rate = ca.SX(quantity(rate, self.description, "rate"))
        components = vector2(velocity, self.description, "velocity")
        self.frame = one_of(frame, ("body", "global"), self.description, "frame")
        relative = components if self.frame == "global" else rotation(self.marker.angle) @ components
        self.force = self.rate * relative
        self.markers = (self.marker,)
        self.mass_rates = ((body, self.rate),)
        self.virtual_work = work_at(body, self.marker.position, self.force)
