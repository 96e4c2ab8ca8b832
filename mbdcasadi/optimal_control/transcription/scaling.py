"""Typical sizes of a mechanism and its motion, so that a solver sees numbers near one.

Everything follows from lengths, masses and the duration of the model: in other
units the same problem gives the same numbers to the solver.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.scale import marker_points
from ...model.symbols import Parameter
from ...numerics.tolerances import NEGLIGIBLE

#: Smallest size of a limited quantity, as a share of its changes.
SMALLEST_SHARE = 1e-3
#: Number of states at which the size of an expression is sampled.
SAMPLES = 7
#: Ratio of mean and median of the samples from which an expression is mostly small: a cost in a window of time.
MOSTLY_SMALL = 30.0


@dataclass(frozen=True)
class Scales:
    """Typical sizes, in the units of the model."""

    #: duration, s
    time: float
    #: coordinates and their rates (n,)
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    #: equations of motion, N and N m (n,)
    load: np.ndarray
    #: multipliers, and constraint rows, m or rad (m,)
    lam: np.ndarray
    rows: np.ndarray
    #: first-order states and inputs; zero for an input whose size only the limits of the motion can tell
    z: np.ndarray
    u: np.ndarray
    #: mask of the coordinates that are angles (n,)
    angles: np.ndarray
    #: number of intervals of the mesh: rows of velocities count by their effect on the coordinates in one interval,
    #: those of accelerations and loads likewise
    steps: int = 1

    def of(self, coordinates: list[int], rows: list[int]) -> Scales:
        """Return the sizes for some of the coordinates and of the constraint rows."""
        by_coordinate = {name: getattr(self, name)[coordinates] for name in ("q", "v", "a", "load", "angles")}
        return replace(self, **by_coordinate, lam=self.lam[rows], rows=self.rows[rows])


def scales_of(numeric: NumericEquations, duration: float, poses: np.ndarray) -> Scales:
    """Return sizes from lengths, masses and the duration, s, for poses that the motion may pass (k, n).

    Lengths are typical distances of joint points from centres of mass; angles count as one radian; rates follow with
    the duration, loads with the masses.
    """
    eom = numeric.eom
    q0 = eom.estimate[0]
    angles = eom.angles
    length = _length(numeric, poses)
    q = np.where(angles, 1.0, length)
    masses = np.r_[numeric.mass[~angles], numeric.mass[angles] / length**2]
    mass = float(np.max(masses, initial=0.0)) or 1.0
    force = max(mass * length / duration**2, _load_at_rest(numeric, q0, ~angles))
    load = np.where(angles, force * length, force)
    jacobian = numeric.jacobian(0.0, q0)
    # a row in metres changes by a length with displacements; a row of angles by one with angles alone
    rows = np.max(np.abs(jacobian) * q, axis=1, initial=0.0)
    rows = np.where(rows > 0, rows, np.where(eom.angular_rows, 1.0, length))
    lam = force * length / rows
    v, a = q / duration, q / duration**2
    u, z = _inputs_and_states(numeric, duration, v, load)
    return Scales(duration, q, v, a, load, lam, rows, z, u, angles)


def _length(numeric: NumericEquations, poses: np.ndarray) -> float:
    """Typical length: levers of the joints, distances between the bodies, the ground's points and the poses.

    Failing these that of the mechanism, by its radii of gyration.
    """
    eom = numeric.eom
    points, fixed = marker_points(eom, numeric.p)
    levers = np.linalg.norm(points[~fixed], axis=1)
    bodies = len(eom.mechanism.bodies)
    places = np.vstack([points[fixed], poses[:, : 3 * bodies].reshape(-1, 3)[:, :2]])
    spread = np.ptp(places, axis=0) / 2
    length = float(np.max(np.r_[levers, spread], initial=0.0))
    rounding = NEGLIGIBLE * max(numeric.scale.length, float(np.max(np.abs(places), initial=0.0)))
    return length if length > rounding else numeric.scale.length


def _load_at_rest(numeric: NumericEquations, q0: np.ndarray, translations: np.ndarray) -> float:
    """Largest applied force on a body at the estimated pose, at rest and with the inputs' own values, N."""
    eom = numeric.eom
    n, m = eom.q.numel(), eom.lam.numel()
    zero = np.zeros(n)
    loads = eom.function(eom.Q)(0.0, q0, zero, zero, eom.estimate[2], np.zeros(m), eom.input_values, numeric.p).full()
    forces = np.abs(loads.ravel()[translations])
    return float(np.max(forces[np.isfinite(forces)], initial=0.0))


