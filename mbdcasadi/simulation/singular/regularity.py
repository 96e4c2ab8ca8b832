"""Regularity of poses: the smallest pivot of the constraint rows, which falls to zero where a linkage could fold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...equations.derivation import Equations
from ...equations.numeric import NumericEquations
from ...equations.saddle import Saddle
from ...kinematics.singular import describe_singularity
from ...numerics.evaluation import Evaluator
from ...numerics.rank import dependent_rows
from ..path import Path, hermite_poses, hermite_states

#: Fall of the smallest pivot of ``Phi_q W⁻¹ Phi_q^T``, relative to the largest one seen, at which the passage begins.
#: The pivot falls with the square of the distance from the pose: of a parallelogram it is 0.1 rad.
ENTRY = 0.01
#: Turn of a body between two poses at which the pivot is looked at, rad.
PIVOT_TURN = 0.05
#: Fall of the pivot, relative to the largest one seen, from which the poses are looked at closely. As its root changes
#: at some rate, poses that are three times as far apart show such a fall wherever close ones would show an entry.
FALL = 0.1
#: Turn between two of these poses, rad.
COARSE_TURN = 3 * PIVOT_TURN
#: Turn of a body between two times up to which a cubic polynomial gives the poses between them, rad.
POLYNOMIAL_TURN = 1.0
#: Poses between two times of a path, at most.
MOST_POSES = 400


class Regularity:
    """The smallest pivot of the constraint rows, relative to their mean: it falls towards zero near a singular pose.

    Rows are of length one in coordinates scaled to metres, so that poses compare in any mechanism. A run in C looks at
    the same pivot with masses for weights, as it comes at no cost with the factors of its forward dynamics.

    Parameters
    ----------
    q : numpy.ndarray
        A pose that is not singular; rows that depend on others there are left out. As those that are left may come to
        depend on each other in a pose in which all rows together do not, as those in x of parallel cranks, others of
        the same joints are left out, too, and the larger pivot counts.
    t : float
        Its time, s.
    """

    def __init__(self, numeric: NumericEquations, t: float, q: np.ndarray):
        self.numeric = numeric
        eom = numeric.eom
        self.is_needed = eom.has_loops
        if not self.is_needed:
            return
        trees = eom.rows_of_trees  # a part that slides far has rows of long levers, which say nothing of a loop
        choices = {trees}
        if numeric.has_redundant_rows(t, q):
            dependent = dependent_rows(numeric.scale.scaled(numeric.jacobian(t, q)))
            choices = {tuple(sorted({*trees, *rows})) for rows in (dependent, _others_of_elements(eom, dependent))}
        left_out = tuple(sorted(choices))
        self._function = eom.mechanism.cache.get_or_create(
            ("regularity", left_out), lambda: Evaluator(_regularity(eom, left_out))
        )

    def at(self, times: np.ndarray, q: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
        """Smallest relative pivot at poses (k, n), for other values of the parameters if they are given."""
        values = self.numeric.p if p is None else p
        pivots = self._function.rows(times[:, None], q, values, self.numeric.scale.columns)[0].ravel()
        return np.where(np.isfinite(pivots), np.maximum(pivots, 0.0), 0.0)

    def fall(self, times: np.ndarray, q: Any, v: Any, p: Any, between: int) -> Any:
        """Lowest pivot of a motion, relative to its largest one, as an expression; 1 if there are no loops.

        Parameters
        ----------
        times : numpy.ndarray
            Times of the motion (k,), s.
        q, v, p : casadi.MX
            Coordinates and velocities by column (n, k), and parameters.
        between : int
            Parts into which each interval is divided by poses of cubic Hermite polynomials.
        """
        if not self.is_needed:
            return ca.MX(1)
        steps = ca.repmat(ca.DM(np.diff(times)).T, q.size1(), 1)
        all_times, poses = [times], [q]
        for share in np.arange(1, between) / between:
            rest = 1 - share
            slopes = steps * (rest * v[:, :-1] - share * v[:, 1:])
            ends = (1 + 2 * share) * rest**2 * q[:, :-1] + share**2 * (1 + 2 * rest) * q[:, 1:]
            poses.append(ends + share * rest * slopes)
            all_times.append(times[:-1] + share * np.diff(times))
        instants, columns = np.concatenate(all_times), ca.DM(self.numeric.scale.columns)
        of_poses = self._function.function.map(instants.size)
        shared = ca.repmat(p, 1, instants.size), ca.repmat(columns, 1, instants.size)
        pivots = of_poses(ca.DM(instants).T, ca.horzcat(*poses), *shared)
        return ca.mmin(pivots) / ca.mmax(pivots)

    def along(
        self, path: Path, *, largest: float = np.inf, p: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times of a path between which no body turns far, and the smallest relative pivot at them.

        Parameters
        ----------
        largest : float
            Largest pivot that was seen: as long as pivots stay well above its fall, fewer poses are enough.
        p : numpy.ndarray, optional
            Other values of the parameters.
        """
        n = self.numeric.eom.q.numel()
        times, values = np.zeros(0), np.zeros(0)
        for look in (coarse_times, finer_times) if np.isfinite(largest) else (finer_times,):
            times = look(path, self.numeric.eom)
            values = self.at(times, hermite_poses(path, times, n), p)
            if np.min(values) > FALL * max(largest, float(np.max(values))):
                break
        return times, values


