"""First-order changes of everything in a mechanism with its independent coordinates, inputs and parameters.

At a state let ``w`` be independent coordinates, ``y`` independent rates and
``z`` first-order states. A change ``d = (w, y, z, inputs and parameters)``
changes the rest by three linear systems, one a level:

    [ Phi_q ]          [ -Phi_p dp ]     [ Phi_q ]          [ nu' ]     [ M     Phi_q^T ] [ da   ]
    [ w_q   ] dq     = [  dw       ],    [ y_v   ] dv     = [ dy' ],    [ Phi_q    0    ] [ dlam ] = ...

with the right sides' own changes at the levels before. Everything on the left
and right is the exact derivative of an expression, so that the geometric
stiffness of the multipliers and the terms of a steady motion are all there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..equations.least_norm import norm_of_multipliers
from ..equations.numeric import NumericEquations
from ..errors import MechanismError
from ..model.symbols import place_of
from ..numerics.tolerances import RANK
from ..results.state import State


class Directions:
    """Changes of ``(q, v, a, z, lam, u, p)`` with ``d = (w, y, z, wrt)``, each a matrix (…, number of changes).

    Parameters
    ----------
    numeric : NumericEquations
        Equations of motion at the parameters of the state.
    state : State
        State about which to linearise.
    positions, rates : casadi.SX
        Independent coordinates ``w(q, t, p)`` and rates ``y(q, v, t, p)``.
    inputs : casadi.SX
        The inputs, each as itself or as the feedback that sets it.
    wrt : sequence of casadi.SX
        Inputs and parameters by which to differentiate.

    Raises
    ------
    MechanismError
        If the coordinates are not independent at this state.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        state: State,
        positions: ca.SX,
        rates: ca.SX,
        inputs: ca.SX,
        wrt: Sequence[ca.SX],
    ):
        eom = self.eom = numeric.eom
        self.numeric, self.state = numeric, state
        self._inputs = inputs
        #: symbols that change, in the order of the parts below
        self.symbols = (eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, eom.p)
        sizes = [positions.numel(), rates.numel(), eom.z.numel(), len(wrt)]
        self.count = sum(sizes)
        unit = np.split(np.eye(self.count), np.cumsum(sizes)[:-1])
        self.p = _selected(eom.mechanism.parameters, wrt, unit[3])
        self._given_inputs = _selected(eom.mechanism.inputs, wrt, unit[3])
        self.z = unit[2]
        empty = [np.zeros((s.numel(), self.count)) for s in self.symbols]
        self.q, self.v, self.a, _, self.lam, self.u, _ = empty
        self._solve_levels(positions, rates, unit)

    def _solve_levels(self, positions: ca.SX, rates: ca.SX, unit: Sequence[np.ndarray]) -> None:
        eom, n = self.eom, self.eom.q.numel()
        self.q = self._solved(ca.vertcat(eom.Phi, positions), eom.q, (eom.Phi.numel(), unit[0]), "position")
        velocity = eom.Phi_q @ eom.v - eom.nu
        self.v = self._solved(ca.vertcat(velocity, rates), eom.v, (eom.lam.numel(), unit[1]), "velocity")
        self.u = self._given_inputs + self.of(self._inputs, without_inputs=True)
        motion = eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q
        # masses and loads of a small mechanism are tiny beside the entries of Phi_q
        columns, mass = self.numeric.column_scale, self.numeric.largest_mass
        rows = ca.vertcat(columns / mass * motion, eom.Phi_q @ eom.a - eom.gamma)
        none = np.zeros((0, self.count))
        both = self._solved(
            rows,
            ca.vertcat(eom.a, eom.lam),
            (rows.numel(), none),
            "acceleration",
            np.r_[columns, np.full(eom.lam.numel(), mass)],
        )
        self.a, self.lam = both[:n], both[n:]
        if self.numeric.has_redundant_rows(self.state.t, self.state.q) and not eom.Q_depends_on_lam:
            self._keep_least_norm()

    def _keep_least_norm(self) -> None:
        """Multipliers that stay those of least norm, as rows depend on each other.

        With the norm ``lam^T D lam`` these are ``D lam = Phi_q mu``; multipliers N without loads are added to their
        change so that ``N^T d(D lam - Phi_q mu) = 0``, with N of length one in the norm.
        """
        eom, columns = self.eom, self.numeric.column_scale
        norm = norm_of_multipliers(eom, self.numeric.multiplier_weights)
        sizes, jacobian = self._value(norm).ravel(), self._value(eom.Phi_q)
        root = 1 / np.sqrt(sizes)
        scaled = root[:, None] * jacobian * columns
        sides, values, _ = np.linalg.svd(scaled)
        internal = root[:, None] * sides[:, int(np.sum(values > RANK * np.max(values, initial=0.0))) :]
        mu = columns * np.linalg.lstsq(scaled, self.state.lam / root, rcond=RANK)[0]
        self.lam = self.lam - internal @ (internal.T @ self.of(norm * eom.lam - eom.Phi_q @ ca.DM(mu)))

    def _solved(
        self,
        rows: ca.SX,
        unknown: ca.SX,
        sides: tuple[int, np.ndarray],
        level: str,
        units: np.ndarray | float = 1.0,
    ) -> np.ndarray:
        """Change of the unknowns, measured in these units, that keeps the first rows at zero and moves the others."""
        held, moved = sides
        right = np.vstack([np.zeros((held, self.count)), moved]) - self.of(rows)
        matrix = self._value(ca.jacobian(rows, unknown)) * units
        # rows of forces and of motions differ by many orders of magnitude
        size = np.max(np.abs(matrix), axis=1, initial=0.0)
        size = np.where(size > 0, size, 1.0)[:, None]
        columns = 1 / np.maximum(np.max(np.abs(matrix / size), axis=0, initial=0.0), 1e-300)
        # with the rank, which decides if the coordinates are independent
        answer, _, rank, _ = np.linalg.lstsq(matrix / size * columns, right / size, rcond=1e-12)
        if level != "acceleration" and rank < unknown.numel():
            raise MechanismError(
                f"linearize: the coordinates chosen do not fix every {level} of the mechanism at this pose; "
                "choose others, or leave coordinates= out"
            )
        return (units * columns)[:, None] * answer

    # --- derivatives of expressions -----------------------------------------------------
    def of(self, expression: ca.SX, *, without_inputs: bool = False) -> np.ndarray:
        """Change of an expression by each change (k, count)."""
        parts = self.q, self.v, self.a, self.z, self.lam, self.u, self.p
        total = np.zeros((expression.numel(), self.count))
        for symbol, part in zip(self.symbols, parts, strict=True):
            if symbol.numel() and np.any(part) and not (without_inputs and symbol is self.eom.u):
                total += self._value(ca.jacobian(expression, symbol)) @ part
        return total

    def _value(self, expression: ca.SX) -> np.ndarray:
        function = ca.Function("value", list(self.eom.symbols), [expression])
        return function(*self.state.arguments).full()


def _selected(symbols: Sequence[Any], wrt: Sequence[Any], unit: np.ndarray) -> np.ndarray:
    """Columns that change each of the symbols."""
    rows = np.zeros((len(symbols), unit.shape[1]))
    for k, symbol in enumerate(symbols):
        place = place_of(symbol, wrt)
        if place is not None:
            rows[k] = unit[place]
    return rows
