"""The nonlinear program of a problem: its phases, what joins them, and what every row says."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field
from functools import partial

import casadi as ca
import numpy as np

from ...model.cache import Cache
from ...model.conditions import Condition
from ...model.placeholders import Placeholder, placeholders_in, with_symbols, with_values
from ...model.symbols import place_of, symbols_of
from ...numerics.lazy import cached_property
from ...numerics.lending import Lending
from ...results.state import State
from ..problem import OptimalControlProblem
from ..statement.compiled import OPTION_SETS
from ..statement.known_inputs import NO_INPUTS, KnownInputs
from ..transcription.mesh import Mesh
from ..transcription.rows import BOUNDARY, Row, RowKind, condition_rows, violations
from .blocks import Block, Edge, block_of_edges
from .change import Change, ChangeSetup
from .instant_program import InstantProgram
from .phase_program import PhasePlace, PhaseProgram
from .setup import PhaseSetup
from .sparse_program import SparseProgram

#: Variables of all programs that are kept for the same problem stated again.
KEPT_VARIABLES = 100_000
#: Variables that take as much memory as the functions and the solver of a small program, 0.7 MB (measured).
PROGRAM_IN_VARIABLES = 400
#: Points at which path limits are held besides stages and mesh points: phase, label, point of the interval.
Held = tuple[tuple[int, str, float], ...]


@dataclass(frozen=True)
class Bounds:
    """Bounds of the variables and of the rows of a program, scaled."""

    lower: np.ndarray
    upper: np.ndarray
    rows_lower: np.ndarray
    rows_upper: np.ndarray

    @property
    def of_rows_and_variables(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds, each of the rows and then of the variables."""
        return np.r_[self.rows_lower, self.lower], np.r_[self.rows_upper, self.upper]


@dataclass(frozen=True)
class _CompiledProgram:
    """What is made for a program, in symbols of its own."""

    blocks: list[Block]
    nlp: SparseProgram
    #: its solvers by options, of which each holds the statistics of its last solve and calls back to Python
    solvers: Lending = field(default_factory=partial(Lending, alike=np.inf))
    #: the same functions as they travel to workers
    packed: Cache = field(default_factory=partial(Cache, OPTION_SETS))


_COMPILED = Cache(KEPT_VARIABLES, size=lambda made: made.nlp.size + PROGRAM_IN_VARIABLES)


