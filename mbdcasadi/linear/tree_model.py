"""A mechanism in the coordinates of its tree of joints and in independent ones: equations along a motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..equations import Equations
from ..equations.tree import tree_coordinates
from ..errors import ExpressionError, ModelError, SingularityError
from ..model.mechanism import Mechanism
from ..model.symbols import describe, symbols_of
from ..model.units import unit_of
from ..numerics.c_code import simplified
from ..numerics.lazy import cached_property
from ..numerics.rank import dependent_rows, unit_rows
from ..results.state import State
from .coordinates import Independent, independent

#: Difference of two ways to the accelerations of the start, relative to 1 and their size, that is rounding.
SAME = 1e-6
#: Turn or decay of the fastest mode of the start in a Runge-Kutta step, rad: it then errs by a part in a million.
TURN = 0.25


class TreeModel:
    """States and equations of a mechanism along a motion.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    eom : Equations
        Its equations, or those of a phase.
    chosen : sequence of expressions or None
        Positions that describe the motion; None lets coordinates of the bodies be chosen.
    analysis : str
        Name in errors.
    initial : State, optional
        State near which coordinates are chosen; by default at rest near the estimated poses.

    Attributes
    ----------
    start : State
        A consistent state there.
    independent : Independent
        States: positions and rates; first-order states follow.
    state : casadi.SX
        All of them (n_x,), in the symbols of the mechanism.
    names : tuple of str
        Of the states.
    q, v : casadi.SX
        Coordinates and velocities of the tree.
    rates : casadi.SX
        Accelerations of these, and rates of first-order states, by ``at = (t, q, v, z, u, p)``.
    fastest : float
        Magnitude of the largest eigenvalue of the start, 1/s.
    """

    def __init__(self, mechanism: Mechanism, eom: Equations, chosen: Any, analysis: str, initial: State | None = None):
        self.eom, self._analysis = eom, analysis
        setup = Setup(mechanism, analysis, t=0.0 if initial is None else initial.t, initial=initial or ())
        self.start: State = setup.start
        self.independent: Independent = independent(
            setup.numeric, self.start, chosen, analysis=analysis, argument="state="
        )
        self._numeric = setup.numeric
        if eom.Q_depends_on_lam:
            raise ModelError(
                f"{analysis}: a force depends on reactions, and no code is written for that; take "
                f"LoadIndependentFriction in the mechanism of the {analysis.lower()}"
            )
        self.state = ca.vertcat(self.independent.positions, self.independent.rates, eom.z)
        self.names = (*self.independent.names, *(z.label for z in mechanism.states))
        #: their units; empty if not known
        self.units = tuple(map(unit_of, ca.vertsplit(self.state)))
        tree = self.tree = tree_coordinates(eom)
        self.q, self.v = eom.q[tree.independent], eom.v[tree.independent]
        self._loads = self._accelerations()
        self.at = [eom.t, self.q, self.v, eom.z, eom.u, eom.p]
        self.rates = self.along(ca.vertcat(self._loads[tree.independent], eom.z_rate))
        self.fastest = self._fastest()

    def steps_over(self, length: float) -> int:
        """Runge-Kutta steps over an interval (s), as many as the fastest mode of the start needs."""
        return max(1, math.ceil(self.fastest * length / TURN))

    def slopes(self, by_q: np.ndarray, by_v: np.ndarray, bend: np.ndarray, *others: np.ndarray) -> np.ndarray | None:
        """Slopes of (q, v, z) of the tree by the states and unknown parameters (n_s, n_x); None if there are none.

        Parameters
        ----------
        by_q, by_v, bend : numpy.ndarray
            Slopes of the rows of :meth:`pose` by q and v, and of those of velocities by q.
        others : numpy.ndarray
            Slopes of both by first-order states, and by unknown parameters, if there are any.
        """
        n, positions, rates = self.q.numel(), self.independent.positions.numel(), self.independent.rates.numel()
        known, driven = len(self.names), np.concatenate([others[k : k + 2] for k in range(0, len(others), 2)], axis=2)
        wanted = np.zeros((2, n, positions + rates + driven.shape[2]))
        wanted[0, n - positions :, :positions] = np.eye(positions)
        wanted[1, n - rates :, positions : positions + rates] = np.eye(rates)
        wanted[:, :, positions + rates :] -= driven
        q_by_x = solved(by_q, wanted[0])
        v_by_x = None if q_by_x is None else solved(by_v, wanted[1] - bend @ q_by_x)
        if q_by_x is None or v_by_x is None:
            return None
        return np.vstack([q_by_x, v_by_x, np.eye(wanted.shape[2])[positions + rates : known]])

    # --- expressions of the tree -----------------------------------------------------------------------------
    def along(self, expression: ca.SX) -> ca.SX:
        """An expression in the symbols of the tree, accelerations and reactions by the equations of motion."""
        eom = self.eom
        known = ca.vertcat(eom.a, eom.lam)
        if ca.depends_on(expression, eom.lam):
            expression = ca.substitute(expression, known, ca.vertcat(*self._by_all_rows()))
        elif ca.depends_on(expression, eom.a):
            expression = ca.substitute(expression, eom.a, self._loads)
        full = ca.vertcat(eom.q, eom.v)
        return ca.densify(ca.substitute(expression, full, ca.vertcat(self.tree.q, self.tree.v)))

    def state_at(self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray, p: np.ndarray) -> State:
        """The state at coordinates and velocities of the tree."""
        bodies = self._all_coordinates(q, v, p)
        loads = self._numeric.forward_dynamics(redundant=False)(t, *bodies, z, u, p)
        q, v, a, lam = (x.full().ravel() for x in (*bodies, *loads))
        return State(self.eom.mechanism, t, q, v, a, z, lam, u, p)

    @cached_property
    def _all_coordinates(self) -> ca.Function:
        return ca.Function("all_coordinates", [self.q, self.v, self.eom.p], [self.tree.q, self.tree.v])

    def _by_all_rows(self) -> tuple[ca.SX, ca.SX]:
        eom, tree = self.eom, self.tree
        a, lam = self._numeric.forward_dynamics(redundant=False)(eom.t, tree.q, tree.v, eom.z, eom.u, eom.p)
        return a, lam

    def _accelerations(self) -> ca.SX:
        """Accelerations of all coordinates: by the inertia of the tree, or of all bodies if that is singular."""
        eom = self.eom
        symbols = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
        start = self.start
        values = (start.t, start.q, start.v, start.z, start.inputs, start.parameters)
        for make in (lambda: self.tree.accelerations(eom.t, eom.z, eom.u, eom.p), lambda: self._by_all_rows()[0]):
            loads = make()
            found = ca.Function("a", symbols, [loads])(*values).full().ravel()
            if np.all(np.abs(found - start.a) <= SAME * (1 + np.max(np.abs(start.a), initial=0))):
                return loads
        raise ModelError(
            f"{self._analysis}: the accelerations of the assembled state have no value in the coordinates of the "
            "joints: its constraints are redundant (see check), or mass is missing"
        )

    def _fastest(self) -> float:
        """Magnitude of the largest eigenvalue of the equations of the tree at the start, 1/s."""
        places, start, n = self.tree.independent, self.start, self.q.numel()
        by_state = ca.jacobian(self.rates, ca.vertcat(self.q, self.v, self.eom.z))
        slopes = ca.Function("slopes", self.at, [by_state])(
            start.t, start.q[places], start.v[places], start.z, start.inputs, start.parameters
        )
        count = 2 * n + start.z.size
        whole = np.vstack([np.eye(n, count, n), slopes.full()])
        return float(np.max(np.abs(np.linalg.eigvals(whole)), initial=0.0)) if np.isfinite(whole).all() else 0.0

    def pose(self) -> ca.Function:
        """``(t, q, v, z, p) -> rows of the pose, of the velocities, slopes``.

        These are of the pose by q, of the velocities by v and q, and of both by z, on which rows depend if drivers
        follow states.
        """
        eom, chosen = self.eom, self.independent
        left = self.tree.left
        position = {int(row): place for place, row in enumerate(eom.position_rows)}
        phi = eom.Phi[[position[k] for k in left if k in position]]
        speeds = ca.vertcat((eom.Phi_q[left, :] @ eom.v - eom.nu[left]), chosen.rates)
        rows, speeds = self.along(ca.vertcat(phi, chosen.positions)), self.along(speeds)
        if rows.numel() != self.q.numel() or speeds.numel() != self.q.numel():
            raise ModelError(
                f"{self._analysis}: the constraints of the assembled pose are not independent; see check for the rows "
                "that are redundant"
            )
        slopes = [(rows, self.q), (speeds, self.v), (speeds, self.q), (rows, eom.z), (speeds, eom.z)]
        results = [rows, speeds, *(ca.jacobian(*pair) for pair in slopes)]
        pose = self.function("controller_pose", [eom.t, self.q, self.v, eom.z, eom.p], results)
        places, start = self.tree.independent, self.start
        _, _, by_q, by_v, *_ = pose(start.t, start.q[places], start.v[places], start.z, start.parameters)
        if any(dependent_rows(unit_rows(m.full())) for m in (by_q, by_v)):
            raise SingularityError(
                f"{self._analysis}: the states {', '.join(self.names)} do not describe the motion at t = "
                f"{start.t:.6g} s; choose others by state="
            )
        return pose

    def function(self, name: str, arguments: Sequence[ca.SX], results: Sequence[ca.SX]) -> ca.Function:
        """A function of symbols that are known; of any other an error."""
        known = {s.element_hash() for group in arguments for s in ca.vertsplit(group)}
        for result in results:
            for symbol in symbols_of(result):
                if symbol.element_hash() not in known:
                    raise ExpressionError(f"{self._analysis}: it contains {describe(symbol)}, which is not known there")
        return simplified(ca.Function(name, list(arguments), list(results)))


def solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray | None:
    """Solution of linear equations; None if they have none, or a number is not finite."""
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None
    return found if np.isfinite(found).all() else None
