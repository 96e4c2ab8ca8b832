"""The equations of motion in fewer coordinates: those that constraints give explicitly are left out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from .derivation import Equations
from .explicit import ExplicitRow, explicit_rows


def reduced_equations(eom: Equations, *, curved: bool = True, angles: bool = False) -> ReducedEquations:
    """:class:`ReducedEquations` of a mechanism, made once and kept."""
    return eom.mechanism.cache.get_or_create(
        ("reduced equations", curved, angles), lambda: ReducedEquations(eom, curved=curved, angles=angles)
    )


def is_chain_in_angles(eom: Equations) -> bool:
    """Return True if a mechanism is an open chain: its angles alone are left, and no row."""
    return len(_solved_rows(eom, curved=True, angles=True)) == eom.lam.numel()


def _solved_rows(eom: Equations, *, curved: bool, angles: bool) -> list[ExplicitRow]:
    """Rows that are solved; none if forces depend on multipliers, or no coordinate would be left."""

    def make() -> list[ExplicitRow]:
        solved = [] if eom.Q_depends_on_lam else explicit_rows(eom, curved=curved, angles=angles)
        return solved if len(solved) < eom.q.numel() else []

    return eom.shared.get_or_create(("solved rows", curved, angles), make)


class _Placed(NamedTuple):
    """All coordinates, their rates and accelerations in terms of the independent ones."""

    q: ca.SX
    v: ca.SX
    a: ca.SX
    #: coordinates if the explicit rows are `error` in place of zero
    displaced: ca.SX
    error: ca.SX


class _Terms(NamedTuple):
    """Terms of :class:`ReducedEquations`, with the multipliers of all rows."""

    motion: ca.SX
    Phi: ca.SX
    Phi_q: ca.SX
    nu: ca.SX
    gamma: ca.SX
    z_rate: ca.SX
    lam: ca.SX


class ReducedEquations:
    """Constrained equations of motion with the explicit constraints solved.

    Let ``q = f(w, t)`` (and states that drivers follow) be the coordinates in terms of the independent ones
    ``w``, a part of them, by which the explicit rows of the constraints hold
    whatever ``w`` is. With virtual displacements ``f_w dw`` the equations of
    motion become

        f_w^T (M a + Phi_q^T lam - Q) = 0,    Phi_q a = gamma

    with the rows that are left, ``v = f_w w' + f_t``, and ``a`` its rate. The
    multipliers of the explicit rows follow: if these rows are ``e`` in place
    of zero, ``q = f(w, t, e)``, and ``lam_e = -f_e^T (M a + Phi_q^T lam - Q)``.

    A cart with a pendulum is left with its two coordinates and no constraints,
    a four-bar with three angles and the pin that closes it; in long open
    chains linear rows alone are solved, see
    :func:`~mbdcasadi.equations.explicit.explicit_rows`. If forces depend on
    multipliers, or no coordinate would be left, none is.

    The attributes have the names of :class:`~mbdcasadi.equations.derivation.Equations`,
    and are those of the independent coordinates and of the rows that are left.

    Parameters
    ----------
    eom : Equations
        Equations in all coordinates.
    curved : bool
        True if rows that are not linear are solved as well.
    angles : bool
        True if open chains are left with their angles alone.

    Attributes
    ----------
    whole : Equations
        Equations in all coordinates.
    independent : list of int
        Coordinates that are left.
    rows, explicit : list of int
        Rows that are left and those that are solved, among all rows.

    References
    ----------
    Wehage, Haug, "Generalized coordinate partitioning for dimension reduction in
    analysis of constrained dynamic systems", Journal of Mechanical Design 104 (1982).
    """

    def __init__(self, eom: Equations, *, curved: bool, angles: bool):
        self.whole, self.mechanism, self.curved, self.angles = eom, eom.mechanism, curved, angles
        self.t, self.z, self.u, self.p = eom.t, eom.z, eom.u, eom.p
        self._solved = _solved_rows(eom, curved=curved, angles=angles)
        self.explicit = [int(eom.position_rows[row.place]) for row in self._solved]
        self._dependent = [row.coordinate for row in self._solved]
        solved_rows, dependent = set(self.explicit), set(self._dependent)
        self.rows = [k for k in range(eom.lam.numel()) if k not in solved_rows]
        self.independent = [k for k in range(eom.q.numel()) if k not in dependent]
        self.q, self.v, self.a = eom.q[self.independent], eom.v[self.independent], eom.a[self.independent]
        self.lam = eom.lam[self.rows, 0]
        self.coordinate_names = tuple(eom.coordinate_names[k] for k in self.independent)
        self.row_names = tuple(eom.row_names[k] for k in self.rows)
        self.angular_rows = eom.angular_rows[self.rows]
        positions = {int(k): place for place, k in enumerate(eom.position_rows)}
        self.position_rows = np.array([i for i, k in enumerate(self.rows) if k in positions], int)
        self._places = [positions[k] for k in self.rows if k in positions]

    # --- terms, which are derived if they are asked for ------------------------------------------
    @cached_property
    def _placed(self) -> _Placed:
        error = ca.SX.sym("e", len(self._solved))
        displaced = _coordinates(self.whole, self._solved, error)
        q = ca.substitute(displaced, error, ca.SX.zeros(error.numel()))
        v = ca.jtimes(q, self.q, self.v) + self._in_time(q, q, ca.SX(self.whole.v))
        a = ca.jtimes(v, ca.vertcat(self.q, self.v), ca.vertcat(self.v, self.a)) + self._in_time(v, q, v)
        q, v, a = (ca.densify(x) for x in (q, v, a))
        return _Placed(q, v, a, displaced, error)

    def _in_time(self, expression: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
        """Rate of a column by time and by states, whose rates are in all coordinates and velocities, q and v here."""
        rate, dependent = self.whole.in_time(expression), self._dependent
        symbols, values = ([x[dependent], y[dependent]] for x, y in ((self.whole.q, self.whole.v), (q, v)))
        return ca.substitute([rate], symbols, values)[0] if dependent else rate

    @cached_property
    def _terms(self) -> _Terms:
        eom, (q, v, a, displaced, error) = self.whole, self._placed
        rows = eom.Phi_q[self.rows, :]
        load = eom.mass_diagonal * eom.a + rows.T @ self.lam - eom.Q
        right = [eom.Phi[self._places, 0], eom.nu[self.rows, 0], eom.gamma[self.rows, 0]]
        load, rows, phi, nu, gamma, z_rate = self.of(load, rows, *right, eom.z_rate)
        pull = -ca.densify(ca.substitute(ca.jtimes(displaced, error, load, True), error, ca.SX.zeros(error.numel())))
        lam = ca.SX(eom.lam)
        if self.explicit:
            lam[self.explicit] = pull
        return _Terms(
            ca.jtimes(q, self.q, load, True),
            phi,
            rows @ ca.jacobian(q, self.q),
            nu - rows @ ca.substitute(v, self.v, ca.SX.zeros(self.v.numel())),
            gamma - rows @ ca.substitute(a, self.a, ca.SX.zeros(self.a.numel())),
            ca.substitute(z_rate, eom.lam[self.explicit, 0], pull),
            lam,
        )

    @property
    def motion(self) -> ca.SX:
        """``f_w^T (M a + Phi_q^T lam - Q)``."""
        return self._terms.motion

    @property
    def Phi(self) -> ca.SX:
        """Position constraints that are left."""
        return self._terms.Phi

    @property
    def Phi_q(self) -> ca.SX:
        """Jacobian of the rows that are left."""
        return self._terms.Phi_q

    @property
    def nu(self) -> ca.SX:
        """Right side of their velocity equation."""
        return self._terms.nu

    @property
    def gamma(self) -> ca.SX:
        """Right side of their acceleration equation."""
        return self._terms.gamma

    @property
    def z_rate(self) -> ca.SX:
        """Rates of the first-order states."""
        return self._terms.z_rate

    @cached_property
    def expansion(self) -> ca.Function:
        """``(t, q, v, a, z, lam, u, p) -> (q, v, a, lam)``, from the independent to all."""

        def make() -> ca.Function:
            results = [*self._placed[:3], ca.densify(self._terms.lam)]
            return ca.Function("expansion", [*self.symbols], results)

        return self.whole.shared.get_or_create(("expansion", self.curved, self.angles), make)

    @cached_property
    def _expansion_by_row(self) -> Evaluator:
        key = "expansion by row", self.curved, self.angles
        return self.whole.shared.get_or_create(key, lambda: Evaluator(self.expansion))

    @property
    def symbols(self) -> tuple[ca.SX, ...]:
        """``(t, q, v, a, z, lam, u, p)``."""
        return self.t, self.q, self.v, self.a, self.z, self.lam, self.u, self.p

    @property
    def is_chain(self) -> bool:
        """True if the mechanism is an open chain in its angles alone, with no row left."""
        return self.angles and not self.rows

    @property
    def estimate(self) -> np.ndarray:
        """Estimate of the coordinates."""
        return self.whole.estimate[0][self.independent]

    def states(
        self, t: np.ndarray, w: np.ndarray, rate: np.ndarray, z: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """All coordinates and velocities (k, n) at times (k,), of independent ones (k, m) and states."""
        if not self._dependent:
            return w, rate
        a, lam, u = (np.zeros(x.numel()) for x in (self.a, self.lam, self.u))
        q, v, *_ = self._expansion_by_row.rows(t[:, None], w, rate, a, z, lam, u, p)
        return q, v

    def of(self, *expressions: ca.SX) -> Sequence[ca.SX]:
        """Expressions in positions, velocities and accelerations of all coordinates, in those of the independent."""
        if not self._dependent:
            return expressions
        eom = self.whole
        symbols = [x[self._dependent] for x in (eom.q, eom.v, eom.a)]
        return ca.substitute(list(expressions), symbols, [x[self._dependent] for x in self._placed[:3]])


def _coordinates(eom: Equations, solved: list[ExplicitRow], error: ca.SX) -> ca.SX:
    """All coordinates by the independent ones, with explicit rows equal to `error` instead of zero."""
    values, known = ca.SX(eom.q), list[int]()
    for one, miss in zip(solved, ca.vertsplit(error), strict=True):
        here, row = eom.q[one.coordinate], eom.Phi[one.place]
        row = ca.substitute(row, eom.q[known], values[known]) if known else row
        values[one.coordinate] = (miss - ca.substitute(row, here, ca.SX(0))) / one.factor
        if known and ca.depends_on(values[known], here):
            values[known] = ca.substitute(values[known], here, values[one.coordinate])
        known.append(one.coordinate)
    return values