def _inputs_and_states(
    numeric: NumericEquations, duration: float, v: np.ndarray, load: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sizes of inputs, from the loads that they make or their limits, else zero, and of first-order states."""
    eom = numeric.eom
    q0, v0, z0 = eom.estimate
    at = (0.0, q0, v0, 0 * q0, z0, np.zeros(eom.lam.numel()), eom.input_values, numeric.p)
    by_input = np.abs(eom.function(ca.jacobian(eom.Q, eom.u))(*at).full()) if eom.u.numel() else np.zeros((q0.size, 0))
    u = np.ones(eom.u.numel())
    for k, symbol in enumerate(eom.mechanism.inputs):
        column = by_input[:, k]
        works = np.isfinite(column) & (column > 0)
        needed = float(np.min(load[works] / column[works])) if np.any(works) else np.inf
        limit = max((abs(x) for x in (symbol.lower, symbol.upper) if np.isfinite(x)), default=np.inf)
        size = min(needed, limit if limit > 0 else np.inf)
        u[k] = size if np.isfinite(size) else abs(symbol.value)
    z = np.ones(eom.z.numel())
    for k, symbol in enumerate(eom.mechanism.states):
        span = max((abs(x) for x in (symbol.lower, symbol.upper) if np.isfinite(x)), default=0.0)
        rates = eom.function(ca.jacobian(eom.z_rate[k], ca.vertcat(eom.v, eom.u)))(*at).full().ravel()
        reached = np.abs(rates[np.isfinite(rates)]) @ np.r_[v, u][np.isfinite(rates)] * duration
        z[k] = span or max(abs(symbol.value), float(reached)) or 1.0
    return u, z


def sizes_of_phase(
    numeric: NumericEquations,
    scales: Scales,
    arguments: list[ca.SX],
    extra: Sequence[Parameter],
    limits: Sequence[ca.SX],
) -> Sizes:
    """Return the sizes of expressions; symbols without a size of their own get it from the limits that contain them.

    An input that takes the place of the magnitude of a force in a cost is as large as that force, a free parameter
    that is an upper limit of it as well.
    """
    parameters = np.array([p.typical_size for p in extra])
    sizes = Sizes(numeric, scales, arguments, extra, parameters)
    if np.all(scales.u > 0) and np.all(parameters > 0):
        return sizes

    def completed(known: np.ndarray, symbols: Sequence[ca.SX]) -> np.ndarray:
        pairs = zip(known.tolist(), symbols, strict=True)
        return np.array([size or sizes.beside(symbol, limits) for size, symbol in pairs])

    u = completed(scales.u, ca.vertsplit(numeric.eom.u))
    complete = replace(scales, u=np.where(u > 0, u, 1.0))
    return Sizes(numeric, complete, arguments, extra, completed(parameters, extra))


class Sizes:
    """Sizes of expressions, sampled at states scattered over the typical ones.

    Their arguments are ``t, q, v, a, z, lam, u, u_rate, p``, and the parameters `extra` that the mechanism does not
    have, of the sizes `parameters`, zero if that is not known.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        scales: Scales,
        arguments: list[ca.SX],
        extra: Sequence[Parameter],
        parameters: np.ndarray,
    ):
        random = np.random.default_rng(0)
        self.scales, self.parameters, self._arguments = scales, parameters, arguments
        q0 = numeric.eom.estimate[0]
        widths = [scales.v, scales.a, scales.z, scales.lam, scales.u, scales.u / scales.time]
        columns = [random.uniform(0, scales.time, (1, SAMPLES))]
        columns.append(q0[:, None] + 0.5 * scales.q[:, None] * random.uniform(-1, 1, (q0.size, SAMPLES)))
        columns += [width[:, None] * random.uniform(-1, 1, (width.size, SAMPLES)) for width in widths]
        p_size = np.where(numeric.p == 0, 1.0, np.abs(numeric.p))
        values = np.array([p.value for p in extra])
        # an unknown magnitude is not zero
        spread = np.where(values == 0, parameters, 0.0)[:, None] * random.uniform(0, 1, (values.size, SAMPLES))
        self._values = [*columns, np.tile(numeric.p[:, None], (1, SAMPLES)), values[:, None] + spread]
        time = np.array([scales.time])
        self._steps = np.concatenate([time, scales.q, *widths, p_size, np.where(parameters > 0, parameters, 1.0)])

    def _sampled(self, expression: ca.SX) -> np.ndarray:
        function = ca.Function("size", self._arguments, [ca.densify(expression)])
        return function.map(SAMPLES)(*self._values).full().reshape(expression.size1(), SAMPLES, expression.size2())

    def of_values(self, expression: ca.SX) -> float:
        """Return the typical absolute value of a scalar, the mean of one that is mostly small; 1 if it has none."""
        values = np.abs(self._sampled(expression).ravel())
        values = values[np.isfinite(values)]
        typical, mean = _median(values), float(np.mean(values)) if values.size else 0.0
        return mean if mean > MOSTLY_SMALL * typical else typical

    def of_changes(self, expressions: Sequence[ca.SX]) -> np.ndarray:
        """Return the changes of scalars over the typical sizes of what they depend on; 1 for those without (k,)."""
        if not expressions:
            return np.zeros(0)
        return np.array([_median(row) for row in self._changes(expressions)])

    def _changes(self, expressions: Sequence[ca.SX]) -> np.ndarray:
        """Largest change of scalars by one of their arguments at each sample (k, SAMPLES)."""
        slopes = ca.jacobian(ca.vertcat(*expressions), ca.vertcat(*self._arguments))
        rows, columns = (np.array(part, int) for part in slopes.sparsity().get_triplet())
        sizes = np.abs(self._sampled(ca.vec(slopes.nz[:]))[:, :, 0]) * self._steps[columns, None]
        most = np.zeros((len(expressions), SAMPLES))
        np.maximum.at(most, rows, sizes)
        return most

    def beside(self, symbol: ca.SX, limits: Sequence[ca.SX]) -> float:
        """Return the change of a symbol that makes up for others in a limit; 0 if no limit has both."""
        shared = [limit for limit in limits if ca.depends_on(limit, symbol)]
        if not shared:
            return 0.0
        slopes = np.abs(self._sampled(ca.densify(ca.jacobian(ca.vertcat(*shared), symbol)))[:, :, 0])
        others = self._changes([ca.substitute(limit, symbol, 0) for limit in shared])
        ratios = [np.max(o[s > 0] / s[s > 0], initial=0.0) for o, s in zip(others, slopes, strict=True)]
        return float(max((r for r in ratios if np.isfinite(r)), default=0.0))

    def of_limits(self, expressions: Sequence[ca.SX]) -> np.ndarray:
        """Return sizes of ``quantity - limit``: the limit if it is a number or made of parameters; else as of changes.

        Measured on bearing forces and obstacles: a third of the iterations that
        the size of the changes takes, and far fewer if the quantity is a square.
        """
        changes = self.of_changes(expressions)
        return np.array([self._of_limit(e, change) for e, change in zip(expressions, changes, strict=True)])

    def _of_limit(self, expression: ca.SX, changes: float) -> float:
        if expression.n_dep() != 2 or expression.op() not in (ca.OP_SUB, ca.OP_ADD):
            return changes
        for side in (expression.dep(0), expression.dep(1)):
            if side.is_constant():
                limit = abs(float(side))
            elif not ca.depends_on(side, ca.vertcat(*self._arguments[:-2])):
                limit = abs(float(self._sampled(side).ravel()[0]))
            else:
                continue
            return max(limit, SMALLEST_SHARE * changes) if limit > 0 and np.isfinite(limit) else changes
        return changes


def _median(values: np.ndarray) -> float:
    """Median of the finite values that are not zero; 1 if there are none."""
    usable = np.sort(values[np.isfinite(values) & (values > 0)])
    return float(usable[(usable.size - 1) // 2] + usable[usable.size // 2]) / 2 if usable.size else 1.0
