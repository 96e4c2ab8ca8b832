"""Check of the steps of an integrator: they must resolve what is smoothed, friction at rest and contacts.

The rate of a smoothed quantity w, as ``tanh(v/v_t)``, is integrated along with
the motion, outside the error test: over each output interval the integral is
made of the same steps as the motion. Where the steps follow w it is ``w_end -
w_start``; where they jump over the smoothing it misses that by the height of
the jump. A contact that is closed between two steps alone leaves no trace in
them; it is found on the path between them (see ``gap_closings``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ...integrators.compiled import IntegrationFailure
from ...numerics.lazy import cached_property
from ...numerics.real import stretches
from ..contact.gap_closings import Closing, GapClosings
from ..contact.watched_terms import SHALLOW, watched_terms
from ..path import Path
from ..stepper import Stepper

#: Share of a smoothed quantity's span that the steps may miss (measured on a belt with v_t = 1e-4 m/s: below 0.07
#: where the motion is as exact as the tolerances, 0.7 to 1 where it is a hundred times less exact than these).
MISSED_SHARE = 0.5
#: Loads below this share of the largest one of a run do not count.
SMALL = 1e-3
#: Difference of a gap's change from that by its rates, relative to the larger one, over which no impact took place.
SMOOTH = 0.1
#: Suspicions that are verified in a run, at most; stops of the integration that does so; and the difference from it,
#: in relative tolerances, that confirms the motion.
VERIFICATIONS, CAREFUL, CONFIRMED = 10, 64, 30.0
#: Contacts of a path at which it is looked for how long passing through would take.
MOST_CONTACTS = 100
#: Share of the way to a contact after which the integrator is started again where its steps went too deep.
BEFORE = 0.95


@dataclass
class _Finding:
    """Stretches in which something was missed: times, shares of the span (or depths, m), and the shortest duration."""

    times: list[float] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)
    duration: float = np.inf

    def add(self, time: float, size: float, duration: float = np.inf) -> None:
        self.times.append(time)
        self.sizes.append(size)
        self.duration = min(self.duration, duration)

    @property
    def when(self) -> str:
        """Times in words."""
        more = len(self.times) - 1
        also = "" if not more else f" and at {more} more instant{'s' if more > 1 else ''}"
        return f"at t = {self.times[0]:.6g} s{also}"


@dataclass(frozen=True, eq=False)
class _Course:
    """Watched quantities at the times of a path.

    Attributes
    ----------
    path : Path
        The path.
    gaps, rates, bounds : numpy.ndarray
        Gaps, their rates, and bounds of these (k, owners).
    smoothed, scales : numpy.ndarray
        Smoothed quantities, and their loads (k, smoothings).
    """

    path: Path
    gaps: np.ndarray
    rates: np.ndarray
    bounds: np.ndarray
    smoothed: np.ndarray
    scales: np.ndarray


class Resolution:
    """Watches over the smoothed elements of a mechanism along a run.

    Parameters
    ----------
    stepper : Stepper
        Method that advances the run, whose short integrations verify suspicions.
    """

    def __init__(self, stepper: Stepper):
        self._stepper = stepper
        self._numeric = numeric = stepper.numeric
        self.terms = terms = watched_terms(numeric.eom)
        self._smoothings, self._owner, self._normal = terms.smoothings, terms.owners, terms.normal
        self._validity = terms.validity
        self._closings = GapClosings(stepper, terms)
        self._last: _Course | None = None
        self._looked_at: tuple[Path, list[Closing]] | None = None
        self._verifications = VERIFICATIONS
        self._blocks: list[tuple[np.ndarray, ...]] = []
        self._passed: dict[int, _Finding] = {}
        self._excesses: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []

    @cached_property
    def _lightest(self) -> float:
        """Smallest mass, kg or kg m²."""
        mass = self._numeric.mass
        return float(np.min(mass[mass > 0], initial=np.inf))

    def first_touch(self, path: Path) -> tuple[float, np.ndarray] | None:
        """First time at which a piece is to end, as a contact closes that its steps did not follow; None if none does.

        The path of a method that runs over a whole piece holds what is interpolated inside long steps: stops then
        lead its steps into a contact that they did not follow. Others find the way from a new start just before it.

        Returns
        -------
        time : float
            s.
        stops : numpy.ndarray
            Times of the next piece that no step may cross, so that the contact is noticed.
        """
        if not self._owner or path.times.size < 2:
            return None
        first = min(self._unseen(path), key=lambda c: c.time, default=None)
        if not path.of_steps:
            impact = min(self._impact_times(path), default=np.inf)
            if first is not None and first.time <= impact:
                return first.time, self._closings.stops(path, first)
            return None if np.isinf(impact) else (impact, np.zeros(0))
        spoiled = self._spoiled(path)
        if first is not None and (spoiled is None or first.time <= spoiled[1].time):
            return first.time, self._closings.stops(path, first)
        if spoiled is None:
            return None
        free, closing = spoiled
        start = float(free.times[0])
        return start + BEFORE * (closing.time - start), self._closings.stops(free, closing)

    def _course(self, path: Path) -> _Course:
        """Watched quantities along a path; those of the last path are kept."""
        if self._last is None or self._last.path is not path:
            table = self.terms.table(path.times, path.x, self._numeric.p)
            gaps = self.terms.gaps(table)
            smoothed = np.split(self.terms.courses(table, gaps[0]), 2, axis=1)
            self._last = _Course(path, *gaps, *smoothed)
        return self._last

    def _unseen(self, path: Path) -> list[Closing]:
        """Gaps that close between the steps of a path alone; those of the last path are kept."""
        if self._looked_at is None or self._looked_at[0] is not path:
            course = self._course(path)
            found = self._closings.unseen(path, (course.gaps, course.rates, course.bounds), self._closed(path))
            self._looked_at = path, found
        return self._looked_at[1]

    def _closed(self, path: Path) -> np.ndarray:
        """For how long the steps found each gap closed, by interval (k, n), s."""
        first = 2 * len(self._smoothings)
        return np.abs(path.integrals[:, first : first + len(self._owner)])

    def _missed_impacts(self, path: Path) -> np.ndarray:
        """True for intervals that begin with an open gap, and whose steps did not follow the force there (k, n)."""
        missed, seen = (part[:, self._normal] for part in self._followed(path))
        return (missed > MISSED_SHARE * seen) & (seen > 0) & (self._course(path).gaps[:-1] > 0)

    def _impact_times(self, path: Path) -> list[float]:
        """Times shortly before outlines meet in an interval whose steps did not follow the force that arose."""
        lengths = np.diff(path.times)
        gaps, rates = self._course(path).gaps, self._course(path).rates
        times = []
        for row, k in np.argwhere(self._missed_impacts(path)):
            bend = (rates[row, k] - rates[row - 1, k]) / lengths[row - 1] if row and gaps[row - 1, k] > 0 else 0.0
            ways = np.roots([bend / 2, rates[row, k], gaps[row, k]])
            ahead = [float(w.real) for w in ways if w.imag == 0 and 0 < w.real < lengths[row]]
            times += [float(path.times[row]) + BEFORE * min(ahead)] if ahead else []
        return times

    def _spoiled(self, path: Path) -> tuple[Path, Closing] | None:
        """First closing in intervals whose steps did not follow the force that arose; None if there is none.

        A long step whose stages jump over the contact may still meet it in the stages of its interpolation, with
        forces at depths that are never reached: the path inside the step is useless. The closing is that of the gap
        on a path with the acceleration before it.

        Returns
        -------
        path : Path
            From the start of the intervals to their end, with constant acceleration.
        closing : Closing
            On that path.
        """
        suspected = self._missed_impacts(path)
        rows = np.flatnonzero(np.any(suspected, axis=1))
        # one long step spoils all the intervals that it spans
        for stretch in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else []:
            length = float(path.times[stretch[-1] + 1] - path.times[stretch[0]])
            free, closings = self._without_contact(path, int(stretch[0]), length)
            closings = [closing for closing in closings if np.any(suspected[stretch, closing.owner])]
            if closings:
                return free, min(closings, key=lambda closing: closing.time)
        return None

    def _without_contact(self, path: Path, first: int, length: float) -> tuple[Path, list[Closing]]:
        """Motion over some time from a time of a path on, with the acceleration there, and gaps that close on it."""
        n = self._numeric.eom.q.numel()
        time, x = path.times[first], path.x[first]
        a, end = self._stepper.outputs.accelerations(path, path.times[first : first + 1])[0], x.copy()
        end[:n] += length * x[n : 2 * n] + length**2 / 2 * a
        end[n : 2 * n] += length * a
        free = Path(np.array([time, time + length]), np.vstack([x, end]), np.zeros((1, 0)))
        known = self.terms.gaps(self.terms.table(free.times, free.x, self._numeric.p))
        return free, self._closings.unseen(free, known, np.zeros((1, len(self._owner))))

    def shortest_contact(self, path: Path) -> float:
        """Time that it takes to pass through what a path meets, if nothing stopped it, s: the shortest one.

        A step that is longer may go through unawares. Infinite if nothing is met, or would not be left again within
        an output interval.
        """
        if not self._owner or path.times.size < 2:
            return np.inf
        met = (self._closed(path) > 0) & (self._course(path).gaps[:-1] > -SHALLOW)
        shortest, length = np.inf, float(np.max(np.diff(path.times)))
        for k in np.flatnonzero(np.any(met, axis=1))[:MOST_CONTACTS]:
            closings = self._without_contact(path, int(k), 2 * length)[1]
            durations = [c.duration for c in closings if met[k, c.owner] and c.duration < length]
            shortest = min([shortest, *durations])
        return shortest

    def note(self, path: Path) -> None:
        """Take note of a piece that counts."""
        if not self.terms.size or path.times.size < 2:
            return
        if self._smoothings:
            missed, seen = self._followed(path)
            self._discard_false_alarms(path, missed, seen)
            self._blocks.append((path.times[1:], np.diff(path.times), missed, seen))
        for closing in filter(lambda closing: self._is_passed(path, closing), self._unseen(path)):
            self._passed.setdefault(closing.owner, _Finding()).add(closing.time, closing.depth, closing.duration)
        if self._validity:
            excess = path.integrals[:, 2 * len(self._smoothings) + len(self._owner) :] / 2
            limits = self.terms.at_limit(self.terms.table(path.times[:1], path.x[:1], self._numeric.p))
            self._excesses.append((path.times, excess, limits))

    def _followed(self, path: Path) -> tuple[np.ndarray, np.ndarray]:
        """By how much the steps of each interval miss the change of what is smoothed, and the size of its load."""
        n = len(self._smoothings)
        course = self._course(path)
        missed = np.abs(np.diff(course.smoothed, axis=0) - path.integrals[:, :n])
        missed[self._open(path)] = 0.0
        size = np.abs(course.scales)
        # over a long step the quadrature of what is never negative may be
        return missed, np.maximum(np.maximum(size[:-1], size[1:]), np.abs(path.integrals[:, n : 2 * n]) / 2)

    def _discard_false_alarms(self, path: Path, missed: np.ndarray, seen: np.ndarray) -> None:
        """Discard misses of normal forces in intervals whose motion small steps confirm.

        The rates are integrated outside the error test: a long step that ends just inside a contact, where its force
        is still small, spoils their integral and not the motion.
        """
        abstol = self._stepper.integrator.tolerances[1]
        matters = missed * np.diff(path.times)[:, None] > abstol * self._lightest
        suspected = matters & (missed > MISSED_SHARE * self.terms.spans * seen)
        for k in np.flatnonzero(np.any(suspected[:, self._normal], axis=1)):
            if self._in_small_steps(path, int(k)) is not None:
                missed[k, self._normal] = 0.0

    def _is_passed(self, path: Path, closing: Closing) -> bool:
        """False for a gap that closes between the outputs by their interpolation alone, and not in small steps."""
        k = int(np.searchsorted(path.times[1:-1], closing.time, side="right"))
        fine = self._in_small_steps(path, k)
        if fine is None:
            return True
        gaps = self.terms.gaps(self.terms.table(fine.times, fine.x, self._numeric.p))
        closings = self._closings.unseen(fine, gaps, np.zeros((CAREFUL, len(self._owner))))
        return any(found.owner == closing.owner for found in closings)

    def _in_small_steps(self, path: Path, k: int) -> Path | None:
        """Motion over an interval in small steps; None if it does not end as on the path, or many were verified."""
        if self._verifications <= 0:
            return None
        reltol = self._stepper.integrator.tolerances[0]
        self._verifications -= 1
        times = np.linspace(path.times[k], path.times[k + 1], CAREFUL + 1)
        try:
            x = np.vstack([path.x[k], self._stepper.states_from(float(times[0]), path.x[k])(times[1:])])
        except IntegrationFailure:
            x = np.full((1, path.x.shape[1]), np.nan)
        if np.max(np.abs(x[-1] - path.x[k + 1])) <= CONFIRMED * reltol * (1 + np.max(np.abs(x[-1]))):
            return Path(times, x, np.zeros((CAREFUL, 0)))
        self._verifications = 0  # there will be a warning anyway
        return None

    def _open(self, path: Path) -> np.ndarray:
        """Intervals in which a contact was open all the time, by its smoothed quantities (k, n).

        There its forces are zero, while a long step that ends in the contact, and would not count for the motion,
        leaves its rate in the integral.
        """
        open_at = np.zeros((path.times.size - 1, len(self._smoothings)), bool)
        if not self._owner:
            return open_at
        lengths = np.diff(path.times)[:, None]
        gaps, rates = self._course(path).gaps, self._course(path).rates
        fastest = np.maximum(np.abs(rates[:-1]), np.abs(rates[1:]))
        # no impact between the ends: the gap changes as its rates say, and does not turn
        smooth = np.abs(np.diff(gaps, axis=0) - lengths * (rates[:-1] + rates[1:]) / 2) <= SMOOTH * lengths * fastest
        turned = (rates[:-1] < 0) & (rates[1:] > 0)
        is_open = (gaps[:-1] > 0) & (gaps[1:] > 0) & smooth & ~turned
        for k, owner in enumerate(self.terms.gap_of):
            if owner is not None:
                open_at[:, k] = is_open[:, owner]
        return open_at

    def sentences(self) -> list[str]:
        """Remarks on a run; one sentence for each element."""
        sentences = self._missed()
        for k, finding in self._passed.items():
            owner = self._owner[k].description
            sentences.setdefault(
                owner,
                f"{owner}: the surfaces pass through each other, {max(finding.sizes):.2g} m deep, between two steps of "
                f"the integrator, which never found them touching, {finding.when}; limit its steps, "
                f"method=mbd.{type(self._stepper.integrator).__name__}(max_step={finding.duration / 3:.1g})",
            )
        return [*sentences.values(), *self._broken_conditions()]

    def _broken_conditions(self) -> Iterator[str]:
        """Messages of validity conditions that the steps of the integrator found broken, with time and size."""
        if not self._validity:
            return
        broken = np.zeros(len(self._validity), bool)
        for _, excesses, _ in self._excesses:
            broken |= np.any(excesses > 0, axis=0)
        for k in np.flatnonzero(broken):
            condition = self._validity[k]
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

    def _missed(self) -> dict[str, str]:
        if not self._blocks:
            return {}
        reltol, abstol = self._stepper.integrator.tolerances
        times, lengths, missed, seen = (np.concatenate(part) for part in zip(*self._blocks, strict=True))
        largest = np.max(seen, axis=0)
        # of a load that comes and goes, what is missed is measured by the largest of the time that it lasts
        spans = self.terms.spans * np.where(self.terms.is_load, _largest_of_episode(seen), seen)
        # a load that could not change a velocity by more than the tolerance does not matter
        matters = missed * lengths[:, None] > abstol * self._lightest
        counts = (seen > SMALL * largest) & (spans > 0) & (matters | ~self.terms.is_load)
        share = np.where(counts, missed / np.where(spans > 0, spans, 1), 0)
        sentences: dict[str, str] = {}
        for element, smoothing, course in zip(self.terms.smoothed, self._smoothings, share.T, strict=True):
            bad = course > MISSED_SHARE
            if not np.any(bad):
                continue
            subject = f"{element.description}: {smoothing.subject}"
            finding = _Finding([float(t) for t in times[bad]], [float(x) for x in course[bad]])
            sentences.setdefault(
                subject,
                f"{subject} was not resolved {finding.when}: the steps of the integrator jump over up to "
                f"{min(max(finding.sizes), 1):.0%} of its change, and the motion from there on may be wrong; tighten "
                f"reltol and abstol (they were {reltol:.0e} and {abstol:.0e}), {smoothing.remedy}",
            )
        return {} if sentences and self._is_prescribed() else sentences

    def _is_prescribed(self) -> bool:
        """True if the constraints leave nothing to integrate, so that no motion goes wrong by what its steps miss."""
        assert self._last is not None
        path, n = self._last.path, self._numeric.eom.q.numel()
        freedoms = self._numeric.rank(float(path.times[-1]), path.x[-1, :n]).null_columns.shape[1]
        return freedoms == 0 and self._numeric.eom.z.numel() == 0


def _largest_of_episode(loads: np.ndarray) -> np.ndarray:
    """For each entry of a column the largest of the uninterrupted stretch of positive ones that it belongs to."""
    largest = np.zeros_like(loads)
    for column, course in zip(largest.T, loads.T, strict=True):
        for run in stretches(course > 0):
            column[run] = np.max(course[run])
    return largest
