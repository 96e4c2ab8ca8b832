"""Impacts: velocities that jump by impulses of joints, as expressions and as numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ExpressionError, ModelError
from ..model.forces.active_rows import ActiveRows
from ..model.symbols import describe, symbols_of
from ..numerics.least_squares import least_norm
from ..numerics.rank import dependent_rows, row_lengths
from ..numerics.tolerances import ACCURACY
from .derivation import Equations
from .numeric import NumericEquations


@dataclass(frozen=True)
class Jump:
    """Velocities just after an impact, and its impulses.

    Attributes
    ----------
    v : numpy.ndarray
        Velocities (n,).
    impulses : numpy.ndarray
        Multipliers Λ of the rows (k,); zero for dependent ones.
    left_over : numpy.ndarray
        Amounts ``J v⁺ - b`` by which the rows are missed (k,): rounding, unless rows contradict each other.
    contradiction : numpy.ndarray
        Amounts with the misses spread over all rows that contradict each other (k,).
    dependent : tuple of int
        Rows that others imply.
    """

    v: np.ndarray
    impulses: np.ndarray
    left_over: np.ndarray
    contradiction: np.ndarray
    dependent: tuple[int, ...]


def jump(
    numeric: NumericEquations, jacobian: np.ndarray, right: np.ndarray, v: np.ndarray, z: np.ndarray | None = None
) -> Jump:
    """Solve ``M (v⁺ - v⁻) + J^T Λ = 0``, ``J v⁺ = b``, also if J has dependent rows or M zeros on its diagonal.

    Of rows that depend on each other the first ones bear the impulses.

    Parameters
    ----------
    numeric : NumericEquations
        Equations with M and the sizes of the coordinates.
    jacobian, right : numpy.ndarray
        Rows J (k, n) and right sides b (k,).
    v : numpy.ndarray
        Velocities before (n,).
    z : numpy.ndarray, optional
        First-order states, for masses that change with them; by default their own values.

    References
    ----------
    Haug 1989, section 6.6; Pfeiffer and Glocker, *Multibody Dynamics with Unilateral Contacts*, 1996, chapter 6.
    """
    system = _ImpulseSystem(numeric, jacobian, z)
    step, impulses = system.solve(np.zeros((v.size, 1)), (right - jacobian @ v)[:, None])
    after, impulses, dependent = v + step[:, 0], impulses[:, 0], system.dependent
    left_over = jacobian @ after - right
    spread = left_over - jacobian @ least_norm(jacobian, left_over, threshold=ACCURACY) if dependent else left_over
    return Jump(after, impulses, left_over, spread, tuple(dependent))


def impulse_response(
    numeric: NumericEquations, jacobian: np.ndarray, rows: np.ndarray, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return ``Δv`` (n, k) and Λ (m, k) by unit impulses along rows g (k, n): ``M Δv + J^T Λ = g^T``, ``J Δv = 0``."""
    return _ImpulseSystem(numeric, jacobian, z).solve(rows.T, np.zeros((len(jacobian), len(rows))))


