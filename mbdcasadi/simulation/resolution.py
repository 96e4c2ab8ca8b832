"""Whether the steps of an integrator resolved what is smoothed: friction at rest, contacts.

The rate of a smoothed quantity w, as ``tanh(v/v_t)``, is integrated along with
the motion, outside the error test: over each output interval the integral is
made of the same steps as the motion. Where the steps follow w it is ``w_end -
w_start``; where they jump over the smoothing it misses that by the height of
the jump. A contact that is closed between two steps alone leaves no trace in
them; it is found on the interpolated path.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

from ..equations import Equations
from ..equations.numeric import NumericEquations
from ..model.mechanism import Mechanism
from ..model.rates import time_derivative
from ..model.validity import Smoothing
from ..results.validity import validity_conditions

#: Share of a smoothed quantity's span that the steps may miss (measured on a belt with v_t = 1e-4 m/s: below 0.07
#: where the motion is as exact as the tolerances, 0.7 to 1 where it is a hundred times less exact than these).
MISSED = 0.5
#: Loads below this share of the largest one of a run do not count.
SMALL = 1e-3
#: Points within an output interval at which gaps are looked at.
POINTS = 9
#: Depth, m, below which outlines that just touch count as apart: rounding and the tolerances of positions.
SHALLOW = 1e-9
#: Ways at the speeds of approach at both ends of an interval, beyond which a gap cannot close within it.
REACH = 2.0
#: Share of the way to a contact after which the integrator is started again where its steps went too deep.
BEFORE = 0.95
#: Depth, as a share of the change of a gap over an interval, from which an interpolated path counts as a touch.
DEPTH = 1e-2


@dataclass
class _Finding:
    """Where something was missed: times, shares of the span (or depths, m), and the shortest time that it lasts."""

    times: list[float] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)
    spell: float = np.inf

    def add(self, time: float, size: float, spell: float = np.inf) -> None:
        self.times.append(time)
        self.sizes.append(size)
        self.spell = min(self.spell, spell)

    @property
    def when(self) -> str:
        """Times in words."""
        more = len(self.times) - 1
        also = "" if not more else f" and at {more} more instant{'s' if more > 1 else ''}"
        return f"at t = {self.times[0]:.6g} s{also}"


@dataclass(frozen=True)
class Path:
    """What an integrator found over a chunk.

    Attributes
    ----------
    times, x : numpy.ndarray
        Start and outputs (k + 1,), (k + 1, n_x).
    integrals : numpy.ndarray
        What was integrated along, by interval (k, n).
    on_constraints : bool
        Whether the states are on the constraints.
    is_regular : bool
        Whether the integrator has seen that no pose on it is near to a singular one.
    """

    times: np.ndarray
    x: np.ndarray
    integrals: np.ndarray
    on_constraints: bool = False
    is_regular: bool = False

    def until(self, time: float) -> Path:
        """The part of it up to a time."""
        count = int(np.searchsorted(self.times, time, side="right"))
        return replace(
            self, times=self.times[:count], x=self.x[:count], integrals=self.integrals[: max(count - 1, 0)]
        )


class Resolution:
    """Watches over the smoothed elements of a mechanism along a run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.

    Attributes
    ----------
    rates : casadi.SX
        What the integrator is to integrate along (n,).
    """

    def __init__(self, numeric: NumericEquations):
        self._numeric = numeric
        eom = numeric.eom
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        elements = eom.mechanism.elements
        offered = [s for element in elements for s in getattr(element, "smoothings", ())]
        unknown = ca.vertcat(eom.a, eom.lam, eom.u)
        self._smoothings: list[Smoothing] = [s for s in offered if not ca.depends_on(s.expression, unknown)]
        self._owner = [e for e in elements if _has_gap(e) and not ca.depends_on(e.gap, unknown)]
        self._gaps = ca.vertcat(ca.SX(0, 1), *[e.gap for e in self._owner])
        courses = ca.vertcat(ca.SX(0, 1), *[s.expression for s in self._smoothings])
        scales = ca.vertcat(ca.SX(0, 1), *[1 if s.scale is None else s.scale for s in self._smoothings])
        self._normal = [next(k for k, s in enumerate(self._smoothings) if s is e.smoothings[0]) for e in self._owner]
        self._spans = np.array([s.span for s in self._smoothings])
        self._is_load = np.array([s.scale is not None for s in self._smoothings], dtype=bool)
        self._lightest = float(np.min(numeric.mass[numeric.mass > 0], initial=np.inf))
        slopes = [time_derivative(courses, eom.mechanism), ca.fabs(time_derivative(scales, eom.mechanism))]
        self._validity = [c for c in validity_conditions(eom.mechanism) if c.between_outputs]
        self.rates = ca.cse(ca.vertcat(*slopes, ca.if_else(self._gaps < 0, 1.0, 0.0), self._excess(eom)))
        if self.rates.numel():
            self._courses = ca.Function("courses", known, [ca.densify(ca.vertcat(courses, scales))])
            self._gaps_at = ca.Function("gaps", known, [ca.densify(self._gaps)])
            approach = ca.vertcat(self._gaps, time_derivative(self._gaps, eom.mechanism))
            self._approach = ca.Function("approach", known, [ca.densify(approach)])
        self._blocks: list[tuple[np.ndarray, ...]] = []
        self._passed: dict[int, _Finding] = {}
        self._excesses: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    def _excess(self, eom: Equations) -> ca.SX:
        """Speeds of what validity conditions report, while these are broken: the integral is twice the excess."""
        margins = ca.vertcat(ca.SX(0, 1), *[c.expression for c in self._validity])
        reported = ca.vertcat(ca.SX(0, 1), *[c.reported for c in self._validity])
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        self._at_limit = ca.Function("at_limit", known, [ca.densify(reported + margins)])
        return ca.if_else(margins < 0, ca.fabs(time_derivative(reported, eom.mechanism)), 0)

    @property
    def has_gaps(self) -> bool:
        """Whether there are outlines that may meet."""
        return bool(self._owner)

    def first_pass(self, chunk: Path) -> float | None:
        """Time at which outlines first meet in a chunk though no step found them closed, or the first went too deep."""
        if not self._owner or chunk.times.size < 2:
            return None
        return min([float(start) for _, start, _, _ in self._passes(chunk)] + self._blows(chunk), default=None)

    def _blows(self, chunk: Path) -> list[float]:
        """Times shortly before outlines meet in an interval whose steps did not follow the force that arose."""
        lengths = np.diff(chunk.times)
        missed, seen = (part[:, self._normal] for part in self._followed(chunk))
        gaps, rates = np.split(self._at(self._approach, chunk.times, chunk.x), 2, axis=1)
        found = []
        for row, k in np.argwhere((missed > MISSED * seen) & (seen > 0) & (gaps[:-1] > 0)):
            bend = (rates[row, k] - rates[row - 1, k]) / lengths[row - 1] if row and gaps[row - 1, k] > 0 else 0.0
            ways = np.roots([bend / 2, rates[row, k], gaps[row, k]])
            ahead = [float(w.real) for w in ways if w.imag == 0 and 0 < w.real < lengths[row]]
            found += [float(chunk.times[row]) + BEFORE * min(ahead)] if ahead else []
        return found

    def note(self, chunk: Path) -> None:
        """Take note of a chunk that counts."""
        if not self.rates.numel() or chunk.times.size < 2:
            return
        if self._smoothings:
            self._blocks.append((chunk.times[1:], np.diff(chunk.times), *self._followed(chunk)))
        for k, start, depth, spell in self._passes(chunk) if self._owner else ():
            self._passed.setdefault(k, _Finding()).add(start, depth, spell)
        if self._validity:
            excess = chunk.integrals[:, 2 * len(self._smoothings) + len(self._owner) :] / 2
            limits = self._at(self._at_limit, chunk.times[:1], chunk.x[:1])
            self._excesses.append((chunk.times, excess, limits))

    def _followed(self, chunk: Path) -> tuple[np.ndarray, np.ndarray]:
        """By how much the steps of each interval miss the change of what is smoothed, and the size of its load."""
        n = len(self._smoothings)
        courses = self._at(self._courses, chunk.times, chunk.x)
        missed = np.abs(np.diff(courses[:, :n], axis=0) - chunk.integrals[:, :n])
        size = np.abs(courses[:, n:])
        return missed, np.maximum(np.maximum(size[:-1], size[1:]), chunk.integrals[:, n : 2 * n] / 2)

    def _at(self, function: ca.Function, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        n = self._numeric.eom.q.numel()
        q, v, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
        return function(times[None, :], q.T, v.T, z.T, self._numeric.p).full().T

    def _passes(self, chunk: Path) -> Iterator[tuple[int, float, float, float]]:
        """Outlines that meet on the interpolated path, though never at a step: gap, time, depth, for how long."""
        lengths, n = np.diff(chunk.times), len(self._owner)
        first = 2 * len(self._smoothings)
        closed = np.abs(chunk.integrals[:, first : first + n])
        knots = self._at(self._approach, chunk.times, chunk.x)
        gaps, speeds = knots[:, :n], np.abs(knots[:, n:])
        within = REACH * lengths[:, None] * np.maximum(speeds[:-1], speeds[1:])
        near = (np.minimum(gaps[:-1], gaps[1:]) <= within) & (closed < DEPTH * lengths[:, None])
        rows = np.flatnonzero(np.any(near, axis=1))
        if not rows.size:
            return
        share = np.linspace(0, 1, POINTS + 2)
        between = chunk.times[rows, None] + lengths[rows, None] * share
        path = _interpolated(lengths[rows], chunk.x[rows], chunk.x[rows + 1], self._numeric.eom.q.numel(), share)
        gaps = self._at(self._gaps_at, between.ravel(), path).reshape(*between.shape, -1)
        depth, inside = -np.min(gaps, axis=1), gaps < 0
        spell = np.mean(inside, axis=1) * lengths[rows, None]
        way = np.max(gaps, axis=1) - np.min(gaps, axis=1)
        for row, k in np.argwhere((depth > DEPTH * way) & (depth > SHALLOW) & (closed[rows] < DEPTH * spell)):
            entry = max(int(np.argmax(inside[row, :, k])) - 1, 0)
            yield int(k), float(between[row, entry]), float(depth[row, k]), float(spell[row, k])

    def sentences(self, reltol: float, abstol: float) -> list[str]:
        """What is to be told after a run, with the tolerances of the integrator; one sentence for each element."""
        found = self._missed(reltol, abstol)
        for k, finding in self._passed.items():
            owner = self._owner[k].description
            found.setdefault(
                owner,
                f"{owner}: the surfaces pass through each other, {max(finding.sizes):.2g} m deep, between two steps of "
                f"the integrator, which never found them touching, {finding.when}; limit the steps of IDAS, "
                f"options={{'max_step_size': {finding.spell / 3:.1g}}}",
            )
        return [*found.values(), *self._broken_conditions()]

    def _broken_conditions(self) -> Iterator[str]:
        """Messages of validity conditions that the steps of the integrator found broken, with time and size."""
        for k, condition in enumerate(self._validity):
            first, worst, total = None, -np.inf, 0.0
            for times, excesses, limits in self._excesses:
                for start, excess in zip(times[:-1], excesses[:, k], strict=True):
                    # what goes on over several intervals is one
                    total = total + excess if excess > 0 else 0.0
                    if total > 0:
                        first, worst = start if first is None else first, max(worst, limits[0, k] + total)
            if first is not None:
                unit = f" {condition.unit}" if condition.unit else ""
                yield f"{condition.message} (first at t = {first:.6g} s, at worst {worst:.3g}{unit})"

    def _missed(self, reltol: float, abstol: float) -> dict[str, str]:
        if not self._blocks:
            return {}
        times, lengths, missed, seen = (np.concatenate(part) for part in zip(*self._blocks, strict=True))
        largest = np.max(seen, axis=0)
        spans = self._spans * seen
        # a load that could not change a velocity by more than the tolerance does not matter
        matters = missed * lengths[:, None] > abstol * self._lightest
        counts = (seen > SMALL * largest) & (spans > 0) & (matters | ~self._is_load)
        share = np.where(counts, missed / np.where(spans > 0, spans, 1), 0)
        found: dict[str, str] = {}
        for smoothing, course in zip(self._smoothings, share.T, strict=True):
            bad = course > MISSED
            if not np.any(bad):
                continue
            finding = _Finding([float(t) for t in times[bad]], [float(x) for x in course[bad]])
            found.setdefault(
                smoothing.subject,
                f"{smoothing.subject} was not resolved {finding.when}: the steps of the integrator jump over up to "
                f"{min(max(finding.sizes), 1):.0%} of its change, and the motion from there on may be wrong; tighten "
                f"reltol and abstol (they were {reltol:.0e} and {abstol:.0e}), {smoothing.remedy}",
            )
        return found


def has_gaps(mechanism: Mechanism) -> bool:
    """Whether a mechanism has contacts or stops, which an integrator may jump over."""
    return any(_has_gap(element) for element in mechanism.elements)


def _has_gap(element: Any) -> bool:
    return hasattr(element, "gap") and bool(getattr(element, "smoothings", ()))


def hermite_states(path: Path, times: np.ndarray, n: int) -> np.ndarray:
    """States of a path at other times (k, n_x): coordinates by cubic Hermite polynomials, the rest linearly.

    Parameters
    ----------
    n : int
        Number of coordinates.
    """
    k = np.clip(np.searchsorted(path.times, times, side="right") - 1, 0, path.times.size - 2)
    h = (path.times[k + 1] - path.times[k])[:, None]
    s, begin, end = (times - path.times[k])[:, None] / h, path.x[k], path.x[k + 1]
    q0, q1, v0, v1 = begin[:, :n], end[:, :n], h * begin[:, n : 2 * n], h * end[:, n : 2 * n]
    q = q0 + s * (v0 + s * (3 * (q1 - q0) - 2 * v0 - v1 + s * (v0 + v1 - 2 * (q1 - q0))))
    return np.hstack([q, begin[:, n:] + s * (end - begin)[:, n:]])


def _interpolated(lengths: np.ndarray, begin: np.ndarray, end: np.ndarray, n: int, share: np.ndarray) -> np.ndarray:
    """States on the cubic Hermite path from one output to the next, at shares of each interval, by row."""
    h, s = lengths[:, None, None], share[None, :, None]
    q0, q1, v0, v1 = begin[:, None, :n], end[:, None, :n], begin[:, None, n : 2 * n], end[:, None, n : 2 * n]
    q = (1 + 2 * s) * (1 - s) ** 2 * q0 + s * (1 - s) ** 2 * h * v0 + s**2 * (3 - 2 * s) * q1 - s**2 * (1 - s) * h * v1
    rest = (1 - s) * begin[:, None, n:] + s * end[:, None, n:]
    return np.concatenate([q, rest], axis=2).reshape(-1, begin.shape[1])
