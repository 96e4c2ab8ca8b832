"""Equilibria along a parameter: the path, and the points at which it loses its stability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..assembly.setup import Setup
from ..errors import EquilibriumError, ModelError, warn
from ..model.mechanism import Mechanism
from ..model.quantities import whole
from ..model.symbols import Expression, Input, Parameter, as_expression, number
from ..numerics.console import keyboard_interrupts
from ..numerics.homotopy import StepControl
from ..numerics.least_squares import largest
from ..numerics.newton import newton
from ..numerics.roots import bracketed_root
from ..numerics.tolerances import RANK
from ..results.state import Conditions
from .equilibrium import Equilibrium, equilibrium_of
from .statics import NEUTRAL, Statics

#: Most points of a path.
MOST_POINTS = 2000
#: Smallest step of a path, as a share of the usual one.
SMALLEST_STEP = 1e-6
#: Largest turn of a body in a step, rad, and of the path itself (cosine between two directions).
PATH_TURN, STRAIGHT = 0.2, 0.7
#: The same of a step after which the next one may be twice as long.
EASY_TURN, EASILY_STRAIGHT = PATH_TURN / 2, 0.9
#: Accuracy to which a critical value is found, relative to the range.
CRITICAL_ACCURACY = 1e-11


def equilibrium_path(
    mechanism: Mechanism,
    parameter: Input | Parameter,
    start: float,
    end: float,
    conditions: Conditions = (),
    *,
    steps: int = 50,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    prefer: str = "stable",
    t: float = 0.0,
) -> EquilibriumPath:
    """Follow an equilibrium while a parameter or an input changes.

    The path is followed along its length, so that it passes the points at which
    it turns back (snap-through). The critical value is located at
    which the number of negative eigenvalues of the reduced stiffness changes,
    or oscillations begin to grow with the damping that the model has (under
    loads that follow a body, feedback, or falling friction).

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    parameter : Parameter or Input
        Symbol that changes: a load, a length, a torque.
    start, end : float
        First and last value. A path that turns back may go beyond the start, by as much again.
    conditions, inputs, parameters, prefer, t
        Of the equilibrium at the start; see :func:`equilibrium`.
    steps : int, default 50
        Steps from start to end if the path is straight; it takes smaller ones where it bends.

    Returns
    -------
    EquilibriumPath
        ``.critical`` holds the buckling loads.

    Raises
    ------
    EquilibriumError
        If there is no equilibrium at the start, or the path cannot be followed; ``.partial`` is the path so far.
    Interrupted
        On Ctrl-C; ``.partial`` is the path so far, None before its first point.

    Warns
    -----
    MechanismWarning
        If the path turns back and does not reach the last value.

    References
    ----------
    Crisfield, "A fast incremental/iterative solution procedure that handles snap-through", Computers & Structures 13,
    1981; Seydel, *Practical Bifurcation and Stability Analysis*, Springer 2010, chapters 4 and 5.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> load = mbd.Parameter("load", 0.0)
    >>> bar = mbd.Body("bar", mass=1, inertia=1, pose=(0, 0.5, np.pi / 2))
    >>> foot = mbd.Revolute("foot", mbd.ground.at(0, 0), bar.at(-0.5, 0))
    >>> spring = mbd.RSDA("spring", mbd.ground.at(0, 0), bar.at(-0.5, 0), stiffness=30, free_angle=np.pi / 2)
    >>> push = mbd.Force("push", bar.at(0.5, 0), (0, -load))
    >>> column = mbd.Mechanism(bodies=[bar], joints=[foot], forces=[spring, push], parameters=[load])
    >>> path = mbd.equilibrium_path(column, load, 0, 50)
    >>> round(path.critical[0].value, 6), path.critical[0].kind
    (30.0, 'bifurcation')
    """
    if not isinstance(parameter, Input | Parameter):
        raise ModelError(f"equilibrium_path: takes an Input or a Parameter, got {parameter!r}")
    first, last = (number(x, "equilibrium_path", name) for x, name in ((start, "start"), (end, "end")))
    count = whole(steps, "equilibrium_path", "steps", 1)
    if first == last:
        raise ModelError(f"equilibrium_path: start and end are both {first}, which leaves nothing to follow")
    arguments: dict[str, Any] = {"t": t, "initial": conditions, "inputs": inputs, "parameters": parameters}
    follower: Follower | None = None
    with keyboard_interrupts("equilibrium_path", lambda: None if follower is None else follower.so_far):
        setup = Setup(mechanism, "equilibrium_path", **arguments, fixed={parameter: first})
        origin = equilibrium_of(setup, prefer=prefer)
        size = max(abs(first), abs(last))
        statics = Statics(setup.numeric, setup.signals, setup.time, (origin.q, origin.z), [parameter], sizes=[size])
        follower = Follower(statics, parameter, first, last, count)
        return follower.run(origin)


@dataclass(frozen=True)
class CriticalState:
    """A point of a path at which a direction loses (or gains) its stiffness.

    Attributes
    ----------
    value : float
        Value of the parameter: the buckling load.
    state : Equilibrium
        The equilibrium there.
    kind : {"limit", "bifurcation", "flutter"}
        At a limit point the path turns back, and the mechanism snaps through;
        at a bifurcation the path continues, and another one crosses it. From
        flutter on, under forces without potential, feedback or negative
        damping, oscillations grow.
    direction : numpy.ndarray
        Displacement over q in which the stiffness vanishes, or in which it flutters (n,), the largest entry 1.
    """

    value: float
    state: Equilibrium
    kind: str
    direction: np.ndarray


class EquilibriumPath:
    """Equilibria in the order of the path; ``path[expression]`` evaluates anything.

    Attributes
    ----------
    parameter : Input or Parameter
        Symbol that was changed.
    values : numpy.ndarray
        Its values (k,); if the path turns they do not increase throughout.
    states : tuple of Equilibrium
        (k,).
    stable : numpy.ndarray of bool
        (k,).
    least_stiffness : numpy.ndarray
        Least eigenvalue of the reduced stiffness (k,), N/m.
    critical : tuple of CriticalState
        Points at which the number of directions that give way changes, and at which flutter sets in or ends.
    """

    def __init__(self, parameter: Any, values: Sequence[float], states: Sequence[Equilibrium], critical: Sequence[Any]):
        self.parameter = parameter
        self.values = np.array(values)
        self.states = tuple(states)
        self.stable = np.array([state.stable for state in states])
        self.least_stiffness = np.array([state.stiffness.least for state in states])
        self.critical: tuple[CriticalState, ...] = tuple(critical)

    #: not a sequence: list(path) would ask for path[0], path[1], … as expressions, without an end; see ``states``
    __iter__ = None

    def __getitem__(self, expression: Expression) -> np.ndarray:
        """Values of an expression along the path: (k,), or (k, i) for a vector."""
        expression = as_expression(expression, "path[…]")
        return np.array([state[expression] for state in self.states])

    def __len__(self) -> int:
        return len(self.states)

    def __repr__(self) -> str:
        lines = [
            f"EquilibriumPath: {len(self)} states, {self.parameter.label} = {self.values[0]:.6g} … "
            f"{self.values[-1]:.6g}, {int(np.sum(self.stable))} of them stable"
        ]
        return "\n".join(lines + [f"  {c.kind} at {self.parameter.label} = {c.value:.8g}" for c in self.critical])


@dataclass
class _Point:
    """A point of the path: unknowns, direction of the path there, eigenvalues."""

    x: np.ndarray
    tangent: np.ndarray
    state: Equilibrium

    @property
    def flutters(self) -> bool:
        """True if oscillations grow."""
        return self.state.small_motions.flutter


class Follower:
    """Predictor along the tangent, corrector by Newton's method at a given advance along it."""

    def __init__(self, statics: Statics, parameter: Any, first: float, last: float, steps: int):
        self.statics, self.parameter, self.first, self.last, self.steps = statics, parameter, first, last, steps
        n, k = statics.n, statics.k
        c = statics.numeric.column_scale
        # advances count in turns and levers in the mean over the coordinates, and in shares of the range
        mean = np.sqrt(n)
        self._size = np.concatenate(
            [mean * c * statics.lever, mean * np.ones(k), np.zeros(statics.m), [abs(last - first)]]
        )
        self._seen = np.flatnonzero(self._size)
        self._turns = np.flatnonzero(statics.eom.angles)
        self._n = n
        self._points: list[_Point] = []
        self._critical: list[CriticalState] = []

    def run(self, origin: Equilibrium) -> EquilibriumPath:
        """Follow the path from the equilibrium at the first value."""
        sign = np.sign(self.last - self.first)
        point = self._point(self.statics.join(origin.q, origin.z, origin.lam, [self.first]), None)
        if point.tangent[-1] * sign < 0:
            point.tangent = -point.tangent
        self._points.append(point)
        usual = 1.0 / self.steps
        control = StepControl(usual, SMALLEST_STEP * usual)
        while len(self._points) < MOST_POINTS:
            control.limit(usual / max(abs(point.tangent[-1]), usual))  # the share of the range, or a mean lever
            following = self._advanced(point, control.step, sign)
            if following is None:
                if not control.refuse():
                    raise EquilibriumError(
                        f"equilibrium_path: the path cannot be followed beyond {self.parameter.label} = "
                        f"{point.x[-1]:.8g}: the constraints lock there, or a force has no value; the path so far is "
                        "in .partial",
                        partial=self.so_far,
                    )
                continue
            self._critical += self._critical_between(point, following)
            self._points.append(following)
            control.accept(easily=self._is_easy(point, following))
            point = following
            if (point.x[-1] - self.last) * sign >= -1e-12 * abs(self.last):
                return self._path()
            if (self.first - point.x[-1]) * sign > abs(self.last - self.first):
                break
        warn(
            f"equilibrium_path: the path does not reach {self.parameter.label} = {self.last:.6g}: it turns back, and "
            f"was followed to {point.x[-1]:.6g} in {len(self._points)} points"
        )
        return self._path()

    def _is_easy(self, point: _Point, following: _Point) -> bool:
        """True if the path turned little over a step, and no body far."""
        turn = largest((following.x - point.x)[self._turns])
        return turn < EASY_TURN and bool(following.tangent @ point.tangent > EASILY_STRAIGHT)

    @property
    def so_far(self) -> EquilibriumPath | None:
        """The path as far as it has been followed."""
        return self._path() if self._points else None

    def _path(self) -> EquilibriumPath:
        values, states = [p.x[-1] for p in self._points], [p.state for p in self._points]
        return EquilibriumPath(self.parameter, values, states, self._critical)

    # --- points ----------------------------------------------------------------------
    def _point(self, x: np.ndarray, before: np.ndarray | None) -> _Point:
        return _Point(x, self._tangent(x, before), Equilibrium(self.statics, x))

    def _tangent(self, x: np.ndarray, before: np.ndarray | None) -> np.ndarray:
        """Direction of the path in scaled unknowns, in the sense of the direction before."""
        jacobian = self.statics.scaled(x)[0](x)[1]
        force = self.statics.stiffness(x).scale * self.statics.lever or 1.0
        size = np.where(self._size > 0, self._size, force)
        _, values, right = np.linalg.svd(jacobian * size)
        null = right[np.sum(values > 1e-10 * values[0]) :].T
        # multipliers that are not unique have null directions of their own, in which nothing moves
        left, sizes, _ = np.linalg.svd(null[self._seen], full_matrices=False)
        tangent = left[:, 0] if before is None else left[:, sizes > 1e-6] @ (left[:, sizes > 1e-6].T @ before)
        tangent = tangent / np.linalg.norm(tangent)
        return tangent if before is None or tangent @ before >= 0 else -tangent

    def _advanced(self, point: _Point, step: float, sign: float) -> _Point | None:
        """Point by :meth:`advance`, at the last value if the step leads across it."""
        following = self.advance(point, step)
        if following is None or not (self.last - point.x[-1]) * sign > 0 > (self.last - following.x[-1]) * sign:
            return following
        return self._at(following, self.last)

    def advance(self, point: _Point, step: float) -> _Point | None:
        """Equilibrium at an advance along the tangent of a point; None if there is none nearby."""
        seen, size = self._seen, self._size[self._seen]
        guess, row = point.x.copy(), np.zeros(point.x.size)
        guess[seen] += step * size * point.tangent
        row[seen] = point.tangent / size
        x = self._solved(guess, row, point.x, step, iterations=12)
        if x is None or largest((x - point.x)[self._turns]) > PATH_TURN:
            return None
        following = self._point(x, point.tangent)
        return following if following.tangent @ point.tangent > STRAIGHT else None

    def _at(self, point: _Point, value: float) -> _Point | None:
        """Equilibrium at a value of the parameter, near a point."""
        guess, row = point.x.copy(), np.zeros(point.x.size)
        guess[-1], row[-1] = value, 1 / self._size[-1]
        x = self._solved(guess, row, guess, 0.0, iterations=20)
        return None if x is None else self._point(x, point.tangent)

    def _solved(
        self, guess: np.ndarray, row: np.ndarray, origin: np.ndarray, advance: float, *, iterations: int
    ) -> np.ndarray | None:
        """Equilibrium near a guess at an advance along a row from an origin; None if there is none."""
        equations, weights = self.statics.scaled(guess)

        def with_advance(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slope = equations(x)
            ahead = row @ (x - origin) - advance
            return np.append(values, ahead), np.vstack([slope, row])

        return newton(with_advance, guess, weights, iterations=iterations, smallest=RANK)

    # --- critical points -------------------------------------------------------------------
    def _critical_between(self, low: _Point, high: _Point) -> list[CriticalState]:
        """Points between two others at which an eigenvalue changes its sign, or flutter begins."""
        ends = low.state.stiffness, high.state.stiffness
        length = float(low.tangent @ ((high.x - low.x)[self._seen] / self._size[self._seen]))
        few, many = sorted(end.falling for end in ends)
        if all(end.is_real for end in ends):
            critical = [self._singular(low, high, length, index) for index in range(few, many)]
        else:
            critical = [self._singular(low, high, length, None)] if (many - few) % 2 else []
        if low.flutters != high.flutters:
            critical.append(self._flutter(low, high, length))
        return critical

    def _flutter(self, low: _Point, high: _Point, length: float) -> CriticalState:
        """Point at which oscillations begin to grow, by halving: on the side on which it flutters."""
        inner, outer = 0.0, length
        points = {inner: low, outer: high}
        while outer - inner > CRITICAL_ACCURACY:
            middle = (inner + outer) / 2
            between = self.advance(low, middle)
            if between is None or not inner < middle < outer:
                break
            points[middle] = between
            if between.flutters == low.flutters:
                inner = middle
            else:
                outer = middle
        point = points[inner if low.flutters else outer]
        direction = point.state.small_motions.fastest_growing
        direction = direction / direction[np.argmax(np.abs(direction))]
        return CriticalState(float(point.x[-1]), point.state, "flutter", direction)

    def _singular(self, low: _Point, high: _Point, length: float, index: int | None) -> CriticalState:
        """Point at which the stiffness is singular: an eigenvalue by its number, or that nearest to zero, vanishes."""
        points: dict[float, _Point] = {0.0: low, length: high}

        def eigenvalue(advance: float) -> float:
            if advance not in points:
                between = self.advance(low, advance)
                if between is None:
                    raise EquilibriumError(
                        f"equilibrium_path: the critical point near {self.parameter.label} = {low.x[-1]:.8g} "
                        "cannot be located; take more steps=; the path so far is in .partial",
                        partial=self.so_far,
                    )
                points[advance] = between
            here = points[advance].state.stiffness
            return here.singularity if index is None else float(np.sort(here.values.real)[index])

        ends = {advance: eigenvalue(advance) for advance in (0.0, length)}
        at = min(ends, key=lambda advance: abs(ends[advance]))
        if abs(ends[at]) > NEUTRAL * low.state.stiffness.scale:  # else a point of the path is the critical one itself
            course = np.vectorize(eigenvalue, otypes=[float])
            at = bracketed_root(course, 0.0, length, ends[0.0], ends[length], CRITICAL_ACCURACY)
        eigenvalue(at)
        point = points[at]
        turned = low.tangent[-1] * high.tangent[-1] < 0
        here = point.state.stiffness
        column = int(np.argmin(np.abs(here.values))) if index is None else index
        direction = here.directions[:, column].real
        direction = direction / direction[np.argmax(np.abs(direction))]
        return CriticalState(float(point.x[-1]), point.state, "limit" if turned else "bifurcation", direction)
