"""Motions through several mechanisms made of the same bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ..equations.public import Equations, equations
from ..model.cache import ExpressionKey
from ..model.mechanism import Mechanism
from ..model.symbols import Expression, as_expression
from ..numerics.lazy import cached_property
from .motion import Energy, Statistics
from .state import Arguments, Arrays, EventOccurrence, State, six
from .trajectory import Trajectory


def union_of(mechanisms: Iterable[Mechanism]) -> Mechanism:
    """Return a mechanism with all parts of several, in whose symbols a motion through them is expressed.

    It is for names and symbols; nothing moves by its equations. Of forces with the same name, such as gravity, only
    the first one is taken. A :class:`ModelError` is raised if different joints, inputs, parameters or states have the
    same name.
    """
    different = list(dict.fromkeys(mechanisms))
    if len(different) == 1:
        return different[0]
    names = ("bodies", "joints", "drivers", "inputs", "parameters")
    parts = {name: list(dict.fromkeys(x for m in different for x in getattr(m, name))) for name in names}
    forces: list[Any] = []
    for mechanism in different:
        for force in mechanism.forces:
            twin = any(force.name == x.name for x in forces) and not (force.rates or force.multipliers.numel())
            if not twin and force not in forces:
                forces.append(force)
    states: dict[Any, Any] = {}
    values: dict[Any, float] = {}
    for mechanism in different:
        states, values = mechanism.own_states | states, mechanism.values | values
    name = next((m.name for m in different if m.name), "")
    return Mechanism(**parts, forces=forces, states=states, name=name, values=values)


def places_in(whole: ca.SX, part: ca.SX) -> list[int]:
    """Return the places of the entries of a column of symbols in another one."""
    place = {symbol.element_hash(): k for k, symbol in enumerate(ca.vertsplit(whole))}
    return [place[symbol.element_hash()] for symbol in ca.vertsplit(part)]


def present(expression: ca.SX, whole: Mechanism, mechanism: Mechanism) -> ca.SX:
    """Return an expression without the reactions of joints that a mechanism does not have.

    The rest no longer depends on the bodies of such a joint, which may be absent.
    """

    def make() -> tuple[ca.SX, ca.SX]:
        all_of, here = equations(whole), equations(mechanism)
        known = {s.element_hash() for s in ca.vertsplit(here.lam)}
        absent = ca.vertcat(ca.SX(0, 1), *[s for s in ca.vertsplit(all_of.lam) if s.element_hash() not in known])
        return ca.substitute(expression, absent, ca.SX.zeros(absent.numel())), expression

    key = mechanism, ExpressionKey(expression)
    factor: ca.SX = whole.cache.get_or_create(key, make, bounded=True)[0]
    return factor


class _WideState(State):
    """A state of one mechanism in the symbols of all mechanisms of a motion."""

    def __init__(self, here: Mechanism, *arguments: Any):
        super().__init__(*arguments)
        self._here = here

    def __getitem__(self, expression: Any) -> float | np.ndarray:
        return super().__getitem__(present(as_expression(expression, "state[…]"), self.mechanism, self._here))


def in_whole(state: State, whole: Mechanism, parameters: np.ndarray) -> State:
    """Return a state of one mechanism that knows the symbols of all mechanisms of its motion.

    Reactions of joints that are not there are zero; coordinates of bodies that are not there are NaN.
    """
    if state.mechanism is whole:
        return state
    arrays = _widened(equations(whole), [(state.equations, [x[None] for x in state.arguments[1:-1]])])
    wide = _WideState(state.mechanism, whole, state.t, *arrays, parameters)
    return State(state.mechanism, *state.arguments, state.obstacle, state.impulses, wide)


def _widened(whole: Equations, parts: Sequence[tuple[Equations, Sequence[np.ndarray]]]) -> Arrays:
    """``q, v, a, z, lam, u`` by time in the symbols of all mechanisms, from those of parts that follow each other."""
    wide = []
    for k, name in enumerate(("q", "v", "a", "z", "lam", "u")):
        symbols, rows = getattr(whole, name), []
        for eom, arrays in parts:
            values = np.full((len(arrays[k]), symbols.numel()), 0.0 if name == "lam" else np.nan)
            values[:, places_in(symbols, getattr(eom, name))] = arrays[k]
            rows.append(values)
        wide.append(np.vstack(rows))
    return six(wide)


class PhasedTrajectory(Trajectory):
    """A motion through several mechanisms; any expression of any of them evaluates over all of it.

    Reactions of joints that are not there are zero, quantities of bodies that are not there NaN. The times hold the
    instant of each change twice: just before and just after.

    Parameters
    ----------
    parts : sequence of Trajectory
        Motions in one mechanism each, in the order of time.
    whole : Mechanism
        All their parts, see :func:`union_of`.
    parameters : sequence of numpy.ndarray
        Values of all parameters, by part.
    events : sequence of EventOccurrence
        Events that took place, those of the changes included.
    statistics : Statistics, optional
        Statistics of the run.
    """

    def __init__(
        self,
        parts: Sequence[Trajectory],
        whole: Mechanism,
        parameters: Sequence[np.ndarray],
        *,
        events: Sequence[EventOccurrence] = (),
        statistics: Statistics | None = None,
    ):
        self._parts, self._values = tuple(parts), [np.asarray(p, float) for p in parameters]
        self._starts = np.cumsum([0, *map(len, parts)])
        arrays = _widened(equations(whole), [(part.equations, part.arguments[1:-1]) for part in parts])
        missing = next((p.missing_multipliers for p in parts if p.missing_multipliers), "")
        more: dict[str, Any] = {"events": events, "statistics": statistics, "missing_multipliers": missing}
        super().__init__(whole, np.concatenate([part.t for part in parts]), *arrays, self._values[0], **more)

    @property
    def phases(self) -> tuple[Trajectory, ...]:
        """The motion in each mechanism, one after the other."""
        return self._parts

    @property
    def parameters_by_phase(self) -> list[np.ndarray]:
        """Values of the parameters of all mechanisms, by phase."""
        return self._values

    @cached_property
    def _wide(self) -> list[Trajectory]:
        """The parts in the symbols of all mechanisms."""
        columns, wide = self.arguments[1:-1], []
        for part, p, (first, last) in zip(self._parts, self._values, pairwise(self._starts), strict=True):
            t, arrays = self.t[first:last], six(x[first:last] for x in columns)
            wide.append(Trajectory(self.mechanism, t, *arrays, p, missing_multipliers=part.missing_multipliers))
        return wide

    def __getitem__(self, expression: Expression) -> np.ndarray:
        expression = as_expression(expression, "motion[…]")
        parts = zip(self._wide, self._parts, strict=True)
        return np.concatenate([wide[present(expression, self.mechanism, part.mechanism)] for wide, part in parts])

    @property
    def arguments(self) -> Arguments:
        """``(t, q, v, a, z, lam, u, p)`` for compiled expressions, by time (n_t, k)."""
        by_time = np.repeat(np.array(self._values), np.diff(self._starts), axis=0)
        return (*super().arguments[:-1], by_time.reshape(len(self), self.parameters.size))

    def state(self, index: int) -> State:
        """State at one of the times, by index, in the mechanism that holds there."""
        k = self.place(index)
        number = int(np.searchsorted(self._starts, k, side="right")) - 1
        state = self._parts[number].state(k - int(self._starts[number]))
        return in_whole(state, self.mechanism, self._values[number])

    def at(self, times: Any) -> PhasedTrajectory:
        """Return the motion at other times within its span; at a change it is the one just before."""
        return self.by_parts(self._within(times), Trajectory.at)

    def by_parts(self, times: np.ndarray, at: Callable[[Trajectory, np.ndarray], Trajectory]) -> PhasedTrajectory:
        """Return the motion at times within its span, each part by a function of it and of its times."""
        begins = np.array([part.t[0] for part in self._parts])
        number = np.maximum(np.searchsorted(begins, times, side="left") - 1, 0)
        cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), times.size]
        runs = [(int(number[a]), times[a:b]) for a, b in pairwise(cuts)]
        # rounding of an output at the end of a part
        pieces = [at(self._parts[k], np.clip(some, *self._parts[k].t[[0, -1]])) for k, some in runs]
        return PhasedTrajectory(pieces, self.mechanism, [self._values[k] for k, _ in runs])

    @property
    def interpolates(self) -> bool:
        """True if :meth:`at` can interpolate."""
        return all(part.interpolates for part in self._parts)

    @property
    def knots(self) -> np.ndarray:
        """Times between which polynomials of degree five follow the motion, s; both sides of each jump."""
        found = [np.r_[np.nextafter(part.t[0], np.inf), part.knots] for part in self._parts]
        times = np.unique(np.concatenate(found))
        return times[times <= self.t[-1]]

    def appearances(self, part: Any) -> tuple[float, ...] | None:
        """Return the times at which a body or an element appears and disappears in turn, s; None if it stays.

        One that is there from the start appears at the start, one that is never there not at all. Forces of one name
        are the same one.
        """
        there = [
            any(type(x) is type(part) and x.name == part.name for x in (*m.bodies, *m.joints, *m.drivers, *m.forces))
            for m in (phase.mechanism for phase in self._parts)
        ]
        turns = zip(self._parts, [False, *there], there, strict=False)
        return None if all(there) else tuple(float(phase.t[0]) for phase, before, now in turns if before != now)

    @cached_property
    def last_seen(self) -> np.ndarray:
        """Last known values of the coordinates (n,)."""
        known = np.isfinite(self.q)
        last = len(self) - 1 - np.argmax(known[::-1], axis=0)
        return np.asarray(self.q[last, np.arange(self.q.shape[1])])

    def with_absent_bodies(self, of: PhasedTrajectory | None = None) -> Trajectory:
        """Return the motion with bodies that have left where they were last seen, at rest: for pictures.

        Parameters have their last values. Both are those of the motion `of` if this is a part of one.
        """
        last = self if of is None else of
        q = np.where(np.isnan(self.q), last.last_seen, self.q)
        arrays = six([q, *(np.nan_to_num(x) for x in self.arguments[2:-1])])
        return Trajectory(self.mechanism, self.t, *arrays, last._values[-1], events=self.events)

    @property
    def violations(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest ``|Phi|`` and largest ``|Phi_q v - nu|`` over time, each (n_t,), of the rows that hold."""
        position, velocity = (np.concatenate(x) for x in zip(*(part.violations for part in self._parts), strict=True))
        return position, velocity

    @property
    def energy(self) -> Energy:
        """Kinetic and potential energy of the bodies that are present, J; it falls by the loss of each impact."""
        energies = [part.energy for part in self._parts]
        return Energy(*(np.concatenate([getattr(e, name) for e in energies]) for name in ("kinetic", "potential")))
