"""First-order states that keep a memory: their rates vanish at rest, whatever the pose.

A spring in series with a damper, trapped oil or the deflection of a bristle is where the motion has left it. Along the
way from a start the rates are integrated over the pose,

    dζ/ds = W^T z_rate(q(s), dq/ds, z),

which is exact whatever the way and its speed if the rates are those of a function of the pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..model.symbols import Input, Parameter, place_of
from ..numerics.least_squares import largest
from ..numerics.newton import solve
from ..numerics.tolerances import MET

#: Poses of a way, at the points of Chebyshev: polynomials through them are exact to rounding for turns of a radian.
POSES = 17
#: Steps of Newton's method for the states along a way.
STEPS = 30
#: Random values at which rates at rest are looked at, and the share of the largest one that is none.
SAMPLES, NO_RATE = 12, 1e-11


class Memory:
    """Combinations ``W^T z`` of first-order states that remember a motion.

    Parameters
    ----------
    signals : Signals
        Inputs.
    t : float
        Time, s.
    q, z : numpy.ndarray
        Pose and states at the start of the way (n,), (k,).
    unknowns : sequence of Input or Parameter
        What is looked for: a rate that vanishes by its value at the start alone is not one that always does.

    Attributes
    ----------
    directions : numpy.ndarray
        W, with orthonormal columns (k, c); no columns if nothing is remembered.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        t: float,
        q: np.ndarray,
        z: np.ndarray,
        unknowns: Sequence[Input | Parameter] = (),
    ):
        self._numeric, self._t, self._q, self._z = numeric, t, q, z
        eom = numeric.eom
        any_rate = ca.substitute(ca.vertcat(ca.SX(0, 1), eom.z_rate), eom.a, ca.SX.zeros(eom.a.numel()))
        rate = ca.substitute(any_rate, eom.u, ca.SX(signals.at_time(t)))
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.p]
        self._rates = ca.Function("rates", arguments, [ca.densify(rate)])
        self._by_state = ca.Function("by_state", arguments, [ca.densify(ca.jacobian(rate, eom.z))])
        self._by_velocity = ca.Function("by_velocity", arguments, [ca.densify(ca.jacobian(rate, eom.v))])
        self.directions = self._at_rest(any_rate, ca.SX(signals.at_time(t)), unknowns)
        self._points = (1 - np.cos(np.pi * np.arange(POSES) / (POSES - 1))) / 2
        powers = np.polynomial.chebyshev.chebvander(2 * self._points - 1, POSES - 1)
        basis = np.linalg.inv(powers)  # of Lagrange, by the polynomials of Chebyshev
        slopes = 2 * np.polynomial.chebyshev.chebder(basis)
        sums = np.polynomial.chebyshev.chebint(basis, lbnd=-1) / 2
        at = np.polynomial.chebyshev.chebvander(2 * self._points - 1, POSES)
        self._slope, self._sum = at[:, : POSES - 1] @ slopes, at @ sums

    def _at_rest(self, rate: ca.SX, inputs: ca.SX, unknowns: Sequence[Input | Parameter]) -> np.ndarray:
        """Combinations of states whose rates vanish at rest, found in random poses and for random unknowns."""
        numeric, k, eom = self._numeric, self._z.size, self._numeric.eom
        if not k:
            return np.zeros((0, 0))
        for place, symbol in enumerate(eom.mechanism.inputs):
            if place_of(symbol, unknowns) is not None:
                inputs[place] = symbol
        y = ca.vertcat(ca.SX(0, 1), *unknowns)
        free = [place_of(symbol, unknowns) is not None for symbol in eom.mechanism.parameters]
        known = [j for j, is_free in enumerate(free) if not is_free]
        rates_of = ca.Function(
            "rates_at_rest",
            [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.p[known], y],
            [ca.densify(ca.substitute(rate, eom.u, inputs))],
        )
        generator, values = np.random.default_rng(0), []
        for _ in range(SAMPLES + 2 * k):
            q, z, lam = (generator.standard_normal(size) for size in (self._q.size, k, numeric.eom.lam.numel()))
            here = self._q + 0.3 * numeric.scale.coordinates * q, self._z + (1 + np.abs(self._z)) * z
            loads = generator.standard_normal(y.numel())
            at = self._t, here[0], np.zeros(q.size), here[1], lam, numeric.p[known], loads
            values.append(rates_of(*at).full().ravel())
        rates = np.array([row for row in values if np.all(np.isfinite(row))]).reshape(-1, k)
        size = np.max(np.abs(rates), axis=0, initial=0.0)
        scaled = rates / np.where(size > 0, size, 1.0)
        _, singular, right = np.linalg.svd(scaled, full_matrices=True)
        rank = int(np.sum(singular > NO_RATE * max(1.0, largest(singular))))
        found = right[rank:].T / np.where(size > 0, size, 1.0)[:, None]
        directions: np.ndarray = np.linalg.qr(found)[0] if len(rates) else np.zeros((k, 0))
        return directions

    def residual(
        self, q: np.ndarray, z: np.ndarray, lam: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the states are off from what the way to a pose makes of them (k,), and its slopes by pose and states."""
        w = self.directions
        residual = w @ (w.T @ z - self._along([self._q, q], z, lam, p))
        poses = self._poses(self._q, q, z)
        end = np.zeros(q.size) if poses is None else poses @ self._slope[-1]
        slope = self._by_velocity(self._t, q, end, z, lam, p).full()
        return residual, -w @ (w.T @ slope), w @ w.T

    def by_the_way(self, q: np.ndarray, z: np.ndarray, lam: np.ndarray, p: np.ndarray, free: np.ndarray) -> np.ndarray:
        """True for states that another way to a pose, over displacements that are `free`, or another speed changes."""
        straight = self._along([self._q, q], z, lam, p)
        size = float(np.linalg.norm((q - self._q) / self._numeric.scale.coordinates))
        aside = free @ np.random.default_rng(1).standard_normal(free.shape[1])
        aside *= max(size, 1e-3) * self._numeric.scale.length / max(largest(aside), 1e-300)
        others = [
            self._along([self._q, (self._q + q) / 2 + aside, q], z, lam, p),
            self._along([self._q, q], z, lam, p, speed=0.1),
        ]
        change = np.abs(straight - self.directions.T @ self._z)
        differ = np.max(np.abs(np.array(others) - straight), axis=0) > MET * np.maximum(change, size)
        changed: np.ndarray = np.any(np.abs(self.directions[:, differ]) > MET, axis=1)
        return changed

    def _along(
        self, places: list[np.ndarray], z: np.ndarray, lam: np.ndarray, p: np.ndarray, speed: float = 1.0
    ) -> np.ndarray:
        """States of the memory at the end of a way past places (c,), NaN if the constraints do not let it pass."""
        w = self.directions
        memory = w.T @ self._z
        for begin, end in pairwise(places):
            poses = self._poses(begin, end, z)
            if poses is None:
                return np.full(memory.size, np.nan)
            memory = self._integrated(memory, poses, z - w @ (w.T @ z), lam, p, speed)
        return memory

    def _poses(self, begin: np.ndarray, end: np.ndarray, z: np.ndarray) -> np.ndarray | None:
        """Poses on the constraints from one to another (n, POSES)."""
        numeric, poses = self._numeric, begin + np.outer(self._points, end - begin)
        if not numeric.eom.Phi.numel():
            return poses.T
        rows = partial(numeric.position, self._t, z=z)
        found = [solve(rows, q, numeric.weights, sizes=numeric.scale.coordinates, iterations=20) for q in poses]
        return np.array([outcome.x for outcome in found]).T if all(outcome.converged for outcome in found) else None

    def _integrated(
        self, start: np.ndarray, poses: np.ndarray, others: np.ndarray, lam: np.ndarray, p: np.ndarray, speed: float
    ) -> np.ndarray:
        """States of the memory at the end of a way, by collocation and Newton's method."""
        w, count = self.directions, start.size
        velocities = speed * poses @ self._slope.T
        memory = np.repeat(start[:, None], POSES, axis=1)
        for _ in range(STEPS):
            z = others[:, None] + w @ memory
            arguments = [self._t, poses, velocities, z, np.repeat(lam[:, None], POSES, axis=1), p]
            rates = w.T @ self._rates(*arguments).full() / speed
            slopes = self._by_state(*arguments).full().reshape(len(others), POSES, len(others)) / speed
            inner = np.einsum("ka,kjl,lb->jab", w, slopes, w)
            left = memory - start[:, None] - rates @ self._sum.T
            matrix = np.eye(POSES * count).reshape(POSES, count, POSES, count)
            matrix = matrix - np.einsum("ij,jab->iajb", self._sum, inner)
            step = np.linalg.solve(matrix.reshape(POSES * count, -1), left.T.ravel()).reshape(POSES, count).T
            memory = memory - step
            if not np.all(np.isfinite(step)) or largest(step) <= 1e-13 * (1 + largest(memory)):
                break
        return memory[:, -1]
