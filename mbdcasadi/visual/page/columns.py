"""Quantities over time on their way to a page, and how precisely the page can hold them."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...errors import MechanismError, warn
from ...numerics.tolerances import NEGLIGIBLE
from ...results.trajectory import Trajectory
from ..course import Course
from .packing import Packer

#: Levels of precision: digits of the largest value of a quantity that are right, the tolerance of the drawing,
#: relative to the picture, and the most values that a page holds.
LEVELS = ((2, 5e-4, np.inf), (3, 1e-4, 600_000), (4, 2e-5, 60_000), (5, 1e-5, 40_000), (6, 1e-5, 40_000))
#: Knots of one digit more for each knot: of smooth motions, with polynomials of degree five.
MORE_KNOTS = 10 ** (1 / 6)
#: Tolerance of a number, in units of its last digit.
TOLERANCE = 0.1
#: Tolerance in units of the noise of a quantity, at least.
ABOVE_NOISE = 4.0


@dataclass(eq=False)
class Column:
    """A scalar over time.

    Attributes
    ----------
    expression : casadi.SX
        Its expression.
    name : str
        Its name, for messages.
    unit : str
        Numbers of one unit share a size of rounding errors; "" for a column that is only drawn.
    size : float
        Of a column that is drawn: its value for the length 1 m, or the angle 1 rad.
    optional : bool
        True if it is left out if it is not known.
    index : int
        Its number in the page; -1 if it is not known.
    decimals : int
        Of a number, how many are right.
    """

    expression: ca.SX
    name: str
    unit: str = ""
    size: float = 1.0
    optional: bool = False
    index: int = -1
    decimals: int = 0


class Columns:
    """Columns over a motion, in groups that have common knots: those of one element bend at the same times.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    diagonal : float
        Size of the picture, m.
    """

    def __init__(self, motion: Trajectory, diagonal: float):
        self._motion, self._diagonal = motion, diagonal
        self._groups: dict[Hashable, list[Column]] = {}

    def drawn(self, group: Hashable, expression: Any, name: str, size: float = 1.0) -> Column:
        """Add a coordinate, an angle, or the component of an arrow with its value for the length 1 m."""
        return self._add(group, Column(ca.SX(expression), name, size=size))

    def number(self, group: Hashable, expression: Any, label: str, name: str, optional: bool = False) -> Column:
        """Add a number to be read; its unit follows the last comma of its label."""
        return self._add(group, Column(ca.SX(expression), name, unit=label.rpartition(", ")[2], optional=optional))

    def _add(self, group: Hashable, column: Column) -> Column:
        self._groups.setdefault(group, []).append(column)
        return column

    def packed(self) -> dict[str, Any]:
        """Number all columns and return the data of the page, as precise as a page of a reasonable size can be.

        Numbers that the motion does not know (NaN throughout) are left out.

        Raises
        ------
        MechanismError
            If a quantity is not finite over the whole motion.
        """
        columns = [column for group in self._groups.values() for column in group]
        group_of = np.repeat(np.arange(len(self._groups)), [len(group) for group in self._groups.values()])
        course = Course(self._motion, [ca.vertcat(*[c.expression for c in group]) for group in self._groups.values()])
        start = np.hstack(course.values)
        known = np.array([_is_known(*pair) for pair in zip(columns, start.T, strict=True)], bool)
        sizes = self._sizes(columns, np.where(known, np.abs(start).max(axis=0), 0.0))
        noise = np.nan_to_num(np.hstack(course.noise()))
        kinds, first = _kinds(start, np.where(known, self._tolerances(columns, sizes, noise, *LEVELS[-1][:2]), np.inf))
        course.select([first[group_of[first] == k] - np.sum(group_of < k) for k in range(len(self._groups))])

        def tolerances(digits: int, picture: float) -> list[np.ndarray]:
            finest = np.full(first.size, np.inf)  # of columns that are the same
            moves = kinds >= 0
            np.minimum.at(finest, kinds[moves], self._tolerances(columns, sizes, noise, digits, picture)[moves])
            return [finest[group_of[first] == k] for k in range(len(self._groups))]

        digits, picture, knots = _followed(course, tolerances)
        packer = Packer(course.t, course.resolution)
        packed = [packer.add(*group) for group in zip(knots, course.values, tolerances(digits, picture), strict=True)]
        numbers = [number for group in packed for number in group]
        for k, column in enumerate(columns):
            if known[k]:
                column.index = numbers[kinds[k]] if kinds[k] >= 0 else packer.constant(float(start[0, k]))
                column.decimals = _decimals(sizes[k], noise[k], digits)
        return packer.packed() | {"precision": digits}

    def _sizes(self, columns: list[Column], largest: np.ndarray) -> np.ndarray:
        """Largest size of each column; at least that of a rounding error in its unit."""
        units: dict[str, float] = {}
        for column, value in zip(columns, largest, strict=True):
            units[column.unit] = max(units.get(column.unit, 0.0), float(value))
        noise = {unit: NEGLIGIBLE * size for unit, size in units.items()} | self._noise(units)
        return np.maximum(largest, [noise[column.unit] for column in columns])

    def _noise(self, units: dict[str, float]) -> dict[str, float]:
        """Return rounding errors by unit; a lever turns one unit into another: a couple is compared with forces."""
        length, duration = self._diagonal, float(self._motion.t[-1] - self._motion.t[0])
        force = max(units.get("N", 0.0), units.get("N m", 0.0) / length)
        speed = max(units.get("m/s", 0.0), units.get("rad/s", 0.0) * length, length / duration)
        sizes = {"m": length, "rad": 1.0, "m/s": speed, "rad/s": speed / length, "N": force, "N m": force * length}
        return {unit: NEGLIGIBLE * max(size, units.get(unit, 0.0)) for unit, size in sizes.items()}

    def _tolerances(
        self, columns: list[Column], sizes: np.ndarray, noise: np.ndarray, digits: int, picture: float
    ) -> np.ndarray:
        return np.array([
            TOLERANCE * 10.0 ** -_decimals(size, rough, digits)
            if column.unit
            else max(picture * self._diagonal * column.size, ABOVE_NOISE * rough)
            for column, size, rough in zip(columns, sizes, noise, strict=True)
        ])  # fmt: skip


def _is_known(column: Column, values: np.ndarray) -> bool:
    """Return True for a column with values, False for one that has none and need not."""
    finite = np.isfinite(values)
    if not finite.all() and (finite.any() or not column.optional):
        raise MechanismError(f"animate: {column.name} is not finite over the whole motion")
    return bool(finite.all())


def _decimals(largest: float, noise: float, digits: int) -> int:
    """Decimals that are right, if so many digits of the largest value are, and of the noise none."""
    right = digits - 1 - int(np.floor(np.log10(max(largest, 1e-300))))
    return min(right, int(np.floor(-np.log10(max(ABOVE_NOISE * noise / TOLERANCE, 1e-300)))))


def _kinds(values: np.ndarray, tolerance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Number columns (k,): equal ones alike, and those that rest -1; and the first column of each number."""
    known: dict[bytes, int] = {}
    kinds = np.full(values.shape[1], -1)
    first: list[int] = []
    for k in np.flatnonzero(np.ptp(values, axis=0) > tolerance / 4):
        kinds[k] = known.setdefault(values[:, k].tobytes(), len(known))
        if kinds[k] == len(first):
            first.append(int(k))
    return kinds, np.array(first, int)


def _followed(
    course: Course, tolerances: Callable[[int, float], list[np.ndarray]]
) -> tuple[int, float, list[np.ndarray]]:
    """Digits, tolerance of the drawing, and knots of the finest level that a page can hold."""
    digits, picture = LEVELS[0][:2]
    best = None
    for finer, drawn, most in LEVELS:
        wanted = tolerances(finer, drawn)
        if best is not None and MORE_KNOTS * sum(k.size * w.size for k, w in zip(best[1], wanted, strict=True)) > most:
            break
        knots = course.follow(wanted, most)
        if knots is None:
            break
        best = course.samples, knots, course.rough
        digits, picture = finer, drawn
    if best is None or best[2]:
        warn(
            "animate: the motion changes so often that the page cannot hold it: between its outputs numbers and poses "
            "are rough; animate a part of it, motion.at(times)"
        )
    if best is None:
        return digits, picture, course.chosen(tolerances(digits, picture))
    course.samples = best[0]
    return digits, picture, best[1]
