"""Where the search starts: a motion by continuation, or another solution."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..analysis.pose import PoseProblem
from ..equations.numeric import NumericEquations
from ..errors import AssemblyError
from ..model.conditions import Condition
from ..numerics.least_squares import largest, solve
from ..results.state import State
from ..results.trajectory import Trajectory
from .problem import OptimalControlProblem
from .program import MotionProgram

#: Steps of the continuation from the first to the last pose, at the least.
STEPS = 40


def kinematic_guess(
    problem: OptimalControlProblem, numeric: NumericEquations, start: State, duration: float, shares: np.ndarray
) -> np.ndarray:
    """Poses (k, n) at shares of the duration, by continuation from the start to the final conditions.

    The final conditions are moved in steps from the value that they have in
    the first pose to their target; each pose is assembled from the last. A
    straight line in the coordinates would tear closed loops apart.
    """
    conditions = _on_positions(problem.final)
    if not conditions:
        return np.tile(start.q, (shares.size, 1))
    poses = PoseProblem(numeric, conditions, duration, start.z)
    first = poses.values(conditions, start.q)
    path, q = [start.q], start.q
    count = max(STEPS, shares.size)
    for k in range(1, count + 1):
        outcome = solve(poses.rows_with(conditions, (1 - k / count) * first), q, numeric.weights, iterations=30)
        if not outcome.converged:
            break  # the linkage does not reach there: the solver is left to find out, and says so
        q = outcome.x
        path.append(q)
    path += [q] * (count + 1 - len(path))
    known = np.linspace(0, 1, count + 1)
    return np.column_stack([np.interp(shares, known, column) for column in np.array(path).T])


def _on_positions(final: Sequence[Condition]) -> list[Condition]:
    kinds = ("velocity", "acceleration", "multiplier", "input")
    return [c for c in final if c.equality and c.depends_on("position") and not c.depends_on(*kinds)]


def first_guess(program: MotionProgram, start: State, duration: float, mesh: np.ndarray) -> np.ndarray:
    """Variables of the program from a kinematic guess at rest."""
    problem, numeric = program.problem, program.numeric
    try:
        poses = kinematic_guess(problem, numeric, start, duration, mesh)
    except AssemblyError:
        poses = np.tile(start.q, (mesh.size, 1))
    x = np.zeros(program.size)
    for k in range(mesh.size):
        at = program.node_index(k)
        n = start.q.size
        x[at[:n]] = poses[k]
        x[at[2 * n : 2 * n + start.z.size]] = start.z
    x[program.node_index(0)[: 2 * start.q.size]] = np.r_[start.q, start.v]
    return _with_globals(program, x, duration)


def guess_from(program: MotionProgram, motion: Trajectory, duration: float, mesh: np.ndarray) -> np.ndarray:
    """Variables of the program from a trajectory on any mesh, stretched to the duration."""
    scheme = program.scheme
    span = motion.t[-1] - motion.t[0]
    points = np.asarray(scheme.coefficients.points)
    stages = (mesh[:-1, None] + np.diff(mesh)[:, None] * points[None, :]).ravel()
    stretch = duration / span
    nodes, inner = (motion.at(motion.t[0] + span * shares) for shares in (mesh, stages))
    lam = np.nan_to_num(inner.lam)[:, scheme.rows]
    x = np.zeros(program.size)
    degree = scheme.degree
    for k in range(mesh.size):
        x[program.node_index(k)[: scheme.node_size]] = np.r_[nodes.q[k], nodes.v[k] / stretch, nodes.z[k]]
    for i in range(mesh.size - 1):
        rows = slice(i * degree, (i + 1) * degree)
        a = inner.a[rows].ravel() / stretch**2
        content = np.r_[a, lam[rows].ravel(), inner.inputs[rows].ravel()]
        x[program.block_index(i)[: content.size]] = content
    return _with_globals(program, x, duration)


def _with_globals(program: MotionProgram, x: np.ndarray, duration: float) -> np.ndarray:
    free = [p.value for p in program.problem.free_parameters]
    x[program.global_index] = np.r_[duration, free]
    return x / program.scale


def start_of(problem: OptimalControlProblem, numeric: NumericEquations, assembled: State) -> bool:
    """Whether the initial conditions fix the first node."""
    if isinstance(problem.initial, State):
        return True
    eom = numeric.eom
    rows = [c for c in problem.initial if c.equality]
    if len(rows) < len(problem.initial):
        return False
    free = {p.element_hash() for p in problem.free_parameters}
    expressions = ca.vertcat(ca.SX(0, 1), *[c.expression for c in rows])
    if any(s.element_hash() in free for s in ca.symvar(ca.vertcat(expressions, eom.Phi, eom.nu))):
        return False
    x = ca.vertcat(eom.q, eom.v, eom.z)
    all_rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu, expressions)
    jacobian = eom.function(ca.jacobian(all_rows, x))(*assembled.arguments).full()
    scale = np.concatenate([numeric.column_scale, numeric.column_scale, np.ones(eom.z.numel())])
    jacobian = jacobian * scale
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    values = np.linalg.svd(jacobian / np.where(size > 1e-12, size, 1.0), compute_uv=False)
    return int(np.sum(values > 1e-9 * max(largest(values), 1e-300))) == x.numel()
