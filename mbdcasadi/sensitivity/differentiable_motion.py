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
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..assembly.setup import Setup
from ..equations.recovery import Recovery
from ..equations.time_breaks import resolution
from ..errors import ModelError, warn
from ..integrators import Integrator
from ..integrators.compiled import MAX_STEPS, CompiledIntegrator
from ..integrators.reversible import ReversibleIntegrator
from ..numerics.console import call
from ..numerics.least_squares import largest
from ..simulation.formulations import choose_formulation
from ..simulation.schedule import PIECES, WATCH_POINTS, Piece, Schedule
from ..simulation.stepping import DECAY, perturbed
from ..simulation.time_dependence import TimeDependence, dependence_at, timed_equations
from ..simulation.watched_terms import has_gaps
from .held_system import HeldSystem, SwitchesInTime, parts_of_motion
from .load_limit import LoadLimit
from .switching import BorderPassage, Cut

#: Drift of the positions that is left, in tolerances: it is gone at the outputs, and what it does to the motion is
#: then of the size of the integrator's own error.
ACCEPTED = 10.0
#: Courses that are kept.
COURSES = 64


@dataclass(frozen=True)
class Cuts:
    """The cuts of a motion at values of the parameters.

    Attributes
    ----------
    stops : numpy.ndarray
        Times over which no step may go, s.
    jumps : numpy.ndarray
        Times at which the equations jump, whatever the parameters are, s.
    max_step : float or None
        Longest step, s.
    cuts : tuple of Cut
        Instants that depend on the parameters, or at which sides change.
    sides : tuple of float
        Sides of the switches at the start.
    """

    stops: np.ndarray
    jumps: np.ndarray
    max_step: float | None
    cuts: tuple[Cut, ...] = ()
    sides: tuple[float, ...] = ()

    @property
    def pattern(self) -> tuple[Any, ...]:
        """Hashable: courses with the same pattern share compiled functions."""
        cuts = tuple((c.interval, c.at_output, c.joined, c.switches[:1], c.impulse) for c in self.cuts)
        return cuts, self.stops.tobytes(), self.jumps.tobytes(), self.max_step, len(self.sides)

    @property
    def arguments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times of the cuts, sides of the switches in all pieces by column, and borders."""
        sides = np.array([self.sides, *(cut.sides for cut in self.cuts)]).T.reshape(-1, len(self.cuts) + 1)
        times = np.array([cut.time for cut in self.cuts])
        return times, sides, np.array([cut.border for cut in self.cuts])

    @property
    def symbols(self) -> list[ca.MX]:
        """Symbols for these arguments."""
        count = len(self.cuts)
        shapes = {"cuts": (count, 1), "sides": (len(self.sides), count + 1), "borders": (count, 1)}
        return [ca.MX.sym(name, *shape) for name, shape in shapes.items()]


class DifferentiableMotion:
    """A simulation as functions of ``(x0, p, levels, channel)``, and of its course.

    Parameters
    ----------
    setup : Setup
        Mechanism, inputs and output times; its parameters are typical ones.
    integrator : Integrator
        Method and tolerances.
    varied : collection of int
        Positions of the parameters that change.
    integrands : casadi.SX, optional
        Expressions whose integrals over time are states of their own.
    in_state : bool
        True if switches in the state are cuts too; without, they are integrated over.
    reversible : bool
        True if it is differentiated backwards: by `varied`, the inputs and the start.
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
    ):
        numeric, signals, grid = setup.numeric, setup.signals, setup.grid
        if signals.controller or signals.polynomials:
            raise ModelError(
                "inputs= takes numbers, samples and expressions here; a SampledController or the polynomials of an "
                "optimal solution cannot be differentiated or compiled: give samples of them"
            )
        self.numeric, self.grid, self.signals, self.redundant = numeric, grid, signals, setup.has_redundant_rows
        self._integrands = ca.SX(0, 1) if integrands is None else integrands
        self.integrals = self._integrands.numel()
        self.form = choose_formulation(numeric, integrator, redundant=self.redundant)
        self._abstol = integrator.abstol
        self._integrator, self._given = integrator, frozenset(varied)
        self._reversible = reversible and integrator.is_multistep
        self._courses: OrderedDict[tuple[Any, ...], Cuts] = OrderedDict()
        self._warned: set[str] = set()
        self.load_limit = LoadLimit(setup, integrator)
        self._has_gaps = has_gaps(numeric.eom.mechanism)
        start = setup.start
        self._timed = timed_equations(setup, self._integrands)
        self._parts = parts_of_motion(numeric, signals, self._integrands)
        self._in_time = SwitchesInTime(numeric, signals, self._parts)
        self._varied = self._in_time.depend_on(varied)
        #: whether the course depends on the parameters that change
        self.course_varies = bool(self._timed.parameters & frozenset(varied))
        self._in_state = in_state
        self._hold(frozenset())
        # from zero the search of IDAS for forces that depend on reactions, |λ|, may fail
        self._unknowns = perturbed(np.r_[start.a, start.lam]) if self._dae.z.numel() else np.zeros(0)
        #: pieces of the whole motion, at whose ends the state is brought back onto the constraints
        self.pieces = 1
        if self._reversible and self.signals.is_sampled:
            # CasADi does not restart IDAS where samples change, and repeats stretches of the motion with the samples
            # of another interval for the adjoint: gradients were off by up to a third, and where the repetition took
            # more steps than the motion it ended the process. Each interval is an integration of its own.
            self.pieces = grid.size - 1
        #: coordinates at the outputs at the typical parameters (n_t, n); none if that run fails
        typical = numeric.p, signals.level_values, self.channel()
        self.poses = self.poses_from(np.r_[start.q, start.v, start.z], *typical)
        self._cut_where_it_drifts()

    def _hold(self, active: frozenset[int]) -> None:
        """Hold the switches in the state and the active ones in time, and compile the system."""
        in_time = frozenset(self._in_time.nodes)
        nodes = frozenset().union(*[part.nodes for part in self._parts])
        free = in_time - active if self._in_state else nodes - active
        self._active = active
        self._system = HeldSystem(
            self.numeric,
            self.signals,
            self._integrands,
            redundant=self.redundant,
            parts=self._parts,
            free=free,
            in_time=in_time,
        )
        self._dae = self.form.dae(self._system.numeric, self._system.signals, self._system.integrands)
        self._compiled = CompiledIntegrator(self._dae, self._integrator)
        if self._reversible:
            first = self._system.numeric.eom.p.numel()
            levels = range(first, first + self.signals.levels.numel())
            self._backwards = ReversibleIntegrator(self._dae, self._integrator, self._given | frozenset(levels))

    @property
    def follows_state(self) -> bool:
        """True if a course depends on the start: there are switches in the state."""
        return not np.all(self._system.in_time)

    @property
    def needs_start(self) -> bool:
        """True if a course depends on the start, or its steps on what the motion meets."""
        return self.follows_state or self.load_limit.is_needed

    @property
    def channel_size(self) -> tuple[int, int]:
        """Rows and columns of the channel of sampled inputs."""
        rows = self.signals.channel.numel()
        return rows, self.grid.size - 1 if rows else 0

    def channel(self) -> np.ndarray:
        """Values of the channel as the inputs were given."""
        return channel_over(self.signals, self.grid)

    def _stretch(self, first: int, last: int) -> np.ndarray:
        """Times of the grid from one to another, both included."""
        return self.grid[first:] if last == -1 else self.grid[first : last + 1]

    @property
    def _decay(self) -> float:
        """Rate at which drift decays in the regularised form."""
        return DECAY * PIECES / float(self.grid[-1] - self.grid[0])

    def _max_step(self, timed: TimeDependence) -> float | None:
        """Longest step; free flight has steps that jump over short contacts, and over what passes quickly."""
        span = float(self.grid[-1] - self.grid[0])
        watched = span / WATCH_POINTS if self._has_gaps else None
        limits = timed.max_step, watched, self.load_limit.max_step
        return min([limit for limit in limits if limit is not None], default=None)

    # --- the course at values of the parameters -----------------------------------------------
    def course(
        self,
        x0: np.ndarray | None,
        p: np.ndarray,
        levels: np.ndarray,
        channel: np.ndarray,
        first: int = 0,
        last: int = -1,
    ) -> Cuts:
        """Find where the motion is cut.

        Parameters
        ----------
        x0 : numpy.ndarray or None
            Start ``(q, v, z)``; not needed unless the motion :attr:`needs_start`.
        p, levels, channel : numpy.ndarray
            Values of the parameters, of the inputs that are numbers, and of sampled inputs in the stretch.
        first, last : int
            Stretch of the grid.

        Raises
        ------
        SimulationError
            At a jump through which no derivative can be carried, with the name of the element.
        """
        key = (*[None if a is None else a.tobytes() for a in (x0, p, levels, channel)], first, last)
        if key not in self._courses:
            self._courses[key] = self._found_course(x0, p, levels, channel, first, last)
            while len(self._courses) > COURSES:
                self._courses.popitem(last=False)
        return self._courses[key]

    def _found_course(
        self, x0: np.ndarray | None, p: np.ndarray, levels: np.ndarray, channel: np.ndarray, first: int, last: int
    ) -> Cuts:
        if x0 is not None:
            self.load_limit.look(x0, p, levels, channel, first, last)
        grid, whole = self._stretch(first, last), self.grid
        timed = dependence_at(self._timed, p, float(whole[0]), float(whole[-1]))
        obstacle = timed.obstacle()
        if obstacle is not None:
            raise obstacle
        width = resolution(float(whole[0]), float(whole[-1]))
        # what jumps may not do so at the typical motion, or two jumps of one instant may cancel there
        breaks = np.union1d(timed.jumps, timed.stops)
        flips = self._in_time.sides(breaks - width, p) != self._in_time.sides(breaks + width, p)
        flipping = np.any(flips, axis=1) & self._in_time.jump
        if np.any(flipping & self._varied) or timed.velocity_jumps or self.follows_state:
            needed = frozenset(node for node, flip in zip(self._in_time.nodes, flipping, strict=True) if flip)
            if not needed <= self._active:
                self._hold(self._active | needed)
        # at the end of the whole motion no cut is made: nothing comes after it
        at_end = self._in_time.sides(whole[-1:] - width, p) != self._in_time.sides(whole[-1:] + width, p)
        at_end = at_end[:, 0] & self._in_time.jump & self._varied
        for name, flips in zip(self._in_time.descriptions, at_end, strict=True):
            if flips:
                self._warn_at_output(name, float(whole[-1]))
        system = self._system
        if not system.size:
            return Cuts(timed.stops, timed.jumps, self._max_step(timed))
        places = {node: k for k, node in enumerate(self._in_time.nodes)}
        own = np.array([places.get(switch.node, -1) for switch in system.switches])

        def in_time(time: float) -> np.ndarray:
            """Sides of the switches in time at an instant, of others zero."""
            sides = self._in_time.sides(np.array([time]), p)[:, 0]
            return np.where(system.in_time, sides[own], 0.0) if sides.size else np.zeros(system.size)

        max_step = self._max_step(timed)
        passage = BorderPassage(
            system,
            self._compiled,
            grid,
            np.r_[x0, np.zeros(self.integrals)] if self.follows_state else None,
            p=p,
            levels=levels,
            channel=channel,
            stops=np.union1d(timed.stops, timed.jumps),
            max_step=max_step,
            watch_step=float(whole[-1] - whole[0]) / WATCH_POINTS,
            unknowns=self._unknowns,
            rate=self._decay,
            in_time=in_time(float(grid[0]) + width),
        )
        natural = []
        for time in breaks[(breaks > grid[0] + width) & (breaks <= grid[-1] + width)]:
            sides = in_time(time + width)
            flipped = np.flatnonzero(system.in_time & (sides != in_time(time - width)))
            if flipped.size:
                passage.advance(float(time))
                strikes = any(abs(jump.time - time) <= 2 * width for jump in timed.velocity_jumps)
                passage.change(flipped.tolist(), sides, impulse=strikes)
            elif time in timed.jumps:
                natural.append(float(time))
        passage.advance(float(grid[-1]))
        self._report_one_sided(passage)
        for k in passage.at_borders():
            self._warn_at_output(system.switches[k].description, float(grid[-1]))
        return _with_stops(grid, passage, timed.stops, np.array(natural), max_step)

    def _report_one_sided(self, passage: BorderPassage) -> None:
        """Warn of switches at which the derivatives to both sides differ: at an output, or several at one instant.

        A switch in time whose instant no parameter moves has no derivative of its own.
        """
        places = {node: k for k, node in enumerate(self._in_time.nodes)}

        def moves(k: int) -> bool:
            place = places.get(self._system.switches[k].node)
            return place is None or bool(self._varied[place])

        together: list[str] = []
        previous: Cut | None = None
        for cut in (c for c in passage.cuts if c.switches):
            names = list(dict.fromkeys(self._system.switches[k].description for k in cut.switches[:1] if moves(k)))
            together = together if previous is not None and cut.joined and cut.time == previous.time else []
            previous, before = cut, together
            together = [*before, *names]
            if before and names:
                self._warn_once(
                    f"{' and '.join(dict.fromkeys(together))} jump together at t = {cut.time:.6g} s, in an order that "
                    "changes with the parameters: derivatives from there on hold for the order taken, to one side alone"
                )
            elif names and cut.at_output:
                self._warn_at_output(names[0], cut.time)

    def _warn_at_output(self, name: str, time: float) -> None:
        self._warn_once(
            f"{name} jumps at the output t = {time:.6g} s: derivatives at this output are those before the jump, to "
            "one side alone; move the output off the jump"
        )

    def _warn_once(self, sentence: str) -> None:
        # without switches in the state nothing is differentiated
        if self._in_state and sentence not in self._warned:
            self._warned.add(sentence)
            warn(sentence)

    # --- the motion ----------------------------------------------------------------------------
    def motion(self, course: Cuts, first: int = 0, last: int = -1) -> ca.Function:
        """Return ``(x0, p, levels, channel, cuts, sides, borders) -> (X, end)`` over a stretch of the grid.

        The states stand by column (n_x, n_t): ``(q, v, z)``, integrals, and a
        clock; `end` is the state on the constraints after the last cut. The last
        three arguments are those of the course, and of others of its pattern.
        Pieces of equal steps share a compiled integrator.
        """
        grid = self._stretch(first, last)
        size, rows = self._dae.x.numel() - self.integrals, self.channel_size[0]
        x0, p = ca.MX.sym("x0", size), ca.MX.sym("p", self.numeric.eom.p.numel())
        levels = ca.MX.sym("levels", self.signals.levels.numel())
        channel = ca.MX.sym("channel", rows, grid.size - 1 if rows else 0)
        cuts, sides, borders = course.symbols
        walk = _Walk(self, course, grid, ca.vertcat(x0, ca.MX.zeros(self.integrals + 1)), (p, levels, channel), sides)
        walk.run(cuts, borders)
        arguments = [x0, p, levels, channel, cuts, sides, borders]
        names = ["x0", "p", "levels", "channel", "cuts", "sides", "borders"]
        return ca.Function("motion", arguments, [ca.horzcat(*walk.columns), walk.end()], names, ["X", "end"])

    def schedule(self, course: Cuts, grid: np.ndarray) -> list[Piece]:
        """Pieces of a stretch without cuts: up to jumps of the equations, and ends at which drift is taken away."""
        schedule = Schedule(grid, stops=course.stops, jumps=course.jumps)
        intervals = grid.size - 1
        count = max(1, min(intervals, round(self.pieces * intervals / (self.grid.size - 1))))
        ends = grid[[part[-1] + 1 for part in np.array_split(np.arange(intervals), count)]]
        ends = np.r_[ends, course.stops] if self._reversible else ends
        lasts = {schedule.index_after(float(end) + schedule.tolerance) - 1 for end in ends}
        pieces, first, start = [], 0, float(grid[0])
        while first < schedule.size:
            last = min([schedule.next_break(first), *[k for k in lasts if k >= first]])
            pieces.append(schedule.piece(start, first, last))
            first, start = last + 1, float(schedule.times[last])
        return pieces

    def integrated(
        self,
        x: ca.MX,
        start: Any,
        length: Any,
        fractions: np.ndarray,
        stops: np.ndarray,
        least_steps: int,
        parameters: tuple[ca.MX, ca.MX],
        channel: ca.MX | None,
    ) -> ca.MX:
        """States, with the clock of the whole stretch, at fractions of a piece (n_x, k)."""
        # the rate at which drift decays in the regularised form comes last
        arguments: dict[str, Any] = {
            "x0": ca.vertcat(x[:-1], 0),
            "p": ca.vertcat(start, length, *parameters, self._decay),
        }
        if self._unknowns.size:
            arguments["z0"] = self._unknowns
        if self._reversible:
            assert not np.any(stops[:-1])
            arguments |= {} if channel is None else {"u": channel}
            states = self._backwards.function(fractions, least_steps=least_steps)(**arguments)["xf"]
        else:
            given = self._compiled.inputs(None if channel is None else np.zeros(channel.shape), stops, fractions.size)
            if given["u"] is not None:
                stop = ca.MX(ca.DM(given["u"][0 if channel is None else channel.shape[0] :, :]))
                arguments["u"] = stop if channel is None else ca.vertcat(channel, stop)
            function = self._compiled.function(
                fractions, groups=given["groups"], steps=MAX_STEPS, least_steps=least_steps
            )
            states = function(**arguments)["xf"]
        return ca.vertcat(states[:-1, :], x[-1] + length * states[-1, :])

    def least_steps(self, length: float, course: Cuts) -> int:
        """Least number of steps over a piece."""
        return self._compiled.least_steps(length, course.max_step)

    def through(
        self, cut: Cut, time: ca.MX, x: ca.MX, border: ca.MX, p: ca.MX, after: ca.MX, levels: ca.MX, channel: ca.MX
    ) -> ca.MX:
        """The state beyond a cut, as a function of the state at its time and of the parameters before and after it."""
        system, y = self._system, x[:-1]
        w, rates, before = system.switching(time, y, p, levels, channel)
        first = cut.switches[0]
        delta = (border - w[first]) / rates[first]
        y = y + before * delta
        if cut.impulse:
            n, mass = system.numeric.eom.q.numel(), system.numeric.mass
            weights = ca.DM(np.where(mass > 0, mass, system.numeric.weights))
            v = y[n : 2 * n]
            for _ in range(2):  # the second step removes the regularisation of the first
                v = system.recovery.velocity_step(time, y[:n], v, after, weights)
            y = ca.vertcat(y[:n], v, y[2 * n :])
        return ca.vertcat(y - system.rates(time, y, after, levels, channel) * delta, x[-1])

    def on_constraints(self, time: Any, x: Any, p: Any) -> Any:
        """A state, with whatever stands below it, on the constraints with their switches held."""
        return _projected(self._system.recovery, time, x, p)

    def poses_from(self, x0: np.ndarray, p: np.ndarray, levels: np.ndarray, channel: np.ndarray) -> np.ndarray:
        """Coordinates at the outputs of one run (n_t, n); none if it fails, which a later one reports."""
        n = self.numeric.eom.q.numel()
        course = self.course(x0, p, levels, channel)
        try:
            states = call(self.motion(course), x0, p, levels, channel, *course.arguments)[0].full()
        except RuntimeError:
            return np.zeros((0, n))
        return states[:n].T if self.reached(states) else np.zeros((0, n))

    def _cut_where_it_drifts(self) -> None:
        """Cut the motion into as many pieces as keep its drift near the tolerance, by the first run.

        Drift grows with the square of the time since the state was last on the
        constraints; each cut starts the integrator again, which costs.
        """
        if not self.numeric.eom.Phi.numel() or not len(self.poses):
            return
        drift = max(largest(self.numeric.position(float(t), q)[0]) for t, q in zip(self.grid, self.poses, strict=True))
        needed = np.clip(np.ceil(np.sqrt(drift / (ACCEPTED * self._abstol))), 1, min(PIECES, self.grid.size - 1))
        self.pieces = max(self.pieces, int(needed))

    def reached(self, states: np.ndarray, first: int = 0) -> bool:
        """True if an integration got to its end, by its clock, and all is finite."""
        offsets = self.grid[first:][: states.shape[1]] - self.grid[first]
        on_time = np.abs(states[-1] - offsets) <= 1e-6 * offsets[-1]
        return bool(np.all(np.isfinite(states))) and bool(np.all(on_time))

    # --- outputs -------------------------------------------------------------------------
    def outputs(self, expressions: Sequence[ca.SX], first: int = 0, last: int = -1) -> ca.Function:
        """Return ``(X, p, levels, channel) -> Y``: expressions, stacked, at every output of a stretch (n_y, n_t)."""
        eom = self.numeric.eom
        at_one = self.at_one_output(ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in expressions]))
        grid = self._stretch(first, last)
        n_t, rows = grid.size, self.channel_size[0]
        states = ca.MX.sym("X", self._dae.x.numel() + 1, n_t)
        p, levels = ca.MX.sym("p", eom.p.numel()), ca.MX.sym("levels", self.signals.levels.numel())
        channel = ca.MX.sym("channel", rows, n_t - 1 if rows else 0)
        # the interval that ends at an output holds its inputs too; the first output takes the first interval
        before = [max(k - 1, 0) for k in range(n_t)]
        by_output = channel[:, before] if rows else ca.MX(0, n_t)
        values = at_one.map(n_t)(
            ca.DM(grid).T, states[:-1, :], ca.repmat(p, 1, n_t), ca.repmat(levels, 1, n_t), by_output
        )
        names = ["X", "p", "levels", "channel"]
        return ca.Function("outputs", [states, p, levels, channel], [values], names, ["Y"])

    def at_one_output(self, expression: ca.SX) -> ca.Function:
        """``(t, x, p, levels, channel) -> values`` at one output."""
        eom, kind = self.numeric.eom, ca.MX if self.numeric.eom.Q_depends_on_lam else ca.SX
        arguments = [
            kind.sym(name, size)
            for name, size in (
                ("t", 1),
                ("x", self._dae.x.numel()),
                ("p", eom.p.numel()),
                ("levels", self.signals.levels.numel()),
                ("channel", self.channel_size[0]),
            )
        ]
        t, x, p, levels, channel = arguments
        n, k = eom.q.numel(), eom.z.numel()
        x = _projected(Recovery(self.numeric, redundant=self.redundant), t, x, p)
        q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + k]
        signals = self.signals
        known = [eom.t, eom.q, eom.v, eom.z, eom.p, signals.levels, signals.channel]
        inputs = ca.Function("u", known, [signals.parametrised])
        u = inputs(t, q, v, z, p, levels, channel)
        a, lam = self.numeric.forward_dynamics(redundant=self.redundant)(t, q, v, z, u, p)
        values = eom.function(expression)(t, q, v, a, z, lam, u, p)
        return ca.Function("output", arguments, [values])


