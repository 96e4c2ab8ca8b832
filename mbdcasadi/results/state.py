"""One instant of a mechanism, and events that take place at one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from ..equations.public import Equations, equations
from ..errors import MechanismError
from ..model.conditions import Relations
from ..model.immutable import HoldsSymbols
from ..model.mechanism import Mechanism
from ..model.symbols import as_expression, role_of, symbols_of
from .finite import refuse_nan
from .notebook import html_table

#: ``q, v, a, z, lam, u``: of a state, or by time.
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
#: ``t, q, v, a, z, lam, u, p``: of a state, or by time.
Arguments = tuple[Any, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
#: What fixes a state: relations, or a state itself.
Conditions: TypeAlias = "Relations | State"


def six(arrays: Iterable[np.ndarray]) -> Arrays:
    """Return ``q, v, a, z, lam, u``."""
    q, v, a, z, lam, u = arrays
    return q, v, a, z, lam, u


class State(HoldsSymbols):
    """Pose, velocity, acceleration and multipliers of a mechanism at one time.

    ``state[expression]`` evaluates anything.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    t : float
        Time, s.
    q, v, a, z, lam, u, p : numpy.ndarray
        Coordinates, velocities, accelerations, first-order states,
        multipliers, inputs and parameters, in the order of ``equations(mechanism)``.
    obstacle : MechanismError, optional
        Reason if there are no accelerations and multipliers.
    impulses : mapping of element to numpy.ndarray, optional
        Impulses of constraints at the instant, by their rows: of a state just after an impact. The name of a
        constraint may take its place if the mechanism does not have it, as read from a file.
    whole : State, optional
        The state as one of all mechanisms of a motion, for quantities that the mechanism does not have.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1, pose=(0.4, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> state = mbd.assemble(mbd.Mechanism(bodies=[arm], joints=[hinge]))
    >>> round(state[arm.x], 9)
    0.5
    """

    def __init__(
        self,
        mechanism: Mechanism,
        t: float,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        z: np.ndarray,
        lam: np.ndarray,
        u: np.ndarray,
        p: np.ndarray,
        obstacle: MechanismError | None = None,
        impulses: Mapping[Any, np.ndarray] | None = None,
        whole: State | None = None,
    ):
        self.mechanism = mechanism
        self.t = float(t)
        self.q, self.v, self.a, self.z, self.lam, self.inputs, self.parameters = [
            np.asarray(x, float).ravel() for x in (q, v, a, z, lam, u, p)
        ]
        self._obstacle, self._whole = obstacle, whole
        self.impulses: Mapping[Any, np.ndarray] | None = None if impulses is None else dict(impulses)

    @property
    def equations(self) -> Equations:
        """Equations of motion of the mechanism."""
        return equations(self.mechanism)

    @property
    def whole(self) -> State:
        """State of all mechanisms of its motion; itself if there is one mechanism."""
        return self if self._whole is None else self._whole

    @property
    def obstacle(self) -> MechanismError | None:
        """Reason if there are no accelerations and multipliers; None if they are known."""
        return self._obstacle

    @property
    def arguments(self) -> Arguments:
        """``(t, q, v, a, z, lam, u, p)`` for compiled expressions."""
        return self.t, self.q, self.v, self.a, self.z, self.lam, self.inputs, self.parameters

    #: not a sequence: list(state) would ask for state[0], state[1], … as expressions, without an end
    __iter__ = None

    def __getitem__(self, expression: Any) -> float | np.ndarray:
        """Value of an expression: a float, (k,) for a column, (i, j) for a matrix.

        Raises
        ------
        ExpressionError
            For a symbol that the mechanism does not have, and if the expression has no value.
        """
        expression = self._with_impulses(as_expression(expression, "state[…]"))
        if self._whole is not None and not self.equations.contains(expression):
            return self._whole[expression]
        eom = self.equations
        function = eom.function(expression)
        if self._obstacle is not None and ca.depends_on(expression, ca.vertcat(eom.a, eom.lam)):
            raise self._obstacle
        value = function(*self.arguments).full()
        refuse_nan(eom, expression, value[None], [np.atleast_2d(x) for x in self.arguments])
        if value.size == 1:
            return float(value[0, 0])
        return value.ravel() if 1 in value.shape else value

    def _with_impulses(self, expression: ca.SX) -> ca.SX:
        """The expression with the values of impulses; a constraint that took no part has none."""
        if self.impulses is None:
            return expression
        roles = [(symbol, role_of(symbol)) for symbol in symbols_of(expression)]
        impulses = {r.owner: r.owner.impulses for _, r in roles if r is not None and r.kind == "impulse"}
        for element, symbols in impulses.items():
            values = self.impulses.get(element, self.impulses.get(element.name))  # by name as read from a file
            expression = ca.substitute(expression, symbols, ca.DM.zeros(symbols.shape) if values is None else values)
        return expression

    def __repr__(self) -> str:
        eom = self.equations
        names = eom.coordinate_names
        lines = [f"State at t = {self.t:.6g} s"]
        for k, body in enumerate(self.mechanism.bodies):
            x, y, phi = self.q[3 * k : 3 * k + 3]
            vx, vy, omega = self.v[3 * k : 3 * k + 3]
            lines.append(
                f"  {body.name}: x = {x:.6g} m, y = {y:.6g} m, phi = {phi:.6g} rad;"
                f" vx = {vx:.6g} m/s, vy = {vy:.6g} m/s, omega = {omega:.6g} rad/s"
            )
        for k in range(3 * len(self.mechanism.bodies), len(names)):
            lines.append(f"  {names[k]} = {self.q[k]:.6g}")
        lines += [f"  {s.label} = {value:.6g}" for s, value in zip(self.mechanism.states, self.z, strict=True)]
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Coordinates and velocities as a table, for notebooks."""
        header = ["", "x, m", "y, m", "phi, rad", "vx, m/s", "vy, m/s", "omega, rad/s"]
        count = len(self.mechanism.bodies)
        pairs = zip(self.q[: 3 * count].reshape(-1, 3), self.v[: 3 * count].reshape(-1, 3), strict=True)
        rows = [
            [body.name, *(f"{value:.6g}" for part in pair for value in part)]
            for body, pair in zip(self.mechanism.bodies, pairs, strict=True)
        ]
        names = [*self.equations.coordinate_names[3 * count :], *(s.label for s in self.mechanism.states)]
        values = [*self.q[3 * count :], *self.z]
        notes = [f"{name} = {value:.6g}" for name, value in zip(names, values, strict=True)]
        # what a derived class reports beside the coordinates
        notes += [line.strip() for line in repr(self).splitlines()[1 + count + len(notes) :]]
        return html_table(f"State at t = {self.t:.6g} s", rows, header, notes)


@dataclass(frozen=True)
class EventOccurrence:
    """An event that took place.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    state : State
        State at that time; just before, if the event resets velocities or changes the mechanism.
    after : State or None
        State just after a reset, or in the mechanism in which the motion continues; it knows the impulses.
    """

    name: str
    t: float
    state: State
    after: State | None = None
