"""What linear inequalities tell of a problem of contact and friction of which not all places are decided yet."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ...numerics.least_squares import largest, least_distance
from ...numerics.tolerances import MET, RANK
from .friction_modes import SENSE
from .spots import Spot, is_pulled


class Relaxation:
    """``rates = c + D forces`` with what the laws of contact and friction say of every choice that is left.

    A place with the options S has ``N >= 0`` and ``w >= w_0`` with its rate w, ``w = w_0`` if it cannot open, ``|F| <=
    μ N``, ``F = -μ N sgn v`` if it only slides one way; and so on. If these have no solution, no choice has one.

    Parameters
    ----------
    cosines : numpy.ndarray
        D with rows and columns of unit size (r, r).
    constant : numpy.ndarray
        c in the same units (r,).
    unit : numpy.ndarray
        The sizes (r,).
    spots : sequence of Spot
        The places.
    """

    def __init__(self, cosines: np.ndarray, constant: np.ndarray, unit: np.ndarray, spots: Sequence[Spot]):
        self._cosines, self._unit, self._spots = cosines, unit, spots
        self._size = largest(constant) or 1.0
        self._constant, self._axes = constant / self._size, np.eye(len(constant))

    def allows(self, options: Sequence[Sequence[str]], members: Collection[int]) -> bool:
        """Return False if no choice among the options has a solution, or only those whose rows depend on each other.

        Parameters
        ----------
        options : sequence of sequence of str
            What each place may still be.
        members : collection of int
            Places that stick by the row of another one.
        """
        held, equal, least = list[int](), list[tuple[np.ndarray, float]](), list[tuple[np.ndarray, float]]()
        for k, (spot, own) in enumerate(zip(self._spots, options, strict=True)):
            closes, touching = "open" not in own, [o for o in own if o != "open"]
            if spot.normal is not None:
                self._normal(spot, closes, bool(touching), equal, least)
                held += [spot.normal] if closes else []
            if spot.tangent is not None:
                self._force_along(spot, touching, equal, least)
                if closes and spot.rests:
                    self._rate_along(spot.tangent, touching, equal, least)
                held += [spot.tangent] if own == ["sticks"] and k not in members else []
        if held:
            values = np.linalg.eigvalsh(self._cosines[np.ix_(held, held)])
            if values[0] <= RANK * values[-1]:
                return False
        return self._is_possible(equal, least)

    def _normal(self, spot: Spot, closes: bool, touches: bool, equal: list, least: list) -> None:
        row = spot.normal
        target = spot.target / self._unit[row] / self._size
        if np.isfinite(target):
            (equal if closes else least).append((self._cosines[row], target - self._constant[row]))
        (least if touches else equal).append((self._axes[row], 0.0))

    def _force_along(self, spot: Spot, touching: Sequence[str], equal: list, least: list) -> None:
        """Friction of a place; that under a load which is no normal force is only known to work against sliding."""
        row, senses = (
            spot.tangent,
            [SENSE[o.removeprefix("pulled ")] for o in touching if o.endswith(("forth", "back"))],
        )
        along = self._axes[row]
        if all(o in ("closed", "free") for o in touching):
            equal.append((along, 0.0))
        elif spot.normal is None:
            least += [(-senses[0] * along, 0.0)] if len(touching) == len(senses) == 1 else []
        else:
            normal = self._axes[spot.normal] * self._unit[row] / self._unit[spot.normal]
            if len(touching) == len(senses) == 1:
                coefficient = spot.static if is_pulled(touching[0]) else spot.sliding
                equal.append((along + senses[0] * coefficient * normal, 0.0))
            else:
                most = max(spot.static, spot.sliding)
                least += [(most * normal + along, 0.0), (most * normal - along, 0.0)]

    def _rate_along(self, row: int, touching: Sequence[str], equal: list, least: list) -> None:
        """The rate at which a place that rests begins to slide."""
        if "closed" in touching or "free" in touching:
            return
        senses, rate = {SENSE[o] for o in touching} - {0.0}, self._cosines[row]
        if not senses:
            equal.append((rate, -self._constant[row]))
        elif len(senses) == 1:
            (sense,) = senses
            least.append((sense * rate, -sense * self._constant[row]))

    def _is_possible(self, equal: list, least: list) -> bool:
        """True if equations and inequalities have a solution, but for rounding."""
        count = len(self._constant)
        rows, right = np.reshape([row for row, _ in equal], (-1, count)), np.array([value for _, value in equal])
        turned, values, directions = np.linalg.svd(rows)
        rank = int(np.sum(values > RANK * largest(values)))
        start = directions[:rank].T @ ((turned[:, :rank].T @ right) / values[:rank])
        slack = MET * (1 + largest(start))
        if largest(rows @ start - right) > slack:
            return False
        slopes, sides = np.reshape([row for row, _ in least], (-1, count)), np.array([value for _, value in least])
        missing = sides - slopes @ start - slack
        if np.max(missing, initial=0.0) <= 0:
            return True
        free = directions[rank:].T
        return bool(free.size) and least_distance(slopes @ free, missing) is not None