def parts_between(poses: np.ndarray, eom: Equations) -> int:
    """Parts into which intervals between poses (k, n) are divided so that no body turns far in one."""
    turn = float(np.max(np.abs(np.diff(poses[:, np.flatnonzero(eom.angles)], axis=0)), initial=0.0))
    return int(np.clip(np.ceil(turn / PIVOT_TURN), 1, MOST_POSES))


def coarse_times(path: Path, eom: Equations) -> np.ndarray:
    """Times of a path with the turn between them by which falls of the pivot are noticed."""
    turned = np.append(0.0, np.cumsum(np.minimum(_turns(path, eom), MOST_POSES * PIVOT_TURN)))
    inside = np.interp(np.arange(COARSE_TURN, turned[-1], COARSE_TURN), turned, path.times)
    return np.concatenate([path.times[:1], inside, path.times[-1:]])


def finer_times(path: Path, eom: Equations) -> np.ndarray:
    """Times of a path between which no body turns far, with its own."""
    parts = np.clip(np.ceil(_turns(path, eom) / PIVOT_TURN), 1, MOST_POSES).astype(int)
    owner, last = np.repeat(np.arange(parts.size), parts), np.cumsum(parts)
    share = 1.0 - (last[owner] - 1 - np.arange(owner.size)) / parts[owner]
    inside = path.times[owner] + share * np.diff(path.times)[owner]
    return np.r_[path.times[0], np.where(share == 1.0, path.times[owner + 1], inside)]


def _turns(path: Path, eom: Equations) -> np.ndarray:
    """Largest turn of a body between two times of a path, rad."""
    turns: np.ndarray = np.abs(np.diff(path.x[:, np.flatnonzero(eom.angles)], axis=0)).max(axis=1, initial=0.0)
    return turns


def turns_far(path: Path, eom: Equations) -> bool:
    """Return True if a body turns so far between two times of a path that a polynomial does not give its poses."""
    return bool(np.max(_turns(path, eom), initial=0.0) > POLYNOMIAL_TURN)


def singular_time(regularity: Regularity, path: Path, p: np.ndarray) -> float | None:
    """Time at which a motion is nearest to a singular pose; None if it is not near to any."""
    if not regularity.is_needed:
        return None
    times, values = regularity.along(path, largest=0.0, p=p)
    k = int(np.argmin(values))
    return float(times[k]) if values[k] < ENTRY * np.max(values) else None


def folding_pose(regularity: Regularity, path: Path, numeric: NumericEquations) -> str | None:
    """Description of a pose of a motion in which the mechanism could fold; None if there is none."""
    time = singular_time(regularity, path, numeric.p)
    if time is None:
        return None
    n = numeric.eom.q.numel()
    pose, _, states = np.split(hermite_states(path, np.array([time]), n)[0], [n, 2 * n])
    rows = ", ".join(describe_singularity(numeric, time, pose, states).rows)
    return f"a pose near t = {time:.3g} s in which {rows} depend on each other and the mechanism could fold"


def _others_of_elements(eom: Equations, rows: Sequence[int]) -> list[int]:
    """In place of each row another one of its element, if there is one that is not among the rows."""
    swapped: list[int] = []
    for row in rows:
        of_element = [k for k, element in enumerate(eom.row_elements) if element is eom.row_elements[row]]
        swapped.append(next((k for k in of_element if k not in rows and k not in swapped), row))
    return swapped


def _regularity(eom: Equations, choices: Sequence[Sequence[int]]) -> ca.Function:
    """``(t, q, p, scale) -> pivot``: the smallest one, of the rows to be left out that leave the largest."""
    columns = ca.SX.sym("scale", eom.q.numel())

    def smallest(left_out: Sequence[int]) -> ca.SX:
        rows = [k for k in range(eom.lam.numel()) if k not in left_out]
        return Saddle(columns**-2, eom.Phi_q[rows, :], eom.angular_rows[rows]).pivot()

    pivot = ca.mmax(ca.vertcat(*[smallest(left_out) for left_out in choices]))
    return ca.Function("regularity", [eom.t, eom.q, eom.p, columns], [pivot])
