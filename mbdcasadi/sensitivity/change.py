"""Changes of the mechanism, or of the mode of exact friction and contacts, across which variations are carried."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..equations.impact_law import ImpactLaw
from ..errors import SimulationError
from ..model.symbols import Parameter, StateVariable, place_of
from ..numerics.least_squares import largest, least_norm
from ..results.phases import places_in
from .contact_impact import ContactImpact
from .phase_flow import PhaseFlow, VariedState
from .switched_motion import Boundary

#: Share of a variation up to which the rows of a joint that closes may open for other values.
CLOSING_TOLERANCE = 1e-5


class Change:
    """A change of the mechanism, across which variations are carried.

    Parameters
    ----------
    flow, following : PhaseFlow
        The phases before and after it.
    boundary : Boundary
        The events at which it takes place.
    instant : VariedState
        State just before, and its variations along with the instant.
    """

    def __init__(self, flow: PhaseFlow, following: PhaseFlow, boundary: Boundary, instant: VariedState):
        self._flow, self._following, self._event, self._instant = flow, following, boundary.events[0], instant
        self._law = ImpactLaw(following.eom, self._event.restitution)
        after = boundary.occurrences[0].after
        strikes = self._event.becomes is None and after is not None and after.impulses is not None
        self._impact = ContactImpact(boundary.occurrences[0]) if strikes else None
        known = {symbol.element_hash() for symbol in ca.vertsplit(flow.eom.q)}
        coordinates = ca.vertsplit(following.eom.q)
        #: coordinates that go on, in the mechanism after it, and their places in the one before
        self._going_on = [k for k, symbol in enumerate(coordinates) if symbol.element_hash() in known]
        self._places = np.array(places_in(flow.eom.q, following.eom.q[self._going_on]), int)

    def across(self, parameters: dict[Any, np.ndarray]) -> tuple[np.ndarray, dict[Any, np.ndarray]]:
        """Variations of the state just after it, and of the parameters from there on."""
        parameters, states = dict(parameters), {}
        for symbol, value in self._event.new_values:
            row = self._flow.at(value, self._instant)[1].ravel()
            if isinstance(symbol, Parameter):
                parameters[symbol] = row
            elif isinstance(symbol, StateVariable):
                states[symbol] = row
        dp = self._following.dp(parameters)
        old, n = list(self._flow.mechanism.states), self._flow.eom.q.numel()
        dz = np.zeros((len(self._following.mechanism.states), self._instant.dt.size))
        for k, symbol in enumerate(self._following.mechanism.states):
            place = place_of(symbol, old)
            dz[k] = states.get(symbol, 0.0 if place is None else self._instant.dx[2 * n + place])
        dq, dv = self._carried(dz, dp)
        dv = self._jumped(dq, dv, dz, dp)
        return np.vstack([dq, dv, dz]), parameters

    def _carried(self, dz: np.ndarray, dp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Variations of the coordinates just after it, and of the velocities just before it, of bodies that go on."""
        following, eom, law, dt = self._following, self._following.eom, self._law, self._instant.dt
        n_old, n = self._flow.eom.q.numel(), eom.q.numel()
        dq, dv = np.zeros((n, dt.size)), np.zeros((n, dt.size))
        dq[self._going_on], dv[self._going_on] = (self._instant.dx[k + self._places] for k in (0, n_old))
        rows = law.positions
        if not rows.numel():
            return dq, dv
        slopes = ca.Function(
            "rows",
            [eom.t, eom.q, eom.z, eom.p],
            [ca.densify(ca.jacobian(rows, x)) for x in (eom.q, eom.t, eom.z, eom.p)],
        )
        state = following.x0[:n], following.x0[2 * n : 2 * n + eom.z.numel()]
        by_q, by_t, by_z, by_p = (x.full() for x in slopes(self._instant.time, *state, following.p))
        new = [k for k in range(n) if k not in set(self._going_on)]
        open_ = by_q @ dq + by_t @ dt[None, :] + by_z @ dz + by_p @ dp
        if new:
            dq[new] = least_norm(by_q[:, new], -open_)
            open_ = open_ + by_q[:, new] @ dq[new]
        size = 1 + largest(dq) + largest(dt)
        if largest(open_) > CLOSING_TOLERANCE * size:
            worst = law.position_names[int(np.argmax(np.max(np.abs(open_), axis=1)))]
            raise SimulationError(
                f"sensitivities: for other values event '{self._event.name}' at t = {self._instant.time:.6g} s would "
                f"not find the position of '{worst}' closed; let a parameter in it take the value of that instant "
                "(reset=)",
                time=self._instant.time,
            )
        return dq, dv

    def _jumped(self, dq: np.ndarray, dv: np.ndarray, dz: np.ndarray, dp: np.ndarray) -> np.ndarray:
        """Variations of the velocities just after it: the law of impact, differentiated as an implicit function."""
        following, eom, law, time = self._following, self._following.eom, self._law, self._instant.time
        n_old, n = self._flow.eom.q.numel(), eom.q.numel()
        v_before = np.zeros(n)
        v_before[self._going_on] = self._instant.x[n_old + self._places]
        if self._impact is not None:
            v_before, dv = self._impact.v, self._impact.change(self._instant, dq, dv, dz)
        q, z = following.x0[:n], following.x0[2 * n : 2 * n + eom.z.numel()]
        _ = following.motion.numeric.mass_of_impulses  # raises if masses change
        jump = law.solve(following.motion.numeric, time, q, v_before, z)
        kept = [k for k in range(law.impulses.numel()) if k not in set(jump.dependent)]
        rows = ca.vertcat(law.momentum, law.velocity[kept])
        unknowns = ca.vertcat(eom.v, law.impulses[kept])
        known = [eom.t, eom.q, law.v_before, eom.z, eom.p]
        arguments = [*known, eom.v, law.impulses]
        slopes = ca.Function("impact", arguments, [ca.densify(ca.jacobian(rows, s)) for s in (unknowns, *known)])
        by_unknowns, by_t, by_q, by_v, by_z, by_p = (
            m.full() for m in slopes(time, q, v_before, z, following.p, jump.v, jump.impulses)
        )
        right = -(by_t @ self._instant.dt[None, :] + by_q @ dq + by_v @ dv + by_z @ dz + by_p @ dp)
        return np.asarray(least_norm(by_unknowns, right)[:n])


def refuse_open_start(flow: PhaseFlow, dx: np.ndarray, dp: np.ndarray) -> None:
    """Raise if what sticks or touches at the start of a motion would not for other values.

    Raises
    ------
    SimulationError
        With the name of the row.
    """
    eom, n, time = flow.eom, flow.eom.q.numel(), float(flow.grid[0])
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
    symbols = ca.vertcat(eom.q, eom.v, eom.z, eom.p)
    slopes = ca.Function("rows", [eom.t, eom.q, eom.v, eom.z, eom.p], [ca.densify(ca.jacobian(rows, symbols))])
    open_ = slopes(time, *np.split(flow.x0, [n, 2 * n]), flow.p).full() @ np.vstack([dx, dp])
    if largest(open_) > CLOSING_TOLERANCE * (1 + largest(dx) + largest(dp)):
        worst = [*eom.position_names, *eom.row_names][int(np.argmax(np.max(np.abs(open_), axis=1)))]
        raise SimulationError(
            f"sensitivities: for other values '{worst}' would not stick or touch at the start, t = {time:.6g} s, as it "
            "does: there is no derivative; start a little before or after",
            time=time,
        )
