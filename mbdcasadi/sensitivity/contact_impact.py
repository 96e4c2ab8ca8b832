"""The impact of rigid contacts, differentiated as the implicit function that it is.

``M (v⁺ - v⁻) + Phi_q^T Λ - w_v^T Λ_n - s_v^T Λ_t = 0``, ``Phi_q v⁺ = nu``, and of each place that is struck
``w⁺ = -e w⁻`` with the speed w at which the surfaces part, or zero where the bounces end, and ``s⁺ = 0`` if it sticks,
``Λ_t = -μ Λ_n sgn s⁺`` if it slides: the laws of :class:`RigidContact` with the choice of open, sticking and sliding
that the motion made; and so for dry friction in joints, under the load of their impulses.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..model.forces.contact.rigid import RigidContact
from ..model.forces.friction.joint_friction import FrictionInJoint
from ..model.forces.friction.modes import without_exact_friction
from ..numerics.least_squares import largest, least_norm
from ..numerics.tolerances import AT_REST, NEGLIGIBLE
from ..results.state import EventOccurrence
from ..simulation.changes.events import at_rest
from .phase_flow import VariedState


class ContactImpact:
    """An impact that took place.

    Parameters
    ----------
    occurrence : EventOccurrence
        The event, with the states just before and just after, and the impulses.
    """

    def __init__(self, occurrence: EventOccurrence):
        before, after = occurrence.state, occurrence.after
        assert after is not None and after.impulses is not None
        self._before, self._after, self._impulses = before, after, after.impulses
        eom = self._eom = equations(without_exact_friction(after.mechanism))
        self._v_before = ca.SX.sym("v_before", eom.v.numel())
        self._lam = ca.SX.sym("joint impulses", eom.lam.numel())
        momentum = eom.mass_diagonal * (eom.v - self._v_before) + eom.Phi_q.T @ self._lam
        values = [self._of(e, e.multipliers.numel()) for e in dict.fromkeys(eom.row_elements)]
        none, laws, symbols = ca.SX(0, 1), [eom.Phi_q @ eom.v - eom.nu], [self._lam]
        for contact in (e for e in self._impulses if isinstance(e, RigidContact)):
            count, given = len(contact.places), -self._of(contact, contact.multipliers.numel())
            for k in np.flatnonzero(given[:count] > NEGLIGIBLE * largest(given)).tolist():
                normal, along = ca.SX.sym("normal"), ca.SX.sym("along")
                law, along_law = self._laws_at(contact, k, normal, along)
                speeds = ca.vertcat(contact.normal_speeds[k], contact.sliding_speeds[k])
                momentum -= ca.jacobian(speeds, eom.v).T @ ca.vertcat(normal, along)
                laws += [law, along_law]
                symbols += [normal, along]
                values.append(np.array([given[k], given[count + k]]))
        for friction in (e for e in self._impulses if isinstance(e, FrictionInJoint)):
            along = ca.SX.sym("along")
            momentum -= ca.jacobian(friction.sliding_speed, eom.v).T @ along
            laws.append(self._law_in_joint(friction, along))
            symbols.append(along)
            values.append(-self._of(friction, 1))
        self._unknowns = ca.vertcat(eom.v, *symbols)
        self._values = np.concatenate([after.v, *values])
        self._rows = ca.vertcat(none, momentum, *laws)

    @property
    def v(self) -> np.ndarray:
        """Velocities just after it (n,)."""
        return self._after.v

    def _of(self, element: Any, size: int) -> np.ndarray:
        return np.asarray(self._impulses.get(element, np.zeros(size)), float)

    def _laws_at(self, contact: RigidContact, k: int, normal: ca.SX, along: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Laws of a place that is struck: along its normal, and along its tangent."""
        eom, parting = self._eom, contact.normal_speeds[k]
        bounces = float(self._before[parting]) < 0 < float(self._after[parting]) - at_rest(self._after)
        earlier = ca.substitute(parting, eom.v, self._v_before)
        law = parting + (contact.restitution * earlier if bounces else 0)
        if contact.friction is None:
            return law, along
        return law, self._along(contact.sliding_speeds[k], contact.friction, normal, along)

    def _law_in_joint(self, friction: FrictionInJoint, along: ca.SX) -> ca.SX:
        """Law of dry friction in a joint, whose load is that of the impulses: a preload has none."""
        lam = self._eom.lam
        load = ca.substitute(ca.SX(friction.load), lam, self._lam) - ca.substitute(
            ca.SX(friction.load), lam, ca.SX.zeros(lam.numel())
        )
        return self._along(friction.sliding_speed, friction.law, load, along)

    def _along(self, sliding: ca.SX, law: Any, load: ca.SX, along: ca.SX) -> ca.SX:
        """Law of Coulomb in an impact: what rests after it sticks."""
        speed = float(self._after[sliding])
        if abs(speed) <= AT_REST * (1 + largest(self._after.v)):
            return sliding
        return along + np.sign(speed) * law.coefficient * load

    def change(self, instant: VariedState, dq: np.ndarray, dv: np.ndarray, dz: np.ndarray) -> np.ndarray:
        """Variations of the velocities just after it (n, k), from those of the instant and the state just before."""
        eom, before = self._eom, self._before
        known = [eom.t, eom.q, self._v_before, eom.z, eom.p]
        arguments = [*known, self._unknowns]
        slopes = ca.Function(
            "impact", arguments, [ca.densify(ca.jacobian(self._rows, s)) for s in (self._unknowns, *known)]
        )
        numbers = before.t, before.q, before.v, before.z, before.parameters, self._values
        by_unknowns, by_t, by_q, by_v, by_z, by_p = (m.full() for m in slopes(*numbers))
        right = -(by_t @ instant.dt[None, :] + by_q @ dq + by_v @ dv + by_z @ dz + by_p @ instant.dp)
        return np.asarray(least_norm(by_unknowns, right)[: eom.v.numel()])