class _ImpulseSystem:
    """``M Δv + J^T Λ = P``, ``J Δv = b``, of which the first of dependent rows bear the impulses."""

    def __init__(self, numeric: NumericEquations, jacobian: np.ndarray, z: np.ndarray | None):
        # in these units masses and rows are near one, whatever the size of the mechanism
        self._sizes, self._unit = numeric.column_scale, numeric.largest_mass
        self._lengths = row_lengths(jacobian * self._sizes)
        rows = jacobian * self._sizes / self._lengths[:, None]
        self.dependent = dependent_rows(rows)
        self._kept = [k for k in range(len(rows)) if k not in set(self.dependent)]
        independent, zero = rows[self._kept], np.zeros((len(self._kept), len(self._kept)))
        mass = np.diag(numeric.eom.masses(numeric.p, z) * self._sizes**2 / self._unit)
        self._matrix = np.block([[mass, independent.T], [independent, zero]])

    def solve(self, impulses: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ``Δv`` (n, k) and Λ (m, k) of impulses P (n, k) and right sides b (m, k)."""
        n, kept, unit = len(impulses), self._kept, self._unit
        lengths = self._lengths[kept, None]
        given = np.vstack([impulses * self._sizes[:, None] / unit, right[kept] / lengths])
        step = least_norm(self._matrix, given, threshold=ACCURACY)
        responses = np.zeros(right.shape)
        responses[kept] = unit * step[n:] / lengths
        return self._sizes[:, None] * step[:n], responses


class ImpactLaw:
    """The law by which velocities jump into a mechanism: impulses of its joints, as expressions.

    ``M (v⁺ - v⁻) + J^T Λ = 0``, ``J v⁺ = b``; J has the rows of the mechanism, for
    which ``b = nu``, and those of joints that act only at the instant, for
    which Newton's restitution gives ``Phi_q v⁺ - nu = -e (Phi_q v⁻ - nu)``.

    Parameters
    ----------
    eom : Equations
        Equations of the mechanism that holds afterwards.
    restitution : mapping of joint to float, optional
        Joints that act only at the instant, with their coefficients e.

    Attributes
    ----------
    v_before : casadi.SX
        Velocities v⁻ (n,), symbols.
    impulses : casadi.SX
        Λ (k,): symbols of the joints of the mechanism, then of those of the instant alone.
    jacobian, right : casadi.SX
        J (k, n) and b (k,); b contains v⁻ if there is restitution.
    row_names : tuple of str
        Names of the rows.

    Raises
    ------
    ModelError
        If a joint of the instant is attached to a body that the mechanism does not have.
    """

    def __init__(self, eom: Equations, restitution: Mapping[Any, float] | None = None):
        self.eom, self.restitution = eom, dict(restitution or {})
        self._refuse_foreign()
        self.v_before = ca.SX.sym("v_before", eom.v.numel())
        none = ca.SX(0, 1)
        #: position rows of the joints that act only at the instant
        self.momentary = ca.vertcat(none, *[joint.rows for joint in self.restitution])
        slopes = ca.jacobian(self.momentary, eom.q)
        rest = -ca.jacobian(self.momentary, eom.t)
        sizes = [joint.rows.numel() for joint in self.restitution]
        e = ca.DM([value for value, k in zip(self.restitution.values(), sizes, strict=True) for _ in range(k)])
        self.jacobian = ca.vertcat(eom.Phi_q, slopes)
        self.right = ca.vertcat(eom.nu, rest - e * (slopes @ self.v_before - rest)) if sizes else eom.nu
        elements = [*dict.fromkeys(eom.row_elements), *self.restitution]
        self.impulses = ca.vertcat(none, *[impulses_of(element) for element in elements])
        names = tuple(name for joint in self.restitution for name in joint.row_names)
        self.row_names = (*eom.row_names, *names)
        #: position rows that hold at the instant, those of the mechanism first, and their names
        self.positions = ca.vertcat(eom.Phi, self.momentary)
        self.position_names = (*eom.position_names, *names)

    def _refuse_foreign(self) -> None:
        eom = self.eom
        known = {symbol.element_hash() for part in (eom.t, eom.q, eom.p) for symbol in ca.vertsplit(part)}
        for joint in self.restitution:
            if joint.velocity_rows.numel():
                raise ModelError(f"restitution: {joint.description} has rows at velocity level, which do not close")
            if joint in self.eom.mechanism.constraints:
                kind = "driver" if joint in self.eom.mechanism.drivers else "joint"
                raise ModelError(
                    f"restitution: {joint.description} is a {kind} of the mechanism itself; restitution is for joints "
                    "that act only at the instant of the impact"
                )
            for body in joint.bodies:
                if not body.is_ground and body not in self.eom.mechanism.bodies:
                    raise ModelError(f"restitution: {joint.description} acts on '{body.name}', which is not there")
            for symbol in symbols_of(joint.rows):
                if symbol.element_hash() not in known:
                    raise ExpressionError(
                        f"restitution: {joint.description} uses {describe(symbol)}, which is not among the coordinates "
                        "and parameters of the mechanism that follows; list parameters in its parameters="
                    )

    @property
    def momentum(self) -> ca.SX:
        """``M (v⁺ - v⁻) + J^T Λ`` (n,), in ``v``, `v_before` and `impulses`, with friction of what slides."""
        eom = self.eom
        sliding = [k for k, element in enumerate(eom.row_elements) if isinstance(element, ActiveRows)]
        friction = ca.jacobian(eom.Q, eom.lam[sliding]) @ self.impulses[sliding] if sliding else 0
        return eom.mass_diagonal * (eom.v - self.v_before) + self.jacobian.T @ self.impulses - friction

    @property
    def velocity(self) -> ca.SX:
        """``J v⁺ - b`` (k,)."""
        return self.jacobian @ self.eom.v - self.right

    def by_joint(self, impulses: np.ndarray) -> dict[Any, np.ndarray]:
        """Return impulses by joint, from those of all rows (k,)."""
        return _split([*dict.fromkeys(self.eom.row_elements), *self.restitution], impulses)

    def solve(self, numeric: NumericEquations, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> Jump:
        """Return the velocities just after the impact at a pose.

        Parameters
        ----------
        numeric : NumericEquations
            The equations at values of their parameters.
        t : float
            Time, s.
        q, v : numpy.ndarray
            Pose, and velocities just before (n,).
        z : numpy.ndarray
            First-order states (k,).
        """
        eom = self.eom
        key = ("impact", *((joint, float(e)) for joint, e in self.restitution.items()))
        function = eom.mechanism.cache.get_or_create(
            key,
            lambda: ca.Function(
                "impact",
                [eom.t, eom.q, self.v_before, eom.z, eom.p],
                [ca.densify(self.jacobian), ca.densify(self.right)],
            ),
        )
        jacobian, right = (part.full() for part in function(t, q, v, z, numeric.p))
        return jump(numeric, jacobian, right.ravel(), v, z)


def impulses_of(element: Any) -> ca.SX:
    """Return the symbols of the impulses of a constraint; new ones for an element of a user that has none."""
    symbols = getattr(element, "impulses", None)
    return ca.SX.sym(f"{element.name}.impulse", element.multipliers.numel()) if symbols is None else symbols


def by_element(eom: Equations, impulses: np.ndarray) -> dict[Any, np.ndarray]:
    """Return impulses by constraint of a mechanism, from those of its rows (m,)."""
    return _split(dict.fromkeys(eom.row_elements), impulses)


def _split(elements: Iterable[Any], impulses: np.ndarray) -> dict[Any, np.ndarray]:
    ends = np.cumsum([element.multipliers.numel() for element in elements])
    return dict(zip(elements, np.split(impulses, ends), strict=False))
