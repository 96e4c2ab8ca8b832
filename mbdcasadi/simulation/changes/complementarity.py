"""Small problems of unilateral contact and dry friction: every choice of open, sticking and sliding is looked at."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from ...numerics.groups import groups_of
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...numerics.tolerances import MET, RANK
from .events import ROUNDING
from .friction_modes import FRICTION_TOLERANCE, NO_EFFECT, SENSE

#: Difference of a cosine from one below which two places slide together.
TOGETHER = 1e-12
#: Senses as one sees them from the other side.
OPPOSITE = {"forth": "back", "back": "forth", "pulled forth": "pulled back", "pulled back": "pulled forth"}
#: Steps in which loads that are norms of reactions follow the friction that depends on them.
ITERATIONS = 50


@dataclass(frozen=True, eq=False)
class Spot:
    """One place of the problem.

    Attributes
    ----------
    normal, tangent : int or None
        Its rows.
    options : sequence of str
        ``"open"``, ``"closed"``, ``"sticks"``, ``"forth"``, ``"back"``, ``"free"``: what it may be; ``"pulled forth"``
        and ``"pulled back"`` at its limit at rest, if it is above that in motion.
    sliding, static : float
        Coefficients of friction.
    target : float
        Rate of the normal row of what is closed, which is the least one of what is open.
    rests : bool
        True if it does not slide until then: its rate along the tangent has the sense in which it slides.
    clear : bool
        True if it sticks only below its limit by more than rounding.
    """

    normal: int | None
    tangent: int | None
    options: Sequence[str]
    sliding: float = 0.0
    static: float = 0.0
    target: float = 0.0
    rests: bool = True
    clear: bool = False


@dataclass(frozen=True, eq=False)
class Solution:
    """A choice that meets all laws.

    Attributes
    ----------
    statuses : tuple of str
        By spot; ``"idle"`` of one that is open and does not part; ``"shares"`` of one that sticks by the row of another
        spot; ``"pulled forth"`` and ``"pulled back"`` of one at its limit that does not begin to slide.
    forces, rates : numpy.ndarray
        By row (r,).
    shares : tuple of (int, int, float)
        A spot that sticks, one that shares its friction, and how fast the latter slides beside the former.
    """

    statuses: tuple[str, ...]
    forces: np.ndarray
    rates: np.ndarray
    shares: tuple[tuple[int, int, float], ...]

    @property
    def sticking(self) -> int:
        """Number of spots that rest by friction."""
        return sum(status in ("sticks", "shares") or _is_pulled(status) for status in self.statuses)


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of spots without a normal row, by the forces.

    Attributes
    ----------
    at : callable
        ``forces -> (values (s,), slopes (s, r))``.
    depend : numpy.ndarray of bool
        Loads that depend on the force of a row (s, r).
    """

    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    depend: np.ndarray

    def of(self, spots: Sequence[int], rows: Sequence[int]) -> Loads:
        """Return those of some spots, of which the loads depend on some rows alone."""
        whole = np.zeros(self.depend.shape[1])

        def at(forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            whole[rows] = forces
            values, slopes = self.at(whole)
            return values[spots], slopes[np.ix_(spots, rows)]

        return Loads(at, self.depend[np.ix_(spots, rows)])


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
        self._without_joints = without_joints
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

    def without_pulled(self) -> Complementarity:
        """The problem without what is at its limit at rest above that in motion."""
        spots = [replace(s, options=[o for o in s.options if not _is_pulled(o)]) for s in self._spots]
        return Complementarity(self._d, self._c, self._without_joints, spots, self._loads)

    @property
    def count(self) -> int:
        """Number of choices."""
        return int(np.prod([len(choices) for _, choices in self._together], dtype=float))

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

    @cached_property
    def _together(self) -> list[tuple[list[int], list[tuple[str, ...]]]]:
        """Spots that slide together, and what they may be: in one sense, all or those that are not open."""
        groups: list[list[int]] = []
        for k in range(len(self._spots)):
            group = next((group for group in groups if self._ratio(group[0], k)), None)
            if group is None:
                groups.append([k])
            else:
                group.append(k)
        return [
            (group, [c for c in product(*[self._options(self._spots[k]) for k in group]) if self._agree(group, c)])
            for group in groups
        ]

    def _ratio(self, one: int, other: int) -> float:
        """How fast a spot slides beside another one; zero if they need not slide together."""
        row, own = self._spots[one].tangent, self._spots[other].tangent
        if row is None or own is None or not (self._acts[row] and self._acts[own]):
            return 0.0
        cosine = self._cosines[own, row]
        return float(np.sign(cosine) * self._unit[own] / self._unit[row]) if abs(cosine) > 1 - TOGETHER else 0.0

    def _agree(self, group: Sequence[int], statuses: Sequence[str]) -> bool:
        """True if spots that slide together do so, or rest, in one sense."""
        senses = set[str]()
        for k, status in zip(group, statuses, strict=True):
            if status not in ("open", "closed", "free"):
                senses.add(status if self._ratio(group[0], k) > 0 else OPPOSITE.get(status, status))
        return len(senses) <= 1

    def solutions(self) -> list[Solution]:
        """Choices that meet all laws; first those in which most sticks."""
        found = []
        order = np.argsort([k for members, _ in self._together for k in members])
        for choice in product(*[choices for _, choices in self._together]):
            statuses = [status for part in choice for status in part]
            solution = self._solved(tuple(statuses[k] for k in order))
            if solution is not None:
                found.append(solution)
        return sorted(found, key=lambda s: (-s.sticking, sum(map(_is_pulled, s.statuses))))

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
            if _is_pulled(status) and abs(rates[spot.tangent]) > wrong:
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
                coefficient = spot.static if _is_pulled(status) else spot.sliding
                limit = -SENSE[status.removeprefix("pulled ")] * coefficient * unit[spot.tangent]
                matrix[spot.tangent] -= limit * slopes[k] / unit
                right[spot.tangent] = limit * constant[k]
        return matrix, right


def _is_pulled(status: str) -> bool:
    return status.startswith("pulled")