def channel_over(signals: Signals, grid: np.ndarray) -> np.ndarray:
    """Values of the channel of sampled inputs in the intervals of a grid (rows, k)."""
    channel = signals.channel_from(grid[:-1])
    return np.zeros((0, 0)) if channel is None else channel


class _Walk:
    """A motion that is put together from pieces and cuts."""

    def __init__(
        self,
        motion: DifferentiableMotion,
        course: Cuts,
        grid: np.ndarray,
        x: ca.MX,
        arguments: tuple[ca.MX, ca.MX, ca.MX],
        sides: ca.MX,
    ):
        self._motion, self._course, self._grid, self._x = motion, course, grid, x
        self._p, self._levels, self._channel = arguments
        self._sides, self._sampled = sides, bool(motion.channel_size[0])
        self._piece, self._begin, self._on_constraints = 0, float(grid[0]), True
        self.columns = [x]

    def run(self, times: ca.MX, borders: ca.MX) -> None:
        """Go over the grid.

        Parameters
        ----------
        times, borders : casadi.MX
            Times and borders of the cuts.
        """
        by_interval: dict[int, list[int]] = {}
        for k, cut in enumerate(self._course.cuts):
            by_interval.setdefault(cut.interval, []).append(k)
        interval, last = 0, self._grid.size - 1
        while interval < last:
            if interval in by_interval:
                self._cut_interval(interval, by_interval[interval], times, borders)
                interval += 1
                continue
            end = min([k for k in by_interval if k > interval], default=last)
            for piece in self._motion.schedule(self._course, self._grid[interval : end + 1]):
                self._fixed(piece)
            interval = end

    def end(self) -> ca.MX:
        """The state on the constraints, after all cuts, without the clock."""
        return self._motion.on_constraints(float(self._grid[-1]), self._x, self._parameters(self._piece))[:-1]

    def _parameters(self, piece: int) -> ca.MX:
        return ca.vertcat(self._p, self._sides[:, piece])

    def _project(self) -> None:
        if not self._on_constraints:
            self._x = self._motion.on_constraints(self._begin, self._x, self._parameters(self._piece))
            self._on_constraints = True

    def _fixed(self, piece: Piece) -> None:
        """Go over a piece between times of the grid."""
        self._project()
        start, times = piece.inside
        length = float(times[-1] - start)
        fractions = np.r_[(times[:-1] - start) / length, 1.0]
        interval = np.clip(np.searchsorted(self._grid, piece.begins, side="right") - 1, 0, self._grid.size - 2)
        states = self._motion.integrated(
            self._x,
            start,
            length,
            fractions,
            piece.stops,
            self._motion.least_steps(length, self._course),
            (self._parameters(self._piece), self._levels),
            self._channel[:, interval.tolist()] if self._sampled else None,
        )
        self.columns.append(states[:, np.flatnonzero(piece.wanted).tolist()])
        self._x, self._begin, self._on_constraints = states[:, -1], float(piece.times[-1]), False

    def _cut_interval(self, interval: int, cuts: Sequence[int], times: ca.MX, borders: ca.MX) -> None:
        """Go over an output interval with cuts in it."""
        for k in cuts:
            cut = self._course.cuts[k]
            if not cut.joined:
                self._moving(interval, times[k])
            self._project()
            if cut.at_output and not cut.joined:
                self.columns.append(self._x)
            if cut.switches:
                channel = self._channel[:, interval] if self._sampled else ca.MX(0, 1)
                self._x = self._motion.through(
                    cut,
                    times[k],
                    self._x,
                    borders[k],
                    self._parameters(k),
                    self._parameters(k + 1),
                    self._levels,
                    channel,
                )
            self._piece = k + 1
        if not self._course.cuts[cuts[-1]].at_output:
            self._moving(interval, float(self._grid[interval + 1]))
            self.columns.append(self._x)

    def _moving(self, interval: int, end: Any) -> None:
        """Go over a piece of which one end, or both, are arguments."""
        self._project()
        length = float(self._grid[interval + 1] - self._grid[interval])
        states = self._motion.integrated(
            self._x,
            self._begin,
            end - self._begin,
            np.ones(1),
            np.zeros(1, bool),
            self._motion.least_steps(length, self._course),
            (self._parameters(self._piece), self._levels),
            self._channel[:, interval] if self._sampled else None,
        )
        self._x, self._begin, self._on_constraints = states, end, False


