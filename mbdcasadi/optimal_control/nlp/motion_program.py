"""The nonlinear program of a problem: its phases, what joins them, and a label for every row."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from ...results.state import State
from ..placeholders import Placeholder, placeholders_in, with_values
from ..problem import OptimalControlProblem
from ..refinement.mesh import Mesh
from .compiled import SolverPool
from .phase_program import Block, PhaseProgram, condition_rows
from .rows import Row, stack, violations
from .setup import PhaseSetup
from .sparse_program import Piece, SparseProgram

#: Points at which path limits are held besides stages and mesh points: phase, label, point of the interval.
Held = tuple[tuple[int, str, float], ...]


class MotionProgram:
    """The nonlinear program of an optimal-control problem on a mesh.

    Variables are those of the phases in turn, then the free parameters.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem that is transcribed.
    setups : sequence of PhaseSetup
        Transcription, sizes and conditions at the ends, by phase.
    meshes : sequence of Mesh
        Meshes of the phases. Their fractions are data: one program serves all meshes of as many intervals.
    held : tuple of (int, str, float)
        Phases, labels of path limits, and points of the intervals at which these are held besides the usual ones.

    Attributes
    ----------
    phases : list of PhaseProgram
        Variables and rows of the phases.
    nlp : SparseProgram
        Cost, rows and derivatives.
    solvers : SolverPool
        IPOPT functions for it.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        setups: Sequence[PhaseSetup],
        meshes: Sequence[Mesh],
        held: Held = (),
    ):
        self._free, self.held = problem.free_parameters, held
        expressions = [problem.terminal_cost, *[c.expression for c in problem.boundary]]
        nodes = {p.node.element_hash(): p for e in expressions for p in placeholders_in(e)}
        placeholders = list(nodes.values())
        integrals = [p for p in placeholders if p.kind == "integral"]
        self.phases: list[PhaseProgram] = []
        first = 0
        for number, (setup, mesh) in enumerate(zip(setups, meshes, strict=True)):
            points = [(label, tau) for of, label, tau in held if of == number]
            phase = PhaseProgram(problem, setup, mesh, integrals, number, first, points)
            self.phases.append(phase)
            first += phase.size
        free_scale = self.phases[0].free_scale
        self.size = first + free_scale.size
        #: places of the free parameters
        self.parameter_index = np.arange(first, self.size)
        #: size of every variable
        self.scale = np.concatenate([*[phase.scale for phase in self.phases], free_scale])
        p = ca.vertcat(*[phase.p for phase in self.phases])
        #: typical size of the cost, so that the solver's tolerance means the same in any unit
        self.cost_scale = self._size_of_cost(problem.terminal_cost)
        blocks = [b for phase in self.phases for b in phase.blocks(self.parameter_index, p, self.cost_scale)]
        blocks += self._boundary_blocks(problem, placeholders, p)
        self.blocks: list[Block] = [*blocks, *[b for phase in self.phases for b in phase.time_blocks(p)]]
        self.nlp = SparseProgram(self.size, [block.piece for block in self.blocks], p)
        self.solvers = SolverPool()

    def _size_of_cost(self, terminal: ca.SX) -> float:
        size, last = 0.0, self.phases[-1]
        for phase in self.phases:
            running = phase.phase.running_cost
            size += 0.0 if running.is_zero() else phase.scales.time * phase.sizes.of_values(running)
        if not terminal.is_zero():
            size += last.sizes.of_values(with_values(terminal, last.typical_value))
        return size or 1.0

    # --- relations between the ends -------------------------------------------------------
    def _boundary_blocks(
        self, problem: OptimalControlProblem, placeholders: Sequence[Placeholder], p: ca.SX
    ) -> list[Block]:
        """Boundary conditions and the terminal cost, which see the start and the end."""
        first, last = self.phases[0], self.phases[-1]
        if problem.terminal_cost.is_zero() and not problem.boundary:
            return []
        begin = first.unknowns()
        end = last.unknowns(begin.free)
        at_start, at_end = first.scheme.start(begin.interval), last.scheme.end(end.interval)
        symbols = ca.vertcat(ca.SX(0, 1), *[ca.SX.sym("x") for _ in placeholders])
        known = {x.node.element_hash(): symbols[k] for k, x in enumerate(placeholders)}
        gained, values = end.next_integrals - begin.integrals, []
        for x in placeholders:
            if x.kind == "integral":
                values.append(gained[next(k for k, other in enumerate(last.integrals) if other is x)])
            elif x.kind == "at_start":
                values.append(first.value(x.expression, at_start, begin))
            else:
                values.append(last.value(x.expression, at_end, end))
        whole = last.scheme.expanded(at_end, end.interval.p)

        def value(expression: ca.SX) -> ca.SX:
            """An expression with values for its placeholders; other symbols are taken at the end."""
            named = with_values(expression, lambda x: known[x.node.element_hash()])
            function = ca.Function("boundary", [*last.arguments, symbols], [named])
            return function(*whole.values, end.interval.p, end.extra, ca.vertcat(ca.SX(0, 1), *values))

        rows = {c: value(c.expression) for c in problem.boundary}
        sizes = last.sizes.of_changes([with_values(c.expression, lambda x: x.expression) for c in rows])
        groups = condition_rows(rows, dict(zip(rows, sizes, strict=True)), 1.0, "boundary: ")
        cost = value(problem.terminal_cost) / self.cost_scale
        seen = [(0, 0), (len(self.phases) - 1, last.count - 1)]
        places = [first.interval_index([0]), last.interval_index([last.count - 1])]
        index = np.r_[places[0].ravel(), places[1].ravel(), self.parameter_index][:, None]
        variables = ca.vertcat(begin.variables, end.variables, begin.free)
        piece = Piece(variables, ca.vertcat(begin.data, end.data), p, stack(groups), cost, index)
        return [Block(piece, groups, (tuple(seen),))]

    # --- what enters a solve --------------------------------------------------------------
    def bounds(self, start: State) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the variables, scaled; `start` is the first state if the initial conditions decide it."""
        sides = zip(*[phase.bounds(start) for phase in self.phases], strict=True)
        scale = self.scale[self.parameter_index]
        limits = np.array([p.lower for p in self._free]) / scale, np.array([p.upper for p in self._free]) / scale
        lower, upper = (np.concatenate([*side, limit]) for side, limit in zip(sides, limits, strict=True))
        return lower, upper

    def data(self, p: Sequence[np.ndarray], meshes: Sequence[Mesh], times: Sequence[np.ndarray]) -> np.ndarray:
        """Parameters of the compiled program: those of the mechanisms, and the intervals.

        Parameters
        ----------
        p : sequence of numpy.ndarray
            Parameters of the mechanism, by phase.
        meshes : sequence of Mesh
            Meshes by phase.
        times : sequence of numpy.ndarray
            Times of start, waypoints and end by phase, s.
        """
        intervals = []
        for phase, mesh, segment_times in zip(self.phases, meshes, times, strict=True):
            points = mesh.times(segment_times)
            free = phase.time_count > 0
            intervals.append(np.column_stack([mesh.begin, mesh.length] if free else [points[:-1], np.diff(points)]))
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
        return np.array([row.lower for row in self.rows])

    @property
    def has_integrals(self) -> bool:
        """True if integrals are among the variables."""
        return any(phase.integrals for phase in self.phases)

    def with_integrals(self, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Variables with the integrals that belong to the motion, from the rows in which they are zero."""
        x = x.copy()
        for number, phase in enumerate(self.phases):
            first = phase.scheme.point_size
            names = {f"accumulation of {p.label}": k for k, p in enumerate(phase.integrals)}
            gains = np.zeros((phase.count, len(phase.integrals)))
            for row, value in zip(self.rows, rows, strict=True):
                if row.repeated and row.phase == number and row.label in names:
                    gains[row.interval, names[row.label]] = -value
            total = np.cumsum(np.nan_to_num(gains), axis=0)
            for i in range(phase.count):
                x[phase.point_index(i + 1)[first:]] = total[i]
        return x

    def violation(self, rows: np.ndarray) -> float:
        """Largest violation of scaled rows."""
        return float(np.max(violations(rows, self.lower), initial=0.0))
