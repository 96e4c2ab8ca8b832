"""Guesses that leave the way from pose to pose: random detours, and those on which a chain swings up."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...numerics.newton import solve
from ...numerics.rank import analyse_rank
from ..motion.guess import Guess, kinematic_guess
from ..poses.kinematic_guess import KinematicPath
from ..program.setup import PhaseSetup
from ..program.statistics import Attempt
from ..solve.problem_solver import ProblemSolver
from .whole_guess import guess_of, start_of, through_poses

#: Iterations of a solve from the usual guesses from which a chain with fewer inputs than angles is solved from swings
#: besides: fewer, or the same number from each guess, show that the program is nearly linear but for limits.
SWINGING_ITERATIONS = 20
#: Power of the time in which a late motion goes on to its higher end.
LATENESS = 2.5
#: Number of angles up to which the swings take the place of the motion through the poses, and are all further guesses;
#: with more angles there are more ways to swing up, and so many guesses in all.
FEW_ANGLES, MANY_GUESSES = 2, 6
#: Turn of an angle between the ends from which it has a direction, rad.
TURNED = 1e-9


@dataclass(frozen=True)
class _Swing:
    """A way in which a chain swings before it rises."""

    description: str
    #: number of angles to the share of each in the wave, from the ground on; positive in the direction of the way up
    shares: Callable[[int], np.ndarray]
    #: half waves, and their amplitude as the root of the sum of squares over the angles, rad
    waves: int
    amplitude: float
    #: True if most of the time is spent at the lower end
    is_late: bool


#: On 28 acrobots and pendubots the cheapest solution from the poses at rest and these three was 7 % above the best one
#: from 98 guesses, that from the usual guesses and six random detours 19 %; on 24 other chains, some on carts, 8 and
#: 10 %. They take less than half of the time of the others.
SWINGS = (
    _Swing("swinging its last link before it rises", lambda count: np.eye(count)[-1], 3, -2.0, is_late=True),
    _Swing("swinging as it rises", np.ones, 3, 1.0, is_late=False),
    _Swing("swinging back first", np.ones, 1, -2.0, is_late=False),
)


def swings(solver: ProblemSolver, reports: Sequence[Attempt]) -> list[Guess]:
    """Return further guesses for a chain in angles with fewer inputs than angles, after solves from the usual ones.

    `reports` are those of the solves, none if all of them failed.

    Such a chain gathers speed by swinging, in one of several ways that differ much in their cost, and a path that leads
    from pose to pose evenly has none of them.
    """
    angles = len(_swinging_angles(solver))
    counts = [report.iterations for report in reports]
    is_nearly_linear = bool(counts) and (
        max(counts) < SWINGING_ITERATIONS or (len(counts) > 1 and len(set(counts)) == 1)
    )
    if not angles or is_nearly_linear:
        return []
    random = np.random.default_rng(0)
    others = 0 if angles <= FEW_ANGLES else MANY_GUESSES - len(SWINGS)
    return [*(_swinging(solver, swing) for swing in SWINGS), *(random_detour(solver, random) for _ in range(others))]


def swings_suffice(solver: ProblemSolver, reports: Sequence[Attempt]) -> bool:
    """Return True if a chain need not be solved from the motion through its poses after the poses at rest.

    Of 32 chains of two angles the lowest cost of the poses at rest and of the swings was lowered by that motion in one.
    Swings take no account of waypoints, or of the speed with which a motion begins.
    """
    angles, (start, path) = _swinging_angles(solver), start_of(solver, solver.setups[0])
    is_from_end_to_end = path.segment_times.size == 2 and not np.any(start.v)
    return 0 < len(angles) <= FEW_ANGLES and is_from_end_to_end and reports[0].iterations >= SWINGING_ITERATIONS


def _swinging_angles(solver: ProblemSolver) -> list[int]:
    """Angles of a chain in angles, of one phase, with fewer inputs than coordinates, from the ground on; else none."""
    setup = solver.setups[0]
    eom = setup.scheme.eom
    if len(solver.setups) > 1 or not eom.is_chain or eom.u.numel() >= eom.q.numel():
        return []
    moved = np.bincount(eom.expansion.jac_sparsity(0, 1).get_triplet()[1], minlength=eom.q.numel())
    places = [k for k, place in enumerate(eom.independent) if setup.scales.angles[place]]
    return [eom.independent[k] for k in sorted(places, key=lambda k: -moved[k])]


def random_detour(solver: ProblemSolver, random: np.random.Generator) -> Guess:
    """The kinematic motion with a detour in each phase: a few half waves in the free directions of each pose."""
    parts, waves = [], []
    for setup in solver.setups:
        if setup.phase.is_instant:
            parts.append(through_poses(solver, setup))
            continue
        start, path = start_of(solver, setup)
        path, count = _random_detour(random, setup, path)
        parts.append(kinematic_guess(setup.loads, start, path))
        waves.append(f"{count} half wave{'s' if count > 1 else ''}")
    detours = "a detour" if len(parts) == 1 else "detours"
    return guess_of(solver, parts, f"kinematic with {detours} of {', '.join(waves)}")


def _random_detour(random: np.random.Generator, setup: PhaseSetup, path: KinematicPath) -> tuple[KinematicPath, int]:
    """A path with a detour, and the number of its half waves; the ends stay as they are."""
    scales, waves = setup.scales, int(random.integers(1, 4))
    direction = random.normal(size=path.poses.shape[1]) * np.where(scales.angles, 1.0, 0.5 * scales.q)
    amplitude = random.uniform(0.5, 2.0)
    along = _along_angles if setup.scheme.eom.is_chain else _along_free_directions
    poses = along(setup, path, direction, amplitude * _half_waves(waves, _shares_of_time(path)))
    return replace(path, poses=poses), waves


def _swinging(solver: ProblemSolver, swing: _Swing) -> Guess:
    """The motion of a chain along its path, on which its angles swing.

    A motion from the higher end to the lower one is that of the way up in reverse. Only the ends stay where they are,
    and waypoints keep their times.
    """
    setup, chosen = solver.setups[0], _swinging_angles(solver)
    start, path = start_of(solver, setup)
    ways, shares = path.poses[-1] - path.poses[0], _shares_of_time(path)
    is_up = setup.loads.work(path.times, path.poses, start.z) >= 0
    if not is_up:
        ways, shares = -ways, 1 - shares
    direction = np.zeros(ways.size)
    direction[chosen] = swing.shares(len(chosen)) * np.where(ways[chosen] < -TURNED, -1.0, 1.0)
    if swing.is_late and path.segment_times.size == 2:
        late = shares**LATENESS
        path = _at_shares(path, late if is_up else 1 - late)
    poses = _along_angles(setup, path, direction, swing.amplitude * _half_waves(swing.waves, shares))
    motion = kinematic_guess(setup.loads, start, replace(path, poses=poses))
    return guess_of(solver, [motion], f"kinematic, {swing.description}")


def _shares_of_time(path: KinematicPath) -> np.ndarray:
    """Times of a path, from zero to one."""
    times: np.ndarray = path.times - path.times[0]
    return times / times[-1]


def _half_waves(count: int, shares: np.ndarray) -> np.ndarray:
    waves: np.ndarray = np.sin(np.pi * count * shares)
    return waves


def _at_shares(path: KinematicPath, shares: np.ndarray) -> KinematicPath:
    """The path on which the poses of shares of its time are passed at its times."""
    even = _shares_of_time(path)
    return replace(path, poses=np.column_stack([np.interp(shares, even, column) for column in path.poses.T]))


def _along_angles(setup: PhaseSetup, path: KinematicPath, direction: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """Poses of a path moved by shares (k,) of a direction (n,) in the coordinates of a chain, others left."""
    chosen, poses = list(setup.scheme.eom.independent), path.poses.copy()
    sizes = np.where(setup.scales.angles, 1.0, setup.scales.q)[chosen]
    poses[:, chosen] += shares[:, None] * direction[chosen] / np.linalg.norm(direction[chosen] / sizes)
    return poses


def _along_free_directions(
    setup: PhaseSetup, path: KinematicPath, direction: np.ndarray, shares: np.ndarray
) -> np.ndarray:
    """Poses of a path moved by shares (k,) of a direction (n,) as far as the joints let them."""
    numeric, moved, before = setup.numeric, [], 0.0
    q = path.poses[0]
    for k, (time, pose) in enumerate(zip(path.times.tolist(), path.poses, strict=True)):
        free = analyse_rank(numeric.velocity(time, q)[0]).null_columns
        step = (pose - path.poses[max(k - 1, 0)]) + free @ (free.T @ direction) * (shares[k] - before)
        before = shares[k]
        rows = partial(numeric.position, time)
        outcome = solve(rows, q + step, numeric.weights, iterations=30, step_limit=numeric.typical_step)
        q = outcome.x if outcome.converged else q
        moved.append(q)
    return np.array(moved)
