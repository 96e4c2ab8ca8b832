"""Play between the teeth of transmissions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..joints.gears import Coupler, Gear, RackAndPinion
from ..quantities import function_of
from ..symbols import Scalar
from .stops import OneSided


class Backlash(OneSided):
    """Teeth with play and stiffness, in place of a gear, a rack or a coupling.

    With the row Φ of the transmission, which is no constraint here: ``gap = [b/2 - Φ, b/2 + Φ]``, and on each flank
    ``F = law(-gap, -gap rate)`` if its gap is closed, else 0; ``δW = F δgap``. At the estimated poses a tooth is in
    the middle of its gap. Bearings and carrier are loaded as by the transmission.

    Parameters
    ----------
    name : str
        Its name.
    transmission : Gear, RackAndPinion or Coupler
        What has the play. It is not added to the joints of the mechanism itself.
    backlash : float or expression
        b, at least 0: the play, m along the pitch line; rad at the shaft b of a Coupler.
    law : callable
        ``law(penetration, rate)`` returns the force of a flank, N, or N m of a Coupler, as :class:`HuntCrossley` does.

    Attributes
    ----------
    play : casadi.SX
        Φ, m or rad: way of the tooth from the middle of its gap.
    gap, rate, force : casadi.SX
        Gap, its rate and force of each flank (2,).
    effort : casadi.SX
        ``tooth_force`` (N) or ``torque`` (N m) of the transmission, with the sign that it has there.

    Raises
    ------
    ModelError
        For what is no transmission, and a negative backlash.

    Examples
    --------
    Teeth of steel with a play of 0.1 mm::

        mesh = mbd.Gear("mesh", mbd.ground.at(0, 0), planet.at(0, 0), 0.04, 0.02, carrier=arm)
        teeth = mbd.Backlash("teeth", mesh, 1e-4, mbd.HuntCrossley(2e8, exponent=1, damping=0.5))
        mbd.Mechanism(bodies=[arm, planet], joints=[hub, pin], forces=[teeth])
    """

    kind = "backlash"

    def __init__(
        self,
        name: str,
        transmission: Gear | RackAndPinion | Coupler,
        backlash: Scalar,
        law: Callable[[ca.SX, ca.SX], Any],
    ):
        super().__init__(name)
        if not isinstance(transmission, Gear | RackAndPinion | Coupler):
            raise ModelError(
                f"{self.description}: transmission must be a Gear, RackAndPinion or Coupler, got {transmission!r}"
            )
        self.transmission, self.markers = transmission, transmission.markers
        self.backlash = self.read(backlash, "backlash", at_least=0.0)
        self.law = function_of(law, self.description, "law", "penetration", "rate")
        self.laws = (self.law, self.law)
        self.limits = (*self.limits, *transmission.limits, *getattr(law, "limits", ()))
        self.play = transmission.rows
        self.gap = self.backlash / 2 + ca.vertcat(-self.play, self.play)
        self.virtual_work = ((self.gap, self.force),)
        self.validity_conditions = transmission.validity_conditions
        self.__dict__["bodies"] = transmission.bodies

    @cached_property
    def effort(self) -> ca.SX:
        """Force (N) or couple (N m) of the teeth, as the transmission gives it."""
        joint = self.transmission
        known = joint.torque if isinstance(joint, Coupler) else joint.tooth_force
        return ca.substitute(known, joint.multipliers, self.force[0] - self.force[1])