class CollocationProgram:
    """The nonlinear program of an optimal-control problem on a mesh.

    Variables are those of the phases in turn, then the impulses between them and the free parameters. The fractions of
    the meshes are data: one program serves all meshes of as many intervals. Programs of equal `key`, if one is given,
    share their functions and solvers.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        setups: Sequence[PhaseSetup],
        meshes: Sequence[Mesh],
        changes: Sequence[ChangeSetup] = (),
        held: Held = (),
        key: Hashable = None,
    ):
        self._free, self.held = problem.free_parameters, held
        # one phase shares with others of the same start what holds no symbols
        cache = setups[0].cache if len(setups) == 1 else Cache()
        expressions = [problem.terminal_cost, *[c.expression for c in problem.boundary]]
        nodes = {p.node.element_hash(): p for e in expressions for p in placeholders_in(e)}
        placeholders = list(nodes.values())
        integrals = [p for p in placeholders if p.kind == "integral"]
        self.phases = self._phases(problem, setups, meshes, integrals)
        # not the problem itself: it holds the program
        self._owners = {key: self._owner(problem, x) for key, x in nodes.items()}
        first = sum(phase.size for phase in self.phases)
        self.changes: list[Change] = []
        for change, before, after in zip(changes, self.phases, self.phases[1:], strict=False):
            self.changes.append(Change(change, before, after, first))
            first += self.changes[-1].index.size
        free_scale = self.phases[0].free_scale
        self.size = first + free_scale.size
        #: places of the free parameters
        self.parameter_index = np.arange(first, self.size)
        #: size of every variable
        self.scale = np.concatenate([*[p.scale for p in self.phases], *[c.scale for c in self.changes], free_scale])
        p = ca.vertcat(*[phase.p for phase in self.phases])
        #: typical size of the cost, so that the solver's tolerance means the same in any unit
        self.cost_scale = cache.get_or_create("size of the cost", partial(self._size_of_cost, problem))

        def made() -> _CompiledProgram:
            blocks = [b for phase in self.phases for b in phase.blocks(self.parameter_index, p, self.cost_scale)]
            blocks += [b for change in self.changes for b in change.blocks(self.parameter_index, p)]
            blocks += self._boundary_blocks(problem, placeholders, p)
            blocks += [b for phase in self.phases for b in phase.time_blocks(p)]
            return _CompiledProgram(blocks, SparseProgram(self.size, [block.piece for block in blocks], p))

        parts = made() if key is None else _COMPILED.get_or_create((key, self.scale.tobytes()), made, bounded=True)
        self.blocks, self.nlp, self.solvers, self.packed = parts.blocks, parts.nlp, parts.solvers, parts.packed

    def _phases(
        self,
        problem: OptimalControlProblem,
        setups: Sequence[PhaseSetup],
        meshes: Sequence[Mesh],
        integrals: Sequence[Placeholder],
    ) -> list[PhaseProgram]:
        """Variables and rows of the phases, one after the other."""
        phases: list[PhaseProgram] = []
        timed = problem.has_free_times or any(mesh.moving for mesh in meshes)
        first, begins, free_scale = 0, (0.0, 0.0), _parameter_sizes(problem, setups)
        for number, (setup, mesh) in enumerate(zip(setups, meshes, strict=True)):
            kind = InstantProgram if setup.phase.is_instant else PhaseProgram
            here = [x for x in integrals if setup.phase in problem.phases_of(x)]
            points = [(label, tau) for of, label, tau in self.held if of == number]
            place = PhasePlace(number, first, begins, timed, free_scale)
            phases.append(kind(problem, setup, mesh, place, here, points))
            first += phases[-1].size
            low, high = setup.phase.span
            begins = begins[0] + low, begins[1] + high
        return phases

    def _size_of_cost(self, problem: OptimalControlProblem, *, soft: bool = False) -> float:
        """Size of the cost: without `soft` limits, of which a weight may be of any size, if it has other parts."""
        terminal = problem.terminal_cost if soft else problem.own_terminal_cost
        size, last = 0.0, self.phases[-1]
        for program in self.phases:
            phase = program.phase
            running = phase.running_cost if soft else phase.own_cost
            size += 0.0 if running.is_zero() else program.scales.time * program.sizes.of_values(running)
            at_waypoints = [w.cost if soft else w.own_cost for w in phase.waypoints]
            size += sum(program.sizes.of_values(cost) for cost in at_waypoints if not cost.is_zero())
        if not terminal.is_zero():
            size += last.sizes.of_values(with_values(terminal, self._typical_value))
        return size or (1.0 if soft else self._size_of_cost(problem, soft=True))

    def _owner(self, problem: OptimalControlProblem, placeholder: Placeholder) -> PhaseProgram:
        phase = problem.phases_of(placeholder)[0]
        own = [program for program in self.phases if program.phase is phase]
        return own[-1 if placeholder.kind == "at_end" else 0]

    def _phase_of(self, placeholder: Placeholder) -> PhaseProgram:
        """The phase that a placeholder means; for an integral over several, the first one."""
        return self._owners[placeholder.node.element_hash()]

    def _typical_value(self, placeholder: Placeholder) -> float:
        return self._phase_of(placeholder).typical_value(placeholder)

    # --- relations between the ends -------------------------------------------------------
    def _boundary_blocks(
        self, problem: OptimalControlProblem, placeholders: Sequence[Placeholder], p: ca.SX
    ) -> list[Block]:
        """Boundary conditions and the terminal cost, which see the start and the end."""
        if problem.terminal_cost.is_zero() and not problem.boundary:
            return []
        edges, last = _Edges(self.phases), self.phases[-1]
        symbols, put_in = with_symbols(placeholders)
        values = ca.vertcat(ca.SX(0, 1), *[self._value(x, edges) for x in placeholders])
        end = edges[last.number, True]
        whole = last.scheme.expanded(end.at, end.unknowns.interval.p)

        def value(expression: ca.SX) -> ca.SX:
            """An expression with values for its placeholders; other symbols are taken at the end."""
            function = ca.Function("boundary", [*last.arguments, symbols], [put_in(expression)])
            return function(*whole.values, end.unknowns.interval.p, end.unknowns.extra, values)

        rows = {c: value(c.expression) for c in problem.boundary}
        sizes = dict(zip(rows, self._boundary_sizes(list(rows), placeholders), strict=True))
        groups = condition_rows(rows, sizes, 1.0, BOUNDARY)
        cost = value(problem.terminal_cost) / self.cost_scale
        # the rows stand at the end
        ordered = [*(x for x in edges.values() if x is not end), end]
        return [block_of_edges(ordered, groups, p, self.parameter_index, cost)]

    def _value(self, placeholder: Placeholder, edges: _Edges) -> ca.SX:
        """A placeholder by the variables at ends of phases."""
        if placeholder.kind != "integral":
            phase = self._phase_of(placeholder)
            at = edges[phase.number, placeholder.kind == "at_end"]
            return phase.value(placeholder.expression, at.at, at.unknowns)
        gained = ca.SX(0)
        for phase in self.phases:
            place = place_of(placeholder, phase.integrals)
            if place is not None:
                gained += edges[phase.number, True].unknowns.next_integrals[place]
                gained -= 0 if phase.follows else edges[0, False].unknowns.integrals[place]
        return gained

    def _boundary_sizes(self, conditions: Sequence[Condition], placeholders: Sequence[Placeholder]) -> np.ndarray:
        """Changes of boundary conditions over the typical sizes of what they contain."""
        symbols, put_in = with_symbols(placeholders)
        changes = np.array([self._phase_of(x).sizes.of_changes([x.expression])[0] for x in placeholders])
        sizes = []
        for condition in conditions:
            slopes = ca.jacobian(put_in(condition.expression), symbols)
            rest = [s for s in symbols_of(slopes) if not ca.depends_on(symbols, s)]
            varying = ca.vertcat(ca.SX(0, 1), *rest)
            function = ca.Function("slopes", [symbols, varying], [ca.densify(slopes)])
            at = function(changes, np.ones(varying.numel())).full().ravel()
            size = float(np.max(np.abs(at) * changes, initial=0.0))
            outside = self.phases[-1].sizes.of_changes([with_values(condition.expression, lambda _: 0.0)])[0]
            sizes.append(size or float(outside))
        return np.array(sizes)

    # --- what enters a solve --------------------------------------------------------------
    def bounds(
        self,
        start: State,
        meshes: Sequence[Mesh],
        times: Sequence[np.ndarray],
    ) -> Bounds:
        """Bounds of the variables and of the rows.

        `start` is the first state if the initial conditions decide it; `times` are those of start, waypoints and end to
        begin with, by phase, s.
        """
        parts = zip(self.phases, meshes, times, strict=True)
        each = [phase.bounds(start, mesh.times(of), mesh.pinned) for phase, mesh, of in parts]
        sides = zip(*each, strict=True)
        scale = self.scale[self.parameter_index]
        limits = np.array([p.lower for p in self._free]) / scale, np.array([p.upper for p in self._free]) / scale
        impulses = np.full(sum(change.index.size for change in self.changes), np.inf)
        blocks = zip(sides, (-impulses, impulses), limits, strict=True)
        lower, upper = (np.concatenate([*side, free, limit]) for side, free, limit in blocks)
        return Bounds(lower, upper, self.lower, np.zeros(self.lower.size))

    def data(
        self,
        p: Sequence[np.ndarray],
        meshes: Sequence[Mesh],
        times: Sequence[np.ndarray],
        known: KnownInputs = NO_INPUTS,
    ) -> np.ndarray:
        """Parameters of the compiled program: those of the mechanisms by phase, and the intervals.

        `times` are those of start, waypoints and end by phase, s.
        """
        intervals = []
        for phase, mesh, segment_times in zip(self.phases, meshes, times, strict=True):
            points = mesh.times(segment_times)
            if phase.phase.is_instant:
                intervals.append(np.array([[points[0], 0.0]]))
                continue
            free = phase.time_count > 0
            columns = [mesh.begin, mesh.length] if free else [points[:-1], np.diff(points)]
            given = phase.scheme.known_columns(points, partial(known.values, phase.number))
            intervals.append(np.column_stack([*columns, given]))
        seen = [intervals[k][i] for block in self.blocks for copy in block.copies for k, i in copy]
        return np.concatenate([*p, *seen])

    @cached_property
    def rows(self) -> list[Row]:
        """All rows, in the order of the program."""
        return [
            row
            for block in self.blocks
            for copy in block.copies
            for group in block.groups
            for row in group.on(*(copy[-1] if copy else (-1, -1)), repeated=block.repeated)
        ]

    @cached_property
    def lower(self) -> np.ndarray:
        """Lower bounds of the rows, scaled: zero for equalities; the upper ones are zero."""
        by_block = [np.concatenate([np.zeros(0), *[g.lower for g in block.groups]]) for block in self.blocks]
        lower = [np.tile(x, len(block.copies)) for x, block in zip(by_block, self.blocks, strict=True)]
        return np.concatenate([np.zeros(0), *lower])

    def later_places(self, later: np.ndarray, over: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of the variables and of the rows of the only phase, with those of `later` intervals for each (N,).

        Points that are `over`, after the end, are the last one.
        """
        (phase,), (interval, *_) = self.phases, self.blocks
        intervals = np.arange(phase.count)[:, None]
        variables, rows = np.arange(self.size), np.arange(self.lower.size)
        variables[phase.point_index(intervals)] = phase.point_index(np.where(over, phase.count, later)[:, None])
        variables[phase.inner_index(intervals)] = phase.inner_index(later[:, None])
        count = interval.piece.rows.numel()
        rows[: phase.count * count] = (later[:, None] * count + np.arange(count)).ravel()
        return variables, rows

    @property
    def has_integrals(self) -> bool:
        """True if integrals are among the variables."""
        return any(phase.integrals for phase in self.phases)

    def with_integrals(self, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Variables with the integrals that belong to the motion, from the rows in which they are zero."""
        x = x.copy()
        for number, phase in enumerate(self.phases):
            first = phase.scheme.point_size
            places = {p.label: k for k, p in enumerate(phase.integrals)}
            gains = np.zeros((phase.count, len(phase.integrals)))
            for row, value in zip(self.rows, rows, strict=True):
                if row.kind is RowKind.ACCUMULATION and row.phase == number:
                    gains[row.interval, places[row.name.owner]] = -value
            total = np.cumsum(np.nan_to_num(gains), axis=0)
            for i in range(phase.count):
                x[phase.point_index(i + 1)[first:]] = total[i]
        return x

    def rows_at(self, x: np.ndarray, data: np.ndarray) -> np.ndarray:
        """Rows at scaled variables, scaled."""
        rows: np.ndarray = self.nlp.evaluate(x, data)[1].full().ravel()
        return rows

    def violation(self, rows: np.ndarray) -> float:
        """Largest violation of scaled rows."""
        return float(np.max(violations(rows, self.lower), initial=0.0))


def _parameter_sizes(problem: OptimalControlProblem, setups: Sequence[PhaseSetup]) -> np.ndarray:
    """Sizes of the free parameters; those without a size of their own by the limits of the phase that counts most."""
    sizes = []
    for parameter in problem.free_parameters:
        places = [(setup, place_of(parameter, setup.extra_parameters)) for setup in setups]
        by_limits = [float(setup.sizes.parameters[k]) for setup, k in places if k is not None]
        sizes.append(parameter.typical_size or max(by_limits, default=0.0) or 1.0)
    return np.array(sizes)


class _Edges(dict[tuple[int, bool], Edge]):
    """Ends of phases by number, True for the end, which share the free parameters; each is made when it is needed."""

    def __init__(self, phases: Sequence[PhaseProgram]):
        self._phases = phases
        self[0, False] = phases[0].edge(False)

    def __missing__(self, key: tuple[int, bool]) -> Edge:
        number, at_end = key
        edge = self[key] = self._phases[number].edge(at_end, self[0, False].unknowns.free)
        return edge