def _with_stops(
    grid: np.ndarray, passage: BorderPassage, stops: np.ndarray, jumps: np.ndarray, max_step: float | None
) -> Cuts:
    """The course of a passage; in intervals that are cut, stops are cuts too, since what lies between may change."""
    cut_intervals = {cut.interval for cut in passage.cuts}
    cuts = list(passage.cuts)
    kept: dict[str, np.ndarray] = {}
    tolerance = 1e-9 * float(grid[-1] - grid[0])
    for name, times in (("stops", stops), ("jumps", jumps)):
        inside = times[(times > grid[0]) & (times < grid[-1])]
        intervals = np.searchsorted(grid, inside) - 1
        moved = np.isin(intervals, list(cut_intervals))
        kept[name] = inside[~moved]
        for time, interval in zip(inside[moved], intervals[moved], strict=True):
            others = [*grid[interval : interval + 2], *[cut.time for cut in cuts]]
            if np.min(np.abs(np.array(others) - time)) > tolerance:
                cuts.append(Cut(float(time), int(interval), False, False, (), 0.0, ()))
    cuts.sort(key=lambda cut: cut.time)
    sides = tuple(passage.first_sides.tolist())
    filled, now = [], sides
    for cut in cuts:
        now = cut.sides or now
        filled.append(replace(cut, sides=now))
    return Cuts(kept["stops"], kept["jumps"], max_step, tuple(filled), sides)


def _projected(recovery: Recovery, time: Any, x: Any, p: Any) -> Any:
    """A state, with whatever stands below it, brought onto the constraints."""
    eom, n = recovery.numeric.eom, recovery.numeric.eom.q.numel()
    q, v, weights = x[:n], x[n : 2 * n], ca.DM(recovery.numeric.projection_weights)
    if eom.Phi.numel():
        q = recovery.position_step(time, q, p, weights)[0]
    if eom.lam.numel():
        v = recovery.velocity_step(time, q, v, p, weights)
    return ca.vertcat(q, v, x[2 * n :])
