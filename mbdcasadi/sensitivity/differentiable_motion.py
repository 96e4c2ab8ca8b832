"""The motion from a start over an output grid as one function, and expressions along it.

Accelerations and multipliers at outputs come from the equations of motion
there, after a step back onto the constraints; so derivatives of reactions are
exact, forward and adjoint, which those through the algebraic outputs of IDAS are not.

Where the equations jump the motion is cut. With ``w(t, x, p) = 0`` at the instant
``tau``, rates ``f⁻`` before and ``f⁺`` after it,

    x⁺ = x + f⁻ delta - f⁺ delta,    delta = -w / w_rate,

where ``delta`` vanishes in value: its derivative is that of the instant.

References
----------
Aizerman and Gantmacher, "Determination of stability by linear approximation of a periodic solution of a system of
differential equations with discontinuous right-hand sides", Q. J. Mech. Appl. Math. 11 (1958) 385; Galán, Feehery,
Barton, "Parametric sensitivity functions for hybrid discrete/continuous systems", Appl. Numer. Math. 31 (1999) 17.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..assembly.setup import Setup
from ..equations.recovery import Recovery
from ..equations.switching.time_breaks import resolution
from ..errors import ModelError
from ..integrators import Integrator
from ..integrators.compiled import CompiledIntegrator, near
from ..integrators.reversible import ReversibleIntegrator
from ..numerics.console import call
from ..numerics.least_squares import largest
from ..simulation.contact.watched_terms import has_gaps
from ..simulation.formulations import choose_formulation
from ..simulation.schedule import PIECES, WATCH_POINTS
from ..simulation.stepping.compiled_stepper import DECAY
from ..simulation.stepping.held_switches import parts_of_motion
from ..simulation.stepping.whole_stepper import refuse_redundant_rows
from ..simulation.time_dependence import TimeDependence, dependence_at, timed_equations
from .cuts import Cuts, OneSidedWarnings
from .held_system import HeldMotion, HeldSystem, SwitchesInTime, completed
from .load_limit import LoadLimit
from .motion_function import motion_function, projected
from .switching import BorderPassage
from .whole_motion import WholeIntegrator

#: Drift of the positions that is left, in tolerances: it is gone at the outputs, and what it does to the motion is
#: then of the size of the integrator's own error.
ACCEPTED = 10.0
#: Courses that are kept.
COURSES = 64


class DifferentiableMotion:
    """A simulation as functions of its start and of :class:`RunValues`, and of its course.

    Parameters
    ----------
    setup : Setup
        Mechanism, inputs and output times; its parameters are typical ones.
    varied : collection of int
        Positions of the parameters that change.
    integrands : casadi.SX, optional
        Expressions whose integrals over time are states of their own.
    in_state : bool
        True if switches in the state are cuts too; without, they are integrated over.
    reversible : bool
        True if it is differentiated backwards: by `varied`, the inputs and the start.
    ending : casadi.SX, optional
        Expression of an event that ends it: what jumps there is held on its side before the event.

    Attributes
    ----------
    values : RunValues
        Values of the parameters and inputs as they were given.
    course_varies : bool
        True if the course depends on the parameters that change.
    pieces : int
        Pieces of the whole motion, at whose ends the state is brought back onto the constraints.
    roots : list of str
        Elements with powers at whose beginning the derivatives are those of steps that no error test controls.
    poses : numpy.ndarray
        Coordinates at the outputs at these values (n_t, n); none if that run fails.
    held : HeldMotion
        The motion with the switches held that are held now.
    """

    def __init__(
        self,
        setup: Setup,
        integrator: Integrator,
        *,
        varied: Collection[int] = (),
        integrands: ca.SX | None = None,
        in_state: bool = True,
        reversible: bool = False,
        ending: ca.SX | None = None,
    ):
        numeric, signals, grid, start = setup.numeric, setup.signals, setup.grid, setup.start
        if setup.has_redundant_rows:
            refuse_redundant_rows(integrator, numeric, start)
        if signals.controller or signals.polynomials:
            raise ModelError(
                "inputs= takes numbers, samples and expressions here; a SampledController or the polynomials of an "
                "optimal solution cannot be differentiated or compiled: give samples of them"
            )
        self.numeric, self.grid, self.signals, self.redundant = numeric, grid, signals, setup.has_redundant_rows
        self.values = RunValues(numeric.p, signals.level_values, signals.channel_over(grid))
        self._integrands = ca.SX(0, 1) if integrands is None else integrands
        self.form = choose_formulation(numeric, integrator, redundant=self.redundant)
        self._integrator, self._given, self._in_state = integrator, frozenset(varied), in_state
        self._is_reversible, self._ending = reversible and integrator.is_multistep, ending
        self._courses: OrderedDict[tuple[Any, ...], Cuts] = OrderedDict()
        self.load_limit = LoadLimit(setup, integrator, self._integrands)
        self._timed = timed_equations(setup, self._integrands)
        self.course_varies = bool(self._timed.parameters & self._given)
        # from zero the search of IDAS for forces that depend on reactions, |λ|, may fail
        self._unknowns = near(np.r_[start.a, start.lam])
        # functions that are compiled already do not keep the callbacks in them alive
        self._callbacks: list[WholeIntegrator] = []
        self._find_switches()
        self._hold(frozenset())
        # CasADi does not restart IDAS where samples change, and repeats stretches of the motion with the samples of
        # another interval for the adjoint: gradients were off by up to a third, and where the repetition took more
        # steps than the motion it ended the process. Each interval is an integration of its own.
        self.pieces = grid.size - 1 if self._is_reversible and signals.is_sampled else 1
        self.poses, self._states = self.states_from(np.r_[start.q, start.v, start.z], self.values)
        self._cut_where_it_drifts()

    def _find_switches(self) -> None:
        """Find what jumps in the equations, inputs and integrands, and what of it in time alone."""
        # where slopes jump the derivatives of a step do, unless the error test takes them in
        bends = self._in_state and not self._integrator.variations_in_error_test
        self._parts = parts_of_motion(self.numeric, self.signals, self._integrands, bends=bends)
        self.roots = list(dict.fromkeys(part.description for part in self._parts if part.roots))
        self._in_time = SwitchesInTime(self.numeric, self.signals, self._parts)
        self._varied = self._in_time.depend_on(self._given)
        unmoved = [node for node, moves in zip(self._in_time.nodes, self._varied, strict=True) if not moves]
        self._one_sided = OneSidedWarnings(unmoved, differentiates=self._in_state)

    def _hold(self, active: frozenset[int]) -> None:
        """Hold the switches in the state and the active ones in time, and compile the system."""
        in_time = frozenset(self._in_time.nodes)
        nodes = frozenset().union(*[part.nodes for part in self._parts])
        free = in_time - active if self._in_state else nodes - active
        self._active = active
        system = HeldSystem(
            self.numeric,
            self.signals,
            self._integrands,
            redundant=self.redundant,
            parts=self._parts,
            free=free,
            in_time=in_time,
            ending=self._ending,
        )
        decay = DECAY * PIECES / float(self.grid[-1] - self.grid[0])
        if self._integrator.whole_run is not None:
            whole = WholeIntegrator(system.numeric, system.signals, system.integrands, self._integrator)
            self._callbacks.append(whole)
            self.held = HeldMotion(system, whole, None, np.zeros(0), decay)
            return
        dae = self.form.dae(system.numeric, system.signals, system.integrands)
        backwards = None
        if self._is_reversible:
            first = system.numeric.eom.p.numel()
            levels = range(first, first + self.signals.levels.numel())
            backwards = ReversibleIntegrator(dae, self._integrator, self._given | frozenset(levels))
        compiled, unknowns = CompiledIntegrator(dae, self._integrator), self._unknowns[: dae.z.numel()]
        self.held = HeldMotion(system, compiled, backwards, unknowns, decay)

    @property
    def integrals(self) -> int:
        """Number of integrals."""
        return int(self._integrands.numel())

    @property
    def state_size(self) -> int:
        """Number of components of the state and the integrals."""
        return self.held.system.state_size + self.integrals

    @property
    def follows_state(self) -> bool:
        """True if a course depends on the start: there are switches in the state."""
        return not np.all(self.held.system.in_time)

    @property
    def needs_start(self) -> bool:
        """True if a course depends on the start, or its steps on what the motion meets."""
        return self.follows_state or self.load_limit.is_needed

    def symbols(self, intervals: int, kind: Any = ca.MX) -> RunValues:
        """Symbols for the values of parameters and inputs over some intervals."""
        sizes = (self.numeric.eom.p.numel(), 1), (self.signals.levels.numel(), 1)
        shapes = *sizes, (self.signals.channel.numel(), intervals)
        return RunValues(*[kind.sym(name, *shape) for name, shape in zip(RunValues._fields, shapes, strict=True)])

    def _max_step(self, timed: TimeDependence) -> float | None:
        """Longest step; free flight has steps that jump over short contacts, and over what passes quickly.

        The error test does not see the derivatives: at rest steps would grow beyond those at which the drift of
        redundant rows, which is zero, has derivatives that decay.
        """
        span = float(self.grid[-1] - self.grid[0])
        watched = span / WATCH_POINTS if has_gaps(self.numeric.eom.mechanism) else None
        stable = self._integrator.stable_decay if self.form.tolerates_redundancy else np.inf
        decaying = stable / self.held.decay if np.isfinite(stable) else None
        limits = timed.max_step, watched, self.load_limit.max_step, decaying
        return min([limit for limit in limits if limit is not None], default=None)

    # --- the course at values of the parameters -----------------------------------------------
    def course(self, x0: np.ndarray | None, values: RunValues, grid: np.ndarray | None = None) -> Cuts:
        """Find where the motion is cut.

        Parameters
        ----------
        x0 : numpy.ndarray or None
            Start ``(q, v, z)``; not needed unless the motion :attr:`needs_start`.
        values : RunValues
            Values of the parameters and inputs.
        grid : numpy.ndarray, optional
            A stretch of the output times; all of them by default.

        Raises
        ------
        SimulationError
            At a jump through which no derivative can be carried, with the name of the element.
        """
        grid = self.grid if grid is None else grid
        key = (*[None if a is None else a.tobytes() for a in (x0, *values)], grid[0], grid[-1])
        if key not in self._courses:
            self._courses[key] = self._found_course(x0, values, grid)
            while len(self._courses) > COURSES:
                self._courses.popitem(last=False)
        return self._courses[key]

    def _found_course(self, x0: np.ndarray | None, values: RunValues, grid: np.ndarray) -> Cuts:
        if x0 is not None:
            self.load_limit.look(x0, values, grid)
        p, whole = values.p, self.grid
        timed = dependence_at(self._timed, p, float(whole[0]), float(whole[-1]))
        obstacle = timed.obstacle()
        if obstacle is not None:
            raise obstacle
        self._hold_what_flips(timed, p)
        limits = Cuts(timed.stops, timed.jumps, self._max_step(timed))
        if not self.held.system.size:
            return limits
        passage = BorderPassage(
            self.held,
            grid,
            np.r_[x0, np.zeros(self.integrals)] if self.follows_state else None,
            values,
            limits=limits,
            # both borders of a short load must not lie between two states that are looked at
            watch_step=min(float(whole[-1] - whole[0]) / WATCH_POINTS, self.load_limit.max_step or np.inf),
            in_time=self._sides_in_time(float(grid[0]) + self._width, p),
        )
        course = replace(limits, jumps=self._follow(passage, timed, p, grid))
        self._one_sided.report(passage.cuts, self.held.system.switches)
        for k in passage.at_borders():
            self._one_sided.at_output(self.held.system.switches[k].description, float(grid[-1]))
        return course.with_cuts(grid, passage.cuts, passage.first_sides)

    @property
    def _width(self) -> float:
        """Distance from an instant at which the sides before and after it are looked at, s."""
        return resolution(float(self.grid[0]), float(self.grid[-1]))

    def _hold_what_flips(self, timed: TimeDependence, p: np.ndarray) -> None:
        """Hold the switches in time that jump, if derivatives depend on them, and warn of those at the end."""
        in_time, width = self._in_time, self._width

        def flips_at(times: np.ndarray) -> np.ndarray:
            flips = in_time.sides(times - width, p) != in_time.sides(times + width, p)
            return np.any(flips, axis=1) & in_time.rough

        # what jumps may not do so at the typical motion, or two jumps of one instant may cancel there
        flipping = flips_at(np.union1d(timed.jumps, timed.stops))
        if np.any(flipping & self._varied) or timed.velocity_jumps or self.follows_state:
            needed = frozenset(node for node, flip in zip(in_time.nodes, flipping, strict=True) if flip)
            if not needed <= self._active:
                self._hold(self._active | needed)
        # at the end of the whole motion no cut is made: nothing comes after it
        at_end = flips_at(self.grid[-1:]) & self._varied & in_time.jump
        for name, flips in zip(in_time.descriptions, at_end, strict=True):
            if flips:
                self._one_sided.at_output(name, float(self.grid[-1]))

    def _sides_in_time(self, time: float, p: np.ndarray) -> np.ndarray:
        """Sides of the switches in time at an instant, of others zero."""
        sides, system = self._in_time.sides(np.array([time]), p)[:, 0], self.held.system
        places = {node: k for k, node in enumerate(self._in_time.nodes)}
        own = np.array([places.get(switch.node, -1) for switch in system.switches])
        return np.where(system.in_time, sides[own], 0.0) if sides.size else np.zeros(system.size)

    def _follow(self, passage: BorderPassage, timed: TimeDependence, p: np.ndarray, grid: np.ndarray) -> np.ndarray:
        """Follow the motion from cut to cut; the jumps of the equations that are none, as no held switch flips."""
        width, natural = self._width, []
        breaks = np.union1d(timed.jumps, timed.stops)
        for time in breaks[(breaks > grid[0] + width) & (breaks <= grid[-1] + width)]:
            sides = self._sides_in_time(time + width, p)
            flipped = np.flatnonzero(self.held.system.in_time & (sides != self._sides_in_time(time - width, p)))
            if flipped.size:
                passage.advance(float(time))
                strikes = any(abs(jump.time - time) <= 2 * width for jump in timed.velocity_jumps)
                passage.change(flipped.tolist(), sides, impulse=strikes)
            elif time in timed.jumps:
                natural.append(float(time))
        passage.advance(float(grid[-1]))
        return np.array(natural)

    # --- the motion ----------------------------------------------------------------------------
    def motion(self, course: Cuts, grid: np.ndarray | None = None) -> ca.Function:
        """Return ``(x0, p, levels, channel, cuts, sides, borders) -> (X, end)`` over the grid or a stretch of it.

        The states stand by column (n_x, n_t): ``(q, v, z)``, integrals, and a
        clock; `end` is the state on the constraints after the last cut. The last
        three arguments are those of the course, and of others of its pattern.
        Pieces of equal steps share a compiled integrator.
        """
        grid = self.grid if grid is None else grid
        pieces = self.pieces * (grid.size - 1) / (self.grid.size - 1)
        return motion_function(self.held, course, grid, self.symbols(grid.size - 1), pieces)

    def states_from(self, x0: np.ndarray, values: RunValues) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates (n_t, n), and first-order states, at the outputs of one run; none if it fails."""
        n, k = self.numeric.eom.q.numel(), self.numeric.eom.z.numel()
        nothing = np.zeros((0, n)), np.zeros((0, k))
        course = self.course(x0, values)
        try:
            states = call(self.motion(course), x0, *values, *course.arguments)[0].full()
        except RuntimeError:
            return nothing
        return (states[:n].T, states[2 * n : 2 * n + k].T) if self.reached(states) else nothing

    def _cut_where_it_drifts(self) -> None:
        """Cut the motion into as many pieces as keep its drift near the tolerance, by the first run.

        Drift grows with the square of the time since the state was last on the
        constraints; each cut starts the integrator again, which costs.
        """
        if not self.numeric.eom.Phi.numel() or not len(self.poses):
            return
        states = zip(self.grid.tolist(), self.poses, self._states, strict=True)
        drift = max(largest(self.numeric.position(*state)[0]) for state in states)
        needed = np.clip(
            np.ceil(np.sqrt(drift / (ACCEPTED * self._integrator.abstol))), 1, min(PIECES, self.grid.size - 1)
        )
        self.pieces = max(self.pieces, int(needed))

    def reached(self, states: np.ndarray, grid: np.ndarray | None = None) -> bool:
        """True if an integration got to its end, by its clock, and all is finite."""
        grid = self.grid if grid is None else grid
        offsets = grid - grid[0]
        on_time = np.abs(states[-1] - offsets) <= 1e-6 * offsets[-1]
        return bool(np.all(np.isfinite(states))) and bool(np.all(on_time))

    # --- outputs -------------------------------------------------------------------------
    def outputs(self, expressions: Sequence[ca.SX], grid: np.ndarray | None = None) -> ca.Function:
        """Return ``(X, p, levels, channel) -> Y``: expressions, stacked, at the outputs or some of them (n_y, n_t)."""
        grid = self.grid if grid is None else grid
        stacked = ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in expressions])
        at_one = self.at_one_output(stacked, project=not self.held.compiled.on_constraints)
        states, values = ca.MX.sym("X", self.state_size + 1, grid.size), self.symbols(grid.size - 1)
        p, levels = (ca.repmat(part, 1, grid.size) for part in (values.p, values.levels))
        # the interval that ends at an output holds its inputs too; the first output takes the first interval
        by_output = values.channel[:, [max(k - 1, 0) for k in range(grid.size)]]
        results = at_one.map(grid.size)(ca.DM(grid).T, states[:-1, :], p, levels, by_output)
        return ca.Function("outputs", [states, *values], [results], ["X", *RunValues._fields], ["Y"])

    def at_one_output(self, expression: ca.SX, *, project: bool = True, held: bool = False) -> ca.Function:
        """``(t, x, p, levels, channel) -> values`` at one output.

        Parameters
        ----------
        project : bool
            False for states that are on the constraints, with their variations.
        held : bool
            True for the equations whose switches are held; the sides follow the parameters.
        """
        numeric, signals = (
            (self.held.system.numeric, self.held.system.signals) if held else (self.numeric, self.signals)
        )
        eom, kind = numeric.eom, ca.MX if numeric.eom.Q_depends_on_lam else ca.SX
        values = self.symbols(1, kind)._replace(p=kind.sym("p", eom.p.numel()))
        arguments = [kind.sym("t"), kind.sym("x", self.state_size), *values]
        t, x, p, *inputs = arguments
        x = projected(Recovery(numeric, redundant=self.redundant), t, x, p) if project else x
        six = completed(numeric, signals, [t, x, p, *inputs], redundant=self.redundant)
        return ca.Function("output", arguments, [eom.function(expression)(t, *six, p)])
