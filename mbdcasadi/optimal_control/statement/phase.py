"""A phase of a motion: one mechanism, and what it must do from a start to an end."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...equations import Equations, equations
from ...equations.impact_law import ImpactLaw
from ...errors import ExpressionError, ModelError
from ...model.conditions import Condition, SoftRelations, read_conditions
from ...model.events import read_restitution
from ...model.immutable import Immutable
from ...model.mechanism import Mechanism
from ...model.placeholders import marked, markers_of
from ...model.quantities import entries, is_relation, quantity
from ...model.rates import time_derivative
from ...model.symbols import Parameter, Scalar, as_sx, check_name, place_of, role_of, symbols_of
from ...model.symbols import t as time
from ...model.texts import text_of
from ...numerics.lazy import cached_property
from ...numerics.symbolic import symbolic
from ...results.state import Conditions, State
from .cost_parts import CostParts, SoftLimit, hard_and_soft, parameter_parts, price, split_along_path
from .state_conditions import independent_state_conditions
from .time_span import span_text, time_span

#: Kinds of symbols whose values positions, velocities and first-order states do not decide.
BEYOND_STATES = ("acceleration", "multiplier", "impulse", "input", "input rate")


class Waypoint(Immutable):
    """Conditions that a motion meets on its way.

    Parameters
    ----------
    time : float, (float, float) or between
        Time, s; two numbers: free between them, with :func:`between` from a guess.
    conditions : sequence of relations, or State, default ()
        A state fixes coordinates and velocities, those of a resting pose for instance. Relations are in any expression
        of the model, :func:`soft` ones too; accelerations, reactions and inputs are those just before that time.
        Without conditions, a waypoint puts a mesh point at its time, for instance where an input jumps. A free one
        finds the jump with ``control="constant"``; polynomials imitate a jump inside an interval as well, and
        ``optimize(tolerance=…)`` finds it for them.
    cost : expression, default 0
        Added to the cost, with the values of that time; :func:`positive_part` and :func:`absolute` of an expression add
        a free parameter each.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> cart = mbd.Body("cart", mass=1, inertia=1)
    >>> mbd.Waypoint((0.2, 0.8), [cart.x == 0.5, cart.y >= 0.1])
    Waypoint(0.2 … 0.8 s: cart.x == 0.5, 0.1 <= cart.y)
    """

    _symbolic = True

    def __init__(self, time: float | tuple[float, float], conditions: State | SoftRelations = (), cost: Scalar = 0):
        self.time = time_span(time, "Waypoint", "time")
        given = independent_state_conditions(conditions) if isinstance(conditions, State) else conditions
        self.conditions: tuple[Condition, ...]
        self.conditions, self.soft_limits = hard_and_soft(given)
        #: cost without soft limits
        self.own_cost = read_cost(cost, "cost of a waypoint")
        self.cost = self.own_cost + price(self.soft_limits)
        #: parameters in place of parts of the cost
        self.parameters: tuple[Parameter, ...] = ()

    def __repr__(self) -> str:
        conditions = ", ".join(c.label for c in self.conditions)
        return f"Waypoint({span_text(self.time)}{': ' if conditions else ''}{conditions})"


class _SplitWaypoint(Waypoint):
    """A waypoint with parameters in place of the parts in its cost."""

    def __init__(self, waypoint: Waypoint, parts: CostParts):
        cost, soft = parts.split(waypoint.own_cost, "cost of a waypoint"), parts.split_soft(waypoint.soft_limits)
        super().__init__(waypoint.time, (*waypoint.conditions, *parts.limits, *soft), cost)
        self.parameters = (*waypoint.parameters, *parts.symbols)


def _without_parts(waypoint: Waypoint) -> Waypoint:
    """A waypoint itself, or one with parameters in place of the parts in its cost."""
    parts = parameter_parts()
    split = _SplitWaypoint(waypoint, parts)
    return split if parts.symbols else waypoint


class Phase(Immutable):
    """A mechanism, and what it must do from the start to the end of a phase of the motion.

    Positions are continuous from phase to phase; velocities jump by impulses of the joints of the new mechanism,
    ``M (v⁺ - v⁻) + Phi_q^T Λ = 0``, ``Phi_q v⁺ = nu``. The mechanisms are made of the same bodies; bodies may leave.

    Parameters
    ----------
    name : str
        Name in messages.
    mechanism : Mechanism
        Model; its inputs are free.
    duration : float, (float, float) or between
        Time of the phase, s; two numbers: free between them, with :func:`between` from a guess. 0: the state just
        after a change, such as a touch-down.
    initial, final : sequence of relations, or State
        Conditions at the start and at the end; a state fixes everything, anything not stated is free. Those at the
        start hold just after the change into the phase, and may contain impulses; those at the end just before the
        change out of it, and :func:`soft` ones may be passed.
    path : sequence of relations
        Conditions that hold throughout the phase, or that may be passed at a price, see :func:`soft`.
    running_cost : expression
        Integrand of the cost; :func:`positive_part` and :func:`absolute` of an expression add an input each.
    waypoints : sequence of Waypoint
        Conditions at times in between, in the order of time, s from the start of the phase. They divide the phase
        into segments.
    restitution : mapping of joint to float, optional
        Joints that are there at the instant of the change into the phase alone, with Newton's coefficients of
        restitution e: ``Phi_q v⁺ - nu = -e (Phi_q v⁻ - nu)``.

    Attributes
    ----------
    equations : Equations
        Equations of motion of the mechanism.
    span : TimeSpan
        Limits of the duration, s, with the guess that was given.
    duration : expression
        Duration, for boundary conditions and the terminal cost.
    """

    _symbolic = True

    def __init__(
        self,
        name: str,
        mechanism: Mechanism,
        duration: float | tuple[float, float],
        initial: Conditions = (),
        final: State | SoftRelations = (),
        path: Any = (),
        running_cost: Scalar = 0,
        waypoints: Any = (),
        restitution: Any = None,
    ):
        self.name = check_name(name, "Phase")
        what = f"phase '{name}'"
        (hard, soft), cost = hard_and_soft(path), read_cost(running_cost, "running_cost")
        parts = split_along_path(
            mechanism, hard, lambda parts: (parts.split(cost, "running_cost"), parts.split_soft(soft))
        )
        #: running cost without soft limits
        self.own_cost: ca.SX
        self.mechanism, self.path, (self.own_cost, self.soft_limits) = parts
        self.running_cost = self.own_cost + price(self.soft_limits)
        self.equations: Equations = equations(self.mechanism)
        self.span = time_span(duration, what, "duration", instant=True)
        self.initial = read_state_or_conditions(initial, mechanism)
        self.soft_final: tuple[SoftLimit, ...]
        end, self.soft_final = (final, ()) if isinstance(final, State) else hard_and_soft(final)
        self.final = read_state_or_conditions(end, mechanism)
        self.waypoints = tuple(map(_without_parts, _read_waypoints(waypoints, self.span)))
        self.restitution: dict[Any, float] = read_restitution(restitution, what)
        if self.restitution:
            _ = self.law  # refuses joints that cannot bounce
        if self.is_instant:
            self._refuse_at_instant(what)

    def _refuse_at_instant(self, what: str) -> None:
        if self.path or self.waypoints or not self.running_cost.is_zero() or isinstance(self.initial, State):
            raise ModelError(
                f"{what} has no duration, and so no path=, waypoints= or running_cost=; conditions on its state are "
                "given in initial="
            )
        if isinstance(self.final, State):
            raise ModelError(f"{what} has no duration: its state follows from the impact; give conditions")

    def has(self, expression: Any) -> bool:
        """Return True if the mechanism has every symbol of an expression, rates of inputs included."""
        rates = self.input_rates
        return self.equations.contains(ca.substitute(ca.SX(expression), rates, ca.SX.zeros(rates.numel())))

    @property
    def is_instant(self) -> bool:
        """True if the phase has no duration: the state just after a change."""
        return self.span == (0.0, 0.0)

    @cached_property
    def symbol_hashes(self) -> frozenset[int]:
        """Hashes of the symbols that expressions of the phase may contain, free parameters and impulses left out."""
        eom = self.equations
        if not self.is_instant:
            return eom.symbol_hashes.union(u.rate.element_hash() for u in self.mechanism.inputs)
        return frozenset(s.element_hash() for s in ca.vertsplit(ca.vertcat(eom.t, eom.q, eom.v, eom.z, eom.p)))

    @cached_property
    def law(self) -> ImpactLaw:
        """The law by which velocities jump at the change into the phase."""
        return ImpactLaw(self.equations, self.restitution)

    @cached_property
    def markers(self) -> dict[str, tuple[ca.SX, Any]]:
        return markers_of(self.name, self)

    # --- values between the phases ------------------------------------------------------------
    def at_start(self, expression: Any) -> ca.SX:
        """Stand for the value of an expression at the start of the phase, just after the change into it."""
        return marked(self.markers["at_start"], expression)

    def at_end(self, expression: Any) -> ca.SX:
        """Stand for the value of an expression at the end of the phase, just before the change out of it."""
        return marked(self.markers["at_end"], expression)

    def integral(self, expression: Any) -> ca.SX:
        """Stand for the integral of an expression over the phase."""
        return marked(self.markers["integral"], expression)

    @property
    def duration(self) -> ca.SX:
        """Duration of the phase, s, in boundary conditions and in the terminal cost."""
        return self.at_end(time) - self.at_start(time)

    @cached_property
    @symbolic
    def input_rates(self) -> ca.SX:
        """Rates of the inputs (n_u,)."""
        return ca.vertcat(ca.SX(0, 1), *[u.rate for u in self.mechanism.inputs])

    @property
    def time_spans(self) -> list[tuple[float, float]]:
        """Limits of the times of start, waypoints and end, s."""
        return [(0.0, 0.0), *[w.time for w in self.waypoints], self.span]

    @property
    def has_free_times(self) -> bool:
        """True if the duration or the time of a waypoint is free."""
        return any(low < high for low, high in self.time_spans)

    @property
    def fewest_intervals(self) -> int:
        """Intervals that it needs: two for each stretch of the way; one between waypoints that have a cost alone."""
        others = sum(bool(waypoint.conditions) or waypoint.cost.is_zero() for waypoint in self.waypoints)
        return max(2 * (others + 1), len(self.waypoints) + 1)

    @property
    def conditions(self) -> list[Condition]:
        """All conditions but those at the start, those of a final state left out."""
        end = [] if isinstance(self.final, State) else self.final
        return [*self.path, *(c for w in self.waypoints for c in w.conditions), *end]

    def with_free(self, p: ca.SX, parameters: Sequence[Parameter], values: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return parameters of the mechanism with those that are free substituted, and the others that are free."""
        p, extra = ca.SX(p), []
        for k, symbol in enumerate(parameters):
            place = place_of(symbol, self.mechanism.parameters)
            if place is None:
                extra.append(values[k])
            else:
                p[place] = values[k]
        return p, ca.vertcat(ca.SX(0, 1), *extra)

    def segment_times(self, duration: float) -> np.ndarray:
        """Return times of start, waypoints and end to begin with: free ones at their guess, or else evenly spaced.

        Guesses move with the duration, as a share of the one to begin with.
        """
        times = [0.0]
        spans = [w.time for w in self.waypoints]
        for k, ((low, high), guess) in enumerate((span, span.guess) for span in spans):
            latest = min([duration, *[s[1] for s in spans[k + 1 :]]])
            high, low = min(high, latest), max(low, times[-1])
            remaining = len(spans) - k + 1  # segments that are still to come
            even = times[-1] + (latest - times[-1]) / remaining
            wanted = even if guess is None else guess * duration / self.span.typical
            times.append(low if low == high else float(np.clip(wanted, low, high)))
        times.append(duration)
        if np.any(np.diff(times) <= 0):
            raise ModelError(
                f"the times of the waypoints {times[1:-1]} leave no motion between them in a duration of "
                f"{duration:g} s; for free ones mbd.between(…, guess=…) gives other times to begin with"
            )
        return np.array(times)

    def __repr__(self) -> str:
        return f"Phase({self.name!r}, {self.mechanism!r}, duration {span_text(self.span)})"


