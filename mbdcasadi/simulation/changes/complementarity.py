"""Problems of unilateral contact and dry friction: all choices of open, sticking and sliding that meet the laws."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product

import numpy as np

from ...numerics.groups import groups_of
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...numerics.tolerances import MET, RANK
from .events import ROUNDING
from .friction_modes import FRICTION_TOLERANCE, NO_EFFECT, SENSE
from .relaxation import Relaxation
from .spots import Loads, Solution, Spot, is_pulled

#: Difference of a cosine from one below which two places slide together.
TOGETHER = 1e-12
#: Senses as one sees them from the other side.
OPPOSITE = {"forth": "back", "back": "forth", "pulled forth": "pulled back", "pulled back": "pulled forth"}
#: What a spot may be without a sense in which it slides.
NO_SENSE = frozenset({"open", "closed", "free"})
#: Choices that are looked at one by one, which takes less time than leaving some of them out.
FEW = 64
#: Parts of a choice that are looked at for one instant, at most: ten seconds.
CHOICES = 10_000
#: Steps in which loads that are norms of reactions follow the friction that depends on them.
ITERATIONS = 50


class TooManyChoicesError(Exception):
    """There are more choices than are looked at."""


class Complementarity:
    """``rates = c + D forces``, with the laws of contact and friction at some spots.

    Parameters
    ----------
    matrix, constant : numpy.ndarray
        D (r, r), symmetric and positive semidefinite, and c (r,).
    without_joints : numpy.ndarray
        Diagonal of D if no joint held the bodies (r,).
    spots : sequence of Spot
        The places.
    loads : Loads, optional
        Of the spots without a normal row.
    """

    def __init__(
        self,
        matrix: np.ndarray,
        constant: np.ndarray,
        without_joints: np.ndarray,
        spots: Sequence[Spot],
        loads: Loads | None = None,
    ):
        self._d, self._c, self._spots, self._loads = matrix, constant, tuple(spots), loads
        self._without_joints, self._looked = without_joints, 0
        diagonal = np.diag(matrix)
        #: True for rows along which a force moves something
        self._acts = diagonal > NO_EFFECT * without_joints
        self._unit = np.sqrt(np.where(self._acts, diagonal, 1.0))
        self._cosines = matrix / np.outer(self._unit, self._unit)

    def parts(self) -> list[tuple[list[int], list[int]]]:
        """Spots and rows of the parts that do not act on each other, neither by their motion nor by their loads."""
        joined = np.abs(self._cosines) > NO_EFFECT
        for k, spot in enumerate(self._spots):
            own = [row for row in (spot.normal, spot.tangent) if row is not None]
            if self._loads is not None:
                own += np.flatnonzero(self._loads.depend[k]).tolist()
            joined[np.ix_(own, own)] = True
        groups = groups_of(joined)
        of = [spot.tangent if spot.normal is None else spot.normal for spot in self._spots]
        parts = [([k for k, row in enumerate(of) if row in rows], rows) for rows in groups]
        return [(spots, rows) for spots, rows in parts if spots]

    def without_friction(self) -> Complementarity:
        """The problem of the normal rows alone; it has a solution unless no forces at all keep the surfaces apart."""
        spots = [replace(s, tangent=None, options=("closed", "open")) for s in self._spots if s.normal is not None]
        return Complementarity(self._d, self._c, self._without_joints, spots)

    @property
    def may_fall(self) -> bool:
        """True if friction in motion may be below that at rest."""
        return any(spot.static > spot.sliding for spot in self._spots)

    def _options(self, spot: Spot) -> list[str]:
        """What a spot may be: what no force moves is not closed; along a tangent it slides as it must, or it stands."""
        options = list(spot.options)
        if spot.normal is not None and not self._acts[spot.normal]:
            return ["open"]
        if spot.tangent is not None and not self._acts[spot.tangent] and spot.rests:
            rate = self._c[spot.tangent]  # whatever the forces are
            stands = "free" if spot.normal is None else "closed"
            if abs(rate) > FRICTION_TOLERANCE * largest(self._c):
                stands = "forth" if rate > 0 else "back"
            options = list(dict.fromkeys("open" if o == "open" else stands for o in options))
        return options

    def _ratio(self, one: int, other: int) -> float:
        """How fast a spot slides beside another one; zero if they need not slide together."""
        row, own = self._spots[one].tangent, self._spots[other].tangent
        if row is None or own is None or not (self._acts[row] and self._acts[own]):
            return 0.0
        cosine = self._cosines[own, row]
        return float(np.sign(cosine) * self._unit[own] / self._unit[row]) if abs(cosine) > 1 - TOGETHER else 0.0

    @cached_property
    def _pairs(self) -> list[tuple[int, int, float]]:
        """Spots that slide together, and how fast the second one does beside the first."""
        pairs = combinations(range(len(self._spots)), 2)
        return [(j, k, ratio) for j, k in pairs if (ratio := self._ratio(j, k))]

    def _agree(self, statuses: Sequence[str]) -> bool:
        """True if spots that slide together do so, or rest, in one sense."""
        for j, k, ratio in self._pairs:
            one, other = statuses[j], statuses[k]
            if NO_SENSE.isdisjoint((one, other)) and other != (one if ratio > 0 else OPPOSITE.get(one, one)):
                return False
        return True

    def solutions(self) -> list[Solution]:
        """Choices that meet all laws; first those in which most sticks.

        Raises
        ------
        TooManyChoicesError
            If there are too many to be looked at.
        """
        self._looked = 0
        choices = self._choices([self._options(spot) for spot in self._spots])
        found = [solution for choice in choices if (solution := self._solved(choice)) is not None]
        return sorted(found, key=lambda s: (-s.sticking, sum(map(is_pulled, s.statuses))))

    def _choices(self, options: Sequence[Sequence[str]]) -> Iterator[tuple[str, ...]]:
        """Choices that may meet all laws: all if they are few, else what inequalities leave of each place in turn."""
        left = list(options)
        if _number(left) > FEW:
            for k, own in enumerate(left):
                if len(own) > 1:
                    left[k] = [option for option in own if self._allows([*left[:k], [option], *left[k + 1 :]])]
        if _number(left) <= FEW:
            yield from filter(self._agree, product(*left))
            return
        k = min((k for k, own in enumerate(left) if len(own) > 1), key=lambda k: len(left[k]))
        for option in left[k]:
            yield from self._choices([*left[:k], [option], *left[k + 1 :]])

    def _allows(self, options: Sequence[Sequence[str]]) -> bool:
        """False if no choice among options can meet all laws."""
        self._looked += 1
        if self._looked > CHOICES:
            raise TooManyChoicesError
        decided = tuple(own[0] if len(own) == 1 else "open" for own in options)
        members = [member for _, member, _ in self._shares(decided)]
        return self._agree(decided) and self._relaxation.allows(options, members)

    @cached_property
    def _relaxation(self) -> Relaxation:
        return Relaxation(self._cosines, self._c / self._unit, self._unit, self._spots)

    def different(self, one: Solution, other: Solution) -> bool:
        """True if two solutions are different motions."""
        size = np.max(self._terms(one.forces) / self._unit, initial=0.0)
        return bool(largest((one.rates - other.rates) / self._unit) > MET * size)

    def _terms(self, forces: np.ndarray) -> np.ndarray:
        """Sizes of the terms of the rates (r,)."""
        terms: np.ndarray = np.abs(self._c) + np.abs(self._d) @ np.abs(forces)
        return terms

    # --- one choice ------------------------------------------------------------------------------------
    def _solved(self, statuses: tuple[str, ...]) -> Solution | None:
        shares = self._shares(statuses)
        members = {member for _, member, _ in shares}
        statuses = tuple("shares" if k in members else s for k, s in enumerate(statuses))
        forces = self._forces(statuses)
        if forces is None:
            return None
        rates = self._c + self._d @ forces
        loads, _ = self._all_loads(forces)
        wrong = FRICTION_TOLERANCE * self._terms(forces).max(initial=0.0)
        slack = FRICTION_TOLERANCE * loads + ROUNDING * largest(forces)
        limits = np.array([spot.static for spot in self._spots]) * loads
        for leader, member, ratio in shares:
            limits[leader] += abs(ratio) * limits[member]
        final = list(statuses)
        for k, (spot, status) in enumerate(zip(self._spots, statuses, strict=True)):
            if spot.normal is not None:
                if status == "open":
                    parts = rates[spot.normal] - spot.target
                    if parts < -wrong:
                        return None
                    final[k] = "open" if parts > wrong else "idle"
                    continue
                if forces[spot.normal] < -slack[k]:
                    return None
            if spot.tangent is None:
                continue
            if status == "sticks" and not abs(forces[spot.tangent]) <= limits[k] + (
                -slack[k] if spot.clear else slack[k]
            ):
                return None
            if is_pulled(status) and abs(rates[spot.tangent]) > wrong:
                return None
            if SENSE.get(status) and spot.rests:
                onset = SENSE[status] * rates[spot.tangent]
                if onset < -wrong or (onset <= wrong and spot.static > spot.sliding):
                    return None
                if onset <= wrong:
                    final[k] = f"pulled {status}"
        return Solution(tuple(final), forces, rates, shares)

    def _shares(self, statuses: tuple[str, ...]) -> tuple[tuple[int, int, float], ...]:
        """Spots that stick by the row of an earlier one, as they slide together."""
        shares: list[tuple[int, int, float]] = []
        leaders: list[int] = []
        for k, status in enumerate(statuses):
            if status != "sticks":
                continue
            for leader in leaders:
                ratio = self._ratio(leader, k)
                if ratio:
                    shares.append((leader, k, ratio))
                    break
            else:
                leaders.append(k)
        return tuple(shares)

    def _all_loads(self, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Loads of all spots (s,), and their slopes (s, r)."""
        count = len(self._spots)
        values, slopes = (
            (np.zeros(count), np.zeros((count, forces.size))) if self._loads is None else self._loads.at(forces)
        )
        for k, spot in enumerate(self._spots):
            if spot.normal is not None:
                values[k], slopes[k] = forces[spot.normal], 0.0
                slopes[k, spot.normal] = 1.0
        return values, slopes

    def _forces(self, statuses: tuple[str, ...]) -> np.ndarray | None:
        """Forces by row (r,); None if they do not exist, or if rows that hold depend on each other."""
        forces = np.zeros(self._c.size)
        for _ in range(1 if self._loads is None else ITERATIONS):
            matrix, right = self._system(statuses, forces)
            values = np.linalg.svd(matrix, compute_uv=False)
            if values.size and values[-1] <= RANK * values[0]:
                return None
            before, forces = forces, np.linalg.solve(matrix, right) / self._unit
            if self._loads is None or largest(forces - before) <= ROUNDING * largest(forces):
                return forces
        return None

    def _system(self, statuses: tuple[str, ...], at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Equations of the forces times the units of their rows; loads to first order about some forces."""
        loads, slopes = self._all_loads(at)
        constant = loads - slopes @ at
        matrix, right, unit = np.eye(self._c.size), np.zeros(self._c.size), self._unit
        for k, (spot, status) in enumerate(zip(self._spots, statuses, strict=True)):
            if spot.normal is not None and status != "open":
                matrix[spot.normal] = self._cosines[spot.normal]
                right[spot.normal] = (spot.target - self._c[spot.normal]) / unit[spot.normal]
            if status == "sticks":
                matrix[spot.tangent] = self._cosines[spot.tangent]
                right[spot.tangent] = -self._c[spot.tangent] / unit[spot.tangent]
            elif status.endswith(("forth", "back")):
                coefficient = spot.static if is_pulled(status) else spot.sliding
                limit = -SENSE[status.removeprefix("pulled ")] * coefficient * unit[spot.tangent]
                matrix[spot.tangent] -= limit * slopes[k] / unit
                right[spot.tangent] = limit * constant[k]
        return matrix, right


def _number(options: Sequence[Sequence[str]]) -> int:
    """Number of choices."""
    return math.prod(map(len, options))
