"""Motions to begin with: through the poses, natural ones, and others at random, in any time that is allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...assembly.followed_states import without_servos
from ...assembly.pose import PoseProblem
from ...errors import MechanismError
from ...numerics.console import without_warnings
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...numerics.newton import solve
from ...numerics.rank import analyse_rank
from ...numerics.tolerances import MET
from ...results.state import State
from ..motion.guess import Guess, PhaseGuess, guess_at_rest, kinematic_guess
from ..motion.natural_motion import STRETCHES, NaturalMotion
from ..poses.kinematic_guess import KinematicPath, has_free_path
from ..program.setup import PhaseSetup
from ..solve.problem_solver import ProblemSolver
from ..statement.phase import on_positions, with_parameters
from ..transcription.mesh import Mesh
from .whole_guess import guess_of, start_of

#: Load, as a share of its typical size, above which a mechanism without inputs does not stay at rest.
MOVED = 1e-9
#: Random poses from which other ends are assembled, and difference from which a pose is another one, rad or sizes of
#: the mechanism.
END_STARTS, ANOTHER = 16, 0.2
#: Largest number of half waves of detours, waves and random inputs, and range of amplitudes, rad or sizes.
HALF_WAVES, AMPLITUDES = 4, (0.5, 2.0)
#: Power of the time in which a late motion goes on to its higher end, and turn of an angle that has a direction.
LATENESS, TURNED = 2.5, 1e-9
#: Range of the powers of ten of random inputs, as shares of their limits, or of their typical sizes if they have none.
INPUT_POWERS = (-1.0, 0.0)
#: Number of random motions of which the one that violates the demands least is a start, and number of durations of free
#: motions of which those count that violate them less than their neighbours.
SCREENED, FREE_DURATIONS = 6, 24
#: Share of its longest time at which the range of a duration begins that may be zero, and multiple of the earliest time
#: of the last waypoint.
SHORTEST, LATER = 0.05, 1.1


@dataclass(frozen=True)
class Way:
    """Poses of a phase and the velocities and first-order states with which it begins."""

    setup: PhaseSetup
    start: State
    path: KinematicPath
    v: np.ndarray


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


class Starts:
    """Guesses of a problem.

    Parameters
    ----------
    solver : ProblemSolver
        Problem with its start.
    """

    def __init__(self, solver: ProblemSolver):
        self._solver = solver

    # --- the mechanism ----------------------------------------------------------------------------
    @cached_property
    def _natural(self) -> list[NaturalMotion | None]:
        """Simulations by phase; None for an instant."""
        return [None if s.phase.is_instant else NaturalMotion(s) for s in self._solver.setups]

    @cached_property
    def is_underactuated(self) -> bool:
        """True if a phase has more degrees of freedom than inputs, and some."""
        moving = [natural for natural in self._natural if natural is not None]
        return any(natural.is_underactuated and natural.drives for natural in moving)

    @property
    def swings(self) -> bool:
        """True for a mechanism that may have to swing: with fewer inputs than degrees of freedom, or too weak ones."""
        return self.is_underactuated or self.is_weak

    @cached_property
    def is_weak(self) -> bool:
        """True if a pose on the way needs inputs beyond their limits to be held at rest."""
        setups = [setup for setup in self._solver.setups if not setup.phase.is_instant]
        return any(self._passes_limits_at_rest(setup) for setup in setups)

    def _passes_limits_at_rest(self, setup: PhaseSetup) -> bool:
        """True if inputs pass their limits while they hold the poses of a phase."""
        low, high = np.array([(u.lower, u.upper) for u in setup.phase.mechanism.inputs]).reshape(-1, 2).T
        if not np.any(np.isfinite(low) | np.isfinite(high)):
            return False
        start, path = start_of(self._solver, setup)
        still = np.zeros_like(path.poses)
        inputs = setup.loads.loads(path.times, path.poses, still, still, np.tile(start.z, (path.times.size, 1)))[1]
        room = MET * setup.scales.u
        return bool(np.any((inputs < low - room) | (inputs > high + room)))

    @property
    def has_loose_end(self) -> bool:
        """True if conditions at the end and between the ends are fewer than the states."""
        setup, problem = self._solver.setups[-1], self._solver.problem
        freedom, final = setup.scheme.eom.q.numel() - len(setup.scheme.rows), problem.phases[-1].final
        if isinstance(final, State) or setup.phase.is_instant:
            return False
        return sum(condition.equality for condition in (*final, *problem.boundary)) < 2 * freedom

    @property
    def has_free_durations(self) -> bool:
        """True if the time of a phase is free."""
        return any(low < high for low, high in self._spans)

    @property
    def _spans(self) -> list[tuple[float, float]]:
        """Ranges of the durations, s: in the shortest one there is time for a motion after the last waypoint."""
        spans = []
        for phase in self._solver.problem.phases:
            low, high = phase.span
            last = max((waypoint.time[0] for waypoint in phase.waypoints), default=0.0)
            spans.append((min(max(low, LATER * last), phase.span.typical), high))
        return spans

    # --- times ------------------------------------------------------------------------------------
    def durations(self, number: int) -> list[float]:
        """Durations of the phases that cover their ranges evenly by powers, for numbers from zero on, s.

        The first ones are those to begin with.
        """
        if not number:
            return [phase.span.typical for phase in self._solver.problem.phases]
        return self._durations(_evenly(number))

    def _durations(self, share: float) -> list[float]:
        """Durations at a share of their ranges by powers, s."""
        ranges = [(max(low, SHORTEST * high), high) for low, high in self._spans]
        return [low if low == high else low ** (1 - share) * high**share for low, high in ranges]

    def scaled_durations(self, durations: Sequence[float], factor: float) -> list[float]:
        """Durations that are longer by a factor, within their ranges, s."""
        return [float(np.clip(factor * d, *span)) for d, span in zip(durations, self._spans, strict=True)]

    def ways(self, durations: Sequence[float]) -> list[Way]:
        """Poses of the phases in given times."""
        begin, ways = 0.0, []
        for k, (setup, duration) in enumerate(zip(self._solver.setups, durations, strict=True)):
            start, path = start_of(self._solver, setup)
            if not setup.phase.is_instant:
                times = begin + setup.phase.segment_times(duration)
                path = replace(path, segment_times=times, times=np.interp(path.times, path.segment_times, times))
                begin = float(times[-1])
            v = (
                start.v
                if k == 0 or setup.phase.is_instant
                else (path.poses[1] - path.poses[0]) / np.diff(path.times)[0]
            )
            ways.append(Way(setup, start, path, v))
        return ways

    # --- kinds of guesses -------------------------------------------------------------------------
    def usual(self) -> Guess:
        """The motion through the conditions, or the free motion if there are none and it begins with a speed."""
        phases = self._solver.problem.phases
        if len(phases) == 1 and has_free_path(self._solver.problem, phases[0]) and np.any(self._solver.start.v):
            return self._free(self.ways(self.durations(0)))
        return self.through_poses()

    def through_poses(self, ways: Sequence[Way] | None = None) -> Guess:
        """The motion through the poses of the places on the way."""
        return self._guess(self._ways(ways), "kinematic", kinematic_guess)

    def at_rest(self, ways: Sequence[Way] | None = None) -> Guess:
        """The poses of the places on the way, without speeds."""
        return self._guess(self._ways(ways), "kinematic, at rest", guess_at_rest)

    def stays_at_rest(self) -> bool:
        """True if a chain with a motor in every joint stays where it is without them, as an arm without gravity does.

        Poses at rest then meet the equations of motion without any input, and the solver leaves them in tiny steps: of
        21 made-up arms of two to five links 11 were not solved from there in 300 iterations, and one at a lower cost.
        """
        setup = self._solver.setups[0]
        eom, (start, path) = setup.scheme.eom, start_of(self._solver, setup)
        if eom.u.numel() < eom.q.numel():
            return False
        still = np.zeros_like(path.poses)
        missing = setup.loads.missing(path.times, path.poses, still, still, np.tile(start.z, (path.times.size, 1)))
        return largest(missing) <= MOVED

    def natural(self, ways: Sequence[Way], random: np.random.Generator | None = None) -> Guess:
        """Motions whose driven displacements follow the poses, with random waves if asked for; all else moves freely.

        Phases in which nothing is driven are free; one that does not get to its end goes through its poses.
        """

        def motion(natural: NaturalMotion, way: Way) -> PhaseGuess | None:
            if not natural.drives:
                return natural.under(way.path, way.v, way.start.z)
            waves = None if random is None else natural.sizes * _waves(random, natural.sizes.size)
            return natural.along(way.path, way.v, way.start.z, waves)

        return self._simulated(ways, "natural" if random is None else "natural with waves", motion)

    def _free(self, ways: Sequence[Way]) -> Guess:
        """The motion with the inputs' own values."""
        return self._simulated(ways, "free motion", lambda natural, way: natural.under(way.path, way.v, way.start.z))

    def free_motions(self, meshes: Sequence[Mesh]) -> list[Guess]:
        """Motions with the inputs' own values, of the durations at which these violate the demands least for a while.

        That which violates them least comes first.
        """
        if not self.has_free_durations:
            return [self._free(self.ways(self.durations(0)))]
        guesses = [self._free(self.ways(self._durations(share))) for share in np.linspace(0, 1, FREE_DURATIONS)]
        amounts = np.nan_to_num([self._solver.violation(meshes, guess) for guess in guesses], nan=np.inf)
        falls, rises = amounts < np.r_[np.inf, amounts[:-1]], amounts <= np.r_[amounts[1:], np.inf]
        found = [k for k in np.argsort(amounts, kind="stable").tolist() if falls[k] and rises[k]]
        return [guesses[k] for k in found]

    def _under_random_inputs(self, ways: Sequence[Way], random: np.random.Generator) -> Guess:
        def motion(natural: NaturalMotion, way: Way) -> PhaseGuess | None:
            inputs = _random_inputs(way.setup, random)
            return natural.under(way.path, way.v, way.start.z, inputs)

        return self._simulated(ways, "simulated with random inputs", motion)

    def detour(self, ways: Sequence[Way], random: np.random.Generator) -> Guess:
        """The motion through the poses with a detour in each phase: half waves in the free directions of each pose."""
        changed, waves = [], []
        for way in ways:
            if not way.setup.phase.is_instant:
                path, count = _random_detour(random, way.setup, way.path)
                way = replace(way, path=path)
                waves.append(f"{count} half wave{'s' if count > 1 else ''}")
            changed.append(way)
        detours = "a detour" if len(waves) == 1 else "detours"
        return self._guess(changed, f"kinematic with {detours} of {', '.join(waves)}", kinematic_guess)

    @property
    def is_open_chain(self) -> bool:
        """True for an open chain in its angles, of one phase, with fewer inputs than angles."""
        first, *others = self._solver.setups
        eom = first.scheme.eom
        return not others and bool(eom.is_chain and eom.u.numel() < eom.q.numel())

    def swinging(self) -> list[Guess]:
        """Motions of an open chain along its path, on which its angles swing; none for other mechanisms."""
        if not self.is_open_chain:
            return []
        setup = self._solver.setups[0]
        eom = setup.scheme.eom
        moved = np.bincount(eom.expansion.jac_sparsity(0, 1).get_triplet()[1], minlength=eom.q.numel())
        places = [k for k, place in enumerate(eom.independent) if setup.scales.angles[place]]
        chosen = [eom.independent[k] for k in sorted(places, key=lambda k: -moved[k])]
        return [self._swinging(chosen, swing) for swing in SWINGS] if chosen else []

    def _swinging(self, chosen: list[int], swing: _Swing) -> Guess:
        """The motion of a chain along its path, on which its angles, from the ground on, swing.

        A motion from the higher end to the lower one is that of the way up in reverse. Only the ends stay where they
        are, and waypoints keep their times.
        """
        (way,) = self.ways(self.durations(0))
        path, setup = way.path, way.setup
        ways, shares = path.poses[-1] - path.poses[0], _shares_of_time(path)
        is_up = setup.loads.work(path.times, path.poses, way.start.z) >= 0
        if not is_up:
            ways, shares = -ways, 1 - shares
        direction = np.zeros(ways.size)
        direction[chosen] = swing.shares(len(chosen)) * np.where(ways[chosen] < -TURNED, -1.0, 1.0)
        if swing.is_late and path.segment_times.size == 2:
            late, even = shares**LATENESS, _shares_of_time(path)
            at = late if is_up else 1 - late
            path = replace(path, poses=np.column_stack([np.interp(at, even, column) for column in path.poses.T]))
        poses = _along_angles(setup, path, direction, swing.amplitude * np.sin(np.pi * swing.waves * shares))
        changed = replace(way, path=replace(path, poses=poses))
        return self._guess([changed], f"kinematic, {swing.description}", kinematic_guess)

    # --- at random --------------------------------------------------------------------------------
    def at_random(self, meshes: Sequence[Mesh], count: int, *, are_first: bool = True) -> Iterator[Guess]:
        """Starts of different kinds and durations, to different ends.

        In turn detours, natural motions, detours, and motions under random inputs: of several the one is taken that
        violates the demands least. If they `are_first`, the natural motion without waves and the free
        ones are among them.
        """
        random, free = np.random.default_rng(0), list[Guess]()
        for number in range(count):
            ways = self.ways(self.durations(number // 2))
            if number % 4 > 1:
                ways = self._to_another_end(ways, random)
            if number == 3 and are_first:
                free = self.free_motions(meshes)
            if number % 2 == 0:
                yield self.detour(ways, random)
            elif number % 4 == 1:
                yield self.natural(ways, None if number == 1 and are_first else random)
            elif free:
                yield free.pop(0)
            else:
                yield self.least_violating(meshes, [self._under_random_inputs(ways, random) for _ in range(SCREENED)])

    def least_violating(self, meshes: Sequence[Mesh], guesses: Sequence[Guess]) -> Guess:
        """The guess that violates limits and conditions least."""
        return min(guesses, key=lambda guess: np.nan_to_num(self._solver.violation(meshes, guess), nan=np.inf))

    def _to_another_end(self, ways: list[Way], random: np.random.Generator) -> list[Way]:
        """Ways of which the last one leads to another end, if there is one."""
        ends, last = self.other_ends, ways[-1]
        if not ends:
            return ways
        end = ends[int(random.integers(len(ends)))]
        return [*ways[:-1], replace(last, path=_straight(last.setup, last.path, end))]

    @cached_property
    def other_ends(self) -> list[np.ndarray]:
        """Other poses that meet the conditions at the end: another elbow, another branch, or whole turns.

        The nearest ones to the start come first. None if the end is given as a state, or there are waypoints.
        """
        setup = self._solver.setups[-1]
        phase = setup.phase
        if phase.is_instant or phase.waypoints or isinstance(phase.final, State):
            return []
        conditions = [c for c in (*phase.final, *phase.path) if c.equality and on_positions(c.expression)]
        extra = dict(zip(self._solver.problem.free_parameters, self._solver.free_values.tolist(), strict=True))
        conditions = with_parameters(conditions, self._solver.problem.extra_parameters(phase), extra)
        (start, path), numeric, random = start_of(self._solver, setup), setup.numeric, np.random.default_rng(0)
        sizes, place = numeric.scale.coordinates, PoseProblem(numeric, conditions, float(path.times[-1]), start.z)
        usual = path.poses[-1]
        found = [usual]

        def is_end(q: np.ndarray) -> bool:
            rows = np.r_[place.values(conditions, q), numeric.position(place.t, q, place.z)[0]]
            return largest(rows) <= MET and all(largest((q - other) / sizes) > ANOTHER for other in found)

        angles = np.flatnonzero(numeric.eom.angles)
        for k in [int(k) for k in angles if k in setup.scheme.eom.independent]:
            for turn in (-2 * np.pi, 2 * np.pi):
                q = usual + turn * (np.arange(usual.size) == k)
                if is_end(q):
                    found.append(q)
        for _ in range(END_STARTS):
            far = usual + np.where(numeric.eom.angles, np.pi, sizes) * random.uniform(-1, 1, sizes.size)
            try:
                with without_warnings():
                    q = place.solve(far)
            except MechanismError:
                continue
            if is_end(q):
                found.append(q)
        return sorted(found[1:], key=lambda q: float(np.sum(numeric.weights * (q - start.q) ** 2)))

    def to_other_ends(self, count: int) -> list[Guess]:
        """Motions through poses to other ends."""
        ways = self.ways(self.durations(0))
        last = ways[-1]
        paths = [_straight(last.setup, last.path, end) for end in self.other_ends[:count]]
        description = "kinematic, to another pose at the end"
        return [self._guess([*ways[:-1], replace(last, path=path)], description, kinematic_guess) for path in paths]

    # --- parts ------------------------------------------------------------------------------------
    def _ways(self, ways: Sequence[Way] | None) -> Sequence[Way]:
        return self.ways(self.durations(0)) if ways is None else ways

    def _guess(self, ways: Sequence[Way], description: str, make: Callable[..., PhaseGuess]) -> Guess:
        parts = [self._through(way, make) for way in ways]
        return guess_of(self._solver, parts, description)

    def _through(self, way: Way, make: Callable[..., PhaseGuess]) -> PhaseGuess:
        if way.setup.phase.is_instant:
            return PhaseGuess(lambda _times: {}, way.path.segment_times)
        return make(way.setup.loads, way.start, way.path)

    def _simulated(
        self, ways: Sequence[Way], description: str, motion: Callable[[NaturalMotion, Way], PhaseGuess | None]
    ) -> Guess:
        parts = []
        for natural, way in zip(self._natural, ways, strict=True):
            part = None if natural is None else motion(natural, way)
            parts.append(self._through(way, kinematic_guess) if part is None else part)
        return guess_of(self._solver, parts, description)


def _evenly(number: int) -> float:
    """Share by number that fills the range from zero to one evenly: 1/2, 1/4, 3/4, 1/8, … (van der Corput)."""
    share, step = 0.0, 0.5
    while number:
        share, number, step = share + step * (number % 2), number // 2, step / 2
    return share


def _waves(random: np.random.Generator, count: int) -> np.ndarray:
    """Half waves that begin and end at zero, of random numbers and amplitudes (STRETCHES + 1, n)."""
    numbers, shares = random.integers(1, HALF_WAVES + 1, count), np.linspace(0, 1, STRETCHES + 1)
    amplitudes = random.uniform(*AMPLITUDES, count) * random.choice([-1, 1], count)
    waves: np.ndarray = np.sin(np.pi * np.outer(shares, numbers)) * amplitudes
    return waves


def _random_inputs(setup: PhaseSetup, random: np.random.Generator) -> np.ndarray:
    """Inputs of a few half waves with random amplitudes and phases (STRETCHES + 1, n_u)."""
    inputs, shares = setup.phase.mechanism.inputs, np.linspace(0, 1, STRETCHES + 1)
    columns = []
    for symbol, size in zip(inputs, setup.scales.u.tolist(), strict=True):
        amplitudes = random.uniform(-1, 1, HALF_WAVES)
        angles = np.outer(shares, np.pi * np.arange(1, HALF_WAVES + 1)) + random.uniform(0, 2 * np.pi, HALF_WAVES)
        wave = np.sin(angles) @ amplitudes
        limits = [abs(limit) for limit in (symbol.lower, symbol.upper) if np.isfinite(limit)]
        peak = 10 ** random.uniform(*INPUT_POWERS) * (max(limits) if limits else size)
        columns.append(np.clip(peak * wave / np.max(np.abs(wave)), symbol.lower, symbol.upper))
    return np.array(columns).reshape(len(columns), STRETCHES + 1).T


def _random_detour(random: np.random.Generator, setup: PhaseSetup, path: KinematicPath) -> tuple[KinematicPath, int]:
    """A path with a detour, and the number of its half waves; the ends stay as they are."""
    scales, count = setup.scales, int(random.integers(1, HALF_WAVES))
    direction = random.normal(size=path.poses.shape[1]) * np.where(scales.angles, 1.0, 0.5 * scales.q)
    waves = random.uniform(*AMPLITUDES) * np.sin(np.pi * count * _shares_of_time(path))
    along = _along_angles if setup.scheme.eom.is_chain else _along_free_directions
    return replace(path, poses=along(setup, path, direction, waves)), count


def _shares_of_time(path: KinematicPath) -> np.ndarray:
    """Times of a path, from zero to one."""
    times: np.ndarray = path.times - path.times[0]
    return times / times[-1]


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
    numeric, moved, before = without_servos(setup.numeric), [], 0.0
    q = path.poses[0]
    for k, (time, pose) in enumerate(zip(path.times.tolist(), path.poses, strict=True)):
        free = analyse_rank(numeric.jacobian(time, q)).null_columns
        step = (pose - path.poses[max(k - 1, 0)]) + free @ (free.T @ direction) * (shares[k] - before)
        before = shares[k]
        rows = partial(numeric.position, time, z=setup.start.z)
        outcome = solve(rows, q + step, numeric.weights, iterations=30, step_limit=numeric.typical_step)
        q = outcome.x if outcome.converged else q
        moved.append(q)
    return np.array(moved)


def _straight(setup: PhaseSetup, path: KinematicPath, end: np.ndarray) -> KinematicPath:
    """Poses whose coordinates lead evenly from the first one of a path to an end, as nearly as the joints let them.

    They may pass a singular pose on the way.
    """
    numeric, times = without_servos(setup.numeric), path.times
    shares = (times - times[0]) / (times[-1] - times[0])
    poses = []
    for time, share in zip(times.tolist(), shares.tolist(), strict=True):
        q = path.poses[0] + share * (end - path.poses[0])
        outcome = solve(partial(numeric.position, time, z=setup.start.z), q, numeric.weights, iterations=30)
        poses.append(outcome.x if outcome.converged else q)
    return replace(path, poses=np.array(poses))