def on_states(conditions: Sequence[Condition]) -> list[Condition]:
    """Conditions that positions, velocities and first-order states decide."""
    return [c for c in conditions if not c.depends_on(*BEYOND_STATES)]


def on_positions(expression: ca.SX, *, allow_none: bool = False) -> bool:
    """Return True if an expression contains positions, and nothing that changes besides."""
    condition = Condition(as_sx(expression), True, "")
    if condition.depends_on("velocity", "state", *BEYOND_STATES):
        return False
    return allow_none or condition.depends_on("position")


def with_rates(conditions: Sequence[Condition]) -> list[Condition]:
    """Conditions that prescribe the motion, and the rates of those in positions, as a state must meet them."""
    rates = [
        Condition(time_derivative(c.expression), True, f"the rate of {c.label}")
        for c in conditions
        if not c.depends_on("velocity")
    ]
    return [*conditions, *rates]


def with_parameters(
    conditions: Sequence[Condition], parameters: Sequence[Parameter], values: Mapping[Parameter, float]
) -> list[Condition]:
    """Conditions with numbers in place of some parameters."""
    if not parameters:
        return list(conditions)
    symbols, numbers = ca.vertcat(*parameters), ca.DM([values[p] for p in parameters])
    return [Condition(ca.substitute(c.expression, symbols, numbers), c.equality, c.label) for c in conditions]


