"""Residuals of all positions at many starts, and steps of least squares with the poses of each position eliminated."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..equations.batches import Values, batches_of
from ..numerics.symbolic import symbolic
from .eliminated import Rows
from .points import PointFunction
from .positions import Positions

#: Damping of the normal equations, as a share of their trace: it alone keeps singular ones solvable.
LEAST_DAMPING = 1e-14
#: Longest step of a coordinate of a pose in one iteration, rad or lengths of the drawing: beyond, angles wind up.
POSE_STEP = 1.0
#: Distance of two joints of a body, as a share of the largest one, below which they coincide.
COINCIDENT = 1e-5
#: Newton steps by which a pose is found at given dimensions.
POSE_STEPS = 30


@dataclass(frozen=True, eq=False)
class Block:
    """Positions whose residuals differ in numbers alone.

    Attributes
    ----------
    step, pose, rows : PointFunction
        Of a pose, the unknowns, the numbers and the damping: the reduced normal equations, and the step of the pose
        by those of the unknowns; the sum of squares and the step of the pose alone; and the rows with their slopes.
    numbers, values : numpy.ndarray
        The positions, and the numbers of each.
    """

    step: PointFunction
    pose: PointFunction
    rows: PointFunction
    numbers: np.ndarray
    values: np.ndarray


class Residuals:
    """Residuals of all positions for many starts, with poses ``(starts, positions, k)`` and unknowns ``(starts, n)``.

    It holds numbers and compiled functions alone, and may be sent to other processes.
    """

    @symbolic
    def __init__(self, positions: Positions):
        self.n, self.k, self.count = positions.p.numel(), positions.y.numel(), len(positions.residuals)
        self.sizes = positions.sizes
        eom, values = positions.eom, Values(positions.eom)
        numbers = {p.element_hash(): k for k, p in enumerate(ca.vertsplit(eom.p))}
        unknown_places = [numbers[p.element_hash()] for p in positions.unknowns]
        coordinates = positions.reduced.independent
        places = [*(values.start("q") + i for i in coordinates), *(values.start("p") + i for i in unknown_places)]
        symbol_of = dict(zip(places, ca.vertsplit(ca.vertcat(positions.y, positions.p)), strict=True))
        self._blocks = list[Block]()
        for batch in batches_of(eom, values, positions.residuals, lambda column: [column]):
            for row in np.unique(batch.places, axis=0):
                chosen = np.flatnonzero((batch.places == row).all(axis=1))
                symbols = ca.vertcat(ca.SX(0, 1), *[symbol_of[int(place)] for place in row])
                column = ca.substitute(batch.parts[0], batch.symbols, symbols)
                functions = _functions(column, positions.y, positions.p, batch.parameters)
                self._blocks.append(Block(**functions, numbers=batch.numbers[chosen], values=batch.constants[chosen]))
        fixed = ca.vertcat(positions.fixed, ca.fmax(positions.limits, 0))
        self.m = fixed.numel()
        result = ca.vertcat(fixed, ca.vec(ca.jacobian(fixed, positions.p)))
        self._fixed = PointFunction(ca.Function("synthesis_fixed", [positions.p], [ca.densify(result)]))
        spans = positions.spans
        self._spans = PointFunction(ca.Function("synthesis_spans", [positions.p], [spans])) if spans.numel() else None

    def only(self, chosen: list[int]) -> Residuals:
        """The residuals of some positions alone."""
        other = copy(self)
        other.count, other._blocks = len(chosen), []
        for block in self._blocks:
            inside = [k for k, number in enumerate(block.numbers.tolist()) if number in chosen]
            if inside:
                numbers = np.array([chosen.index(int(block.numbers[k])) for k in inside])
                other._blocks.append(replace(block, numbers=numbers, values=block.values[inside]))
        return other

    def degenerate(self, p: np.ndarray) -> np.ndarray:
        """True where joints of a body coincide (starts,)."""
        return ~(self.shortest(p) > COINCIDENT)

    def shortest(self, p: np.ndarray) -> np.ndarray:
        """Least distance of two joints of a body, as a share of the largest one (starts,)."""
        if self._spans is None:
            return np.ones(len(p))
        spans = self._spans(p[:, None])[1][:, 0]
        least: np.ndarray = np.min(spans, axis=1) / np.max(spans, axis=1)
        return least

    def _called(
        self, function: str, block: Block, y: np.ndarray, p: np.ndarray, damping: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        found: tuple[np.ndarray, np.ndarray] = getattr(block, function)(
            y[:, block.numbers], p[:, None], block.values[None], damping[:, None, None]
        )
        return found

    def fixed(self, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals of conditions and of limits that are passed (starts, m), and their slopes (starts, m, n)."""
        starts = len(p)
        if not self.m:
            return np.zeros((starts, 0)), np.zeros((starts, 0, self.n))
        found = self._fixed(p[:, None])[1][:, 0]
        return found[:, : self.m], found[:, self.m :].reshape(starts, self.n, self.m).transpose(0, 2, 1)

    def settled(self, y: np.ndarray, p: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Poses after some Newton steps of their own, each kept only if it comes nearer, and sums of squares."""
        y, value = self.settled_each(y, p, steps)
        return y, value.sum(axis=1) + np.sum(self.fixed(p)[0] ** 2, axis=1)

    def settled_each(self, y: np.ndarray, p: np.ndarray, steps: int = POSE_STEPS) -> tuple[np.ndarray, np.ndarray]:
        """The same with the sum of squares of each position (starts, positions)."""
        y = y.copy()
        value, move = self._poses(y, p)
        for _ in range(steps):
            trial = y + np.clip(move, -POSE_STEP, POSE_STEP)
            there, then = self._poses(trial, p)
            nearer = there < value
            y[nearer], value[nearer], move[nearer] = trial[nearer], there[nearer], then[nearer]
            move[~nearer] *= 0.25
        return y, value

    def _poses(self, y: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, move = np.empty(y.shape[:2]), np.empty(y.shape)
        for block in self._blocks:
            _, found = self._called("pose", block, y, p, np.zeros(len(p)))
            value[:, block.numbers], move[:, block.numbers] = found[..., 0], found[..., 1:]
        return value, move

    def step(self, y: np.ndarray, p: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Damped Gauss-Newton step of poses (starts, positions, k) and unknowns (starts, n)."""
        n, k, starts, sizes = self.n, self.k, len(p), self.sizes
        residual, slopes = self.fixed(p)
        matrix = slopes.transpose(0, 2, 1) @ slopes
        right = (residual[:, None] @ slopes)[:, 0]
        moves = np.empty((starts, self.count, k, 1 + n))
        for block in self._blocks:
            sums, found = self._called("step", block, y, p, damping)
            matrix += sums[:, : n * n].reshape(starts, n, n)
            right += sums[:, n * n :]
            moves[:, block.numbers] = found.reshape(starts, -1, k, 1 + n)
        matrix, right = sizes[:, None] * matrix * sizes, sizes * right
        trace = np.trace(matrix, axis1=1, axis2=2)
        matrix += (damping * trace / n + LEAST_DAMPING * trace + np.finfo(float).tiny)[:, None, None] * np.eye(n)
        matrix[~np.isfinite(matrix).all(axis=(1, 2))] = np.eye(n)
        dp = -sizes * np.linalg.solve(matrix, np.nan_to_num(right)[..., None])[..., 0]
        both = np.hstack([np.ones((starts, 1)), dp])
        return (moves.reshape(starts, -1, 1 + n) @ both[..., None]).reshape(starts, self.count, k), dp

    def rows(self, y: np.ndarray, p: np.ndarray) -> Rows:
        """All rows of one start, divided by their sizes, with their slopes."""
        fixed, fixed_slopes = (x[0] for x in self.fixed(p[None]))
        n, k, count = self.n, self.k, self.count
        found = [self._called("rows", block, y[None], p[None], np.zeros(1))[1][0] for block in self._blocks]
        sizes = [each.shape[1] // (1 + k + n) for each in found]
        all_rows = np.zeros((count, max(sizes, default=0), 1 + k + n))
        present = np.zeros(all_rows.shape[:2], bool)
        for block, each, m in zip(self._blocks, found, sizes, strict=True):
            all_rows[block.numbers, :m] = each.reshape(-1, 1 + k + n, m).swapaxes(1, 2)
            present[block.numbers, :m] = True
        return Rows(fixed, fixed_slopes, all_rows[..., 0], all_rows[..., 1 : 1 + k], all_rows[..., 1 + k :], present)


def _functions(column: ca.SX, y: ca.SX, p: ca.SX, numbers: ca.SX) -> dict[str, PointFunction]:
    """Functions of :class:`Block` of the residuals at a pose."""
    damping = ca.SX.sym("damping")
    to_pose, to_unknown = (ca.densify(ca.jacobian(column, x)) for x in (y, p))
    normal = to_pose.T @ to_pose
    normal += (damping + LEAST_DAMPING) * ca.trace(normal) * ca.SX.eye(y.numel())
    coupled = to_pose.T @ to_unknown
    factors = ca.ldl(ca.densify(normal))
    solved = -ca.densify(ca.ldl_solve(ca.horzcat(to_pose.T @ column, coupled), *factors))
    reduced = to_unknown.T @ to_unknown + coupled.T @ solved[:, 1:]
    slope = to_unknown.T @ column + coupled.T @ solved[:, 0]
    results = {
        "step": ca.vertcat(ca.vec(reduced), slope, ca.vec(solved.T)),
        "pose": ca.vertcat(ca.sumsqr(column), solved[:, 0]),
        "rows": ca.vertcat(column, ca.vec(to_pose), ca.vec(to_unknown)),
    }
    summed = {"step": p.numel() * (p.numel() + 1)}
    arguments = [y, p, numbers, damping]
    return {
        name: PointFunction(ca.Function(f"synthesis_{name}", arguments, [ca.densify(result)]), summed.get(name, 0))
        for name, result in results.items()
    }