def contains_any(expression: ca.SX, symbols: Sequence[ca.SX]) -> bool:
    """Return True if one of the symbols occurs in an expression."""
    known = {s.element_hash() for s in symbols}
    return bool(known) and any(s.element_hash() in known for s in symbols_of(expression))


def prescribes_motion(condition: Condition) -> bool:
    """Return True if an equality is one in positions, or linear in velocities, and so can be differentiated.

    Imposed at stages alone such a condition would be a differential-algebraic
    equation of higher index, for which collocation at Gauss points is unstable:
    it is treated like a constraint whose multipliers are the inputs.
    """
    if not condition.equality or not condition.kinds <= {"time", "position", "velocity", "parameter"}:
        return False
    if not condition.depends_on("position", "velocity"):
        return False
    velocities = [s for s in condition.symbols if (role := role_of(s)) is not None and role.kind == "velocity"]
    slopes = ca.jacobian(condition.expression, ca.vertcat(ca.SX(0, 1), *velocities))
    return not velocities or not ca.depends_on(slopes, ca.vertcat(*velocities))


# --- arguments -----------------------------------------------------------------------------
def read_cost(cost: Any, name: str) -> ca.SX:
    """Return a cost as an expression; a relation is refused."""
    value = ca.SX(quantity(cost, "OptimalControlProblem", name))
    if is_relation(value):
        raise ExpressionError(
            f"{name} is the relation {text_of(value)}; a cost is an expression, conditions go to path="
        )
    return value


def read_state_or_conditions(end: Any, mechanism: Mechanism) -> State | tuple[Condition, ...]:
    """Return conditions at the start or at the end, or a state of the mechanism, which fixes everything."""
    if not isinstance(end, State):
        return read_conditions(end)
    if end.mechanism is mechanism:
        return end
    theirs, ours = equations(end.mechanism), equations(mechanism)
    for one, other in ((theirs.q, ours.q), (theirs.z, ours.z)):
        hashes = ([s.element_hash() for s in ca.vertsplit(x)] for x in (one, other))
        if next(hashes) != next(hashes):
            raise ModelError(f"OptimalControlProblem: the state belongs to {end.mechanism!r}, not to {mechanism!r}")
    return end


def _read_waypoints(waypoints: Any, duration: tuple[float, float]) -> tuple[Waypoint, ...]:
    """Waypoints, whose times must follow each other within the duration."""
    before = (0.0, 0.0)
    result = entries(waypoints, "waypoints=")
    for k, waypoint in enumerate(result, start=1):
        if not isinstance(waypoint, Waypoint):
            raise ModelError(f"waypoints= takes Waypoint objects, got {waypoint!r}")
        low, high = waypoint.time
        if high <= before[0] or (low == high and before[0] == before[1] and low <= before[0]):
            raise ModelError(f"waypoint {k} at {high:g} s does not come after what is before it, at {before[0]:g} s")
        if low >= duration[1]:
            raise ModelError(f"waypoint {k} at {low:g} s does not come before the end at {duration[1]:g} s")
        before = waypoint.time
    return result
