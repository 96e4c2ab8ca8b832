"""Task and result of a method over a stretch of time."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import casadi as ca
import numpy as np

from ...numerics.lazy import cached_property
from .code import Written

#: Points inside every step at which events are looked at, at least.
SAMPLES = 7
#: Residual with which a step is accepted if no iteration reduces it.
LOOSE = 1e-9
#: Smallest and largest factor from one step size to the next.
LEAST, MOST = 0.2, 10.0
#: Samples inside one step at most.
MOST_SAMPLES = 1000


class Status(IntEnum):
    """Cause of the end of a stretch."""

    DONE = 0
    PAUSED = 1
    FULL = 2
    HALTED = 3
    EVENT = 4
    SINGULAR = 5
    STIFF = 6
    TOO_SMALL = 7
    NOT_FINITE = 8
    APART = 9

    @property
    def is_failure(self) -> bool:
        """True if the method cannot go on."""
        return self >= Status.TOO_SMALL


@dataclass(frozen=True, eq=False)
class ExplicitSystem:
    """Equations of motion as an explicit system of first order, with the constraints as its invariants.

    The state is ``x = (q, v, z)``, and after it come integrals that take no part in the error test.

    Attributes
    ----------
    input : casadi.Function
        ``(t, q, v, z, p, levels, channel) -> u``.
    dynamics : casadi.Function
        ``(t, q, v, z, u, p) -> (a, rate of z, lam, regularity)``; the regularity falls to zero in a singular pose.
    quadrature : casadi.Function
        ``(t, q, v, a, z, lam, u, p) ->`` rates of the integrals.
    projection : casadi.Function
        ``(t, q, v, p, weights) -> (q, v, |Phi|)``: one step onto the constraints, and what is left after it.
    switching : casadi.Function
        ``(t, q, v, z, p) ->`` quantities at whose zeros the equations, or their derivatives, jump.
    slopes : casadi.Function, optional
        ``(t, q, v, z, u, p, levels, channel) ->`` slopes of accelerations and rates of z by ``(q, v, z)``, dense, which
        implicit methods need.
    written : Written, optional
        C code of the dynamics, the quadrature and the slopes.
    """

    input: ca.Function
    dynamics: ca.Function
    quadrature: ca.Function
    projection: ca.Function
    switching: ca.Function
    slopes: ca.Function | None = None
    written: Written | None = None

    @cached_property
    def functions(self) -> dict[str, ca.Function]:
        """Functions that do not depend on inputs and events, by name."""
        functions = {name: getattr(self, name) for name in ("dynamics", "projection", "quadrature", "switching")}
        return functions if self.slopes is None else functions | {"slopes": self.slopes}

    @cached_property
    def coordinates(self) -> int:
        """Number of coordinates."""
        return int(self.dynamics.numel_out(0))

    @cached_property
    def states(self) -> int:
        """Number of first-order states."""
        return int(self.dynamics.numel_out(1))

    @cached_property
    def multipliers(self) -> int:
        """Number of constraint rows."""
        return int(self.dynamics.numel_out(2))

    @cached_property
    def inputs(self) -> int:
        """Number of inputs."""
        return int(self.input.numel_out(0))

    @cached_property
    def constants(self) -> tuple[int, int]:
        """Numbers of parameters and of levels of the inputs."""
        return int(self.input.numel_in(4)), int(self.input.numel_in(5))

    @cached_property
    def channel(self) -> int:
        """Number of values that change by interval."""
        return int(self.input.numel_in(6))

    @cached_property
    def switches(self) -> int:
        """Number of quantities that switch."""
        return int(self.switching.numel_out(0))

    @cached_property
    def integrals(self) -> int:
        """Number of integrals."""
        return int(self.quadrature.numel_out(0))

    @cached_property
    def size(self) -> int:
        """Length of x."""
        return 2 * self.coordinates + self.states


@dataclass(frozen=True, eq=False)
class Watched:
    """Events that are looked at in every step.

    Attributes
    ----------
    function : casadi.Function
        ``(t, q, v, a, z, lam, u, p) ->`` values.
    needs_dynamics : bool
        True if they contain accelerations, multipliers or inputs.
    direction : numpy.ndarray of int
        1 where a value must rise, -1 where it must fall, else 0.
    decides : numpy.ndarray of bool
        True if a step in which an event may take place is the last one.
    """

    function: ca.Function
    needs_dynamics: bool
    direction: np.ndarray
    decides: np.ndarray

    @property
    def size(self) -> int:
        """Number of events."""
        return self.direction.size


@dataclass
class Progress:
    """State that is handed from one stretch to the next.

    Attributes
    ----------
    step : float
        Size of the next step, s; 0 if it is not known.
    last_step, last_gain : float
        Size of the last step, s, and the factor by which its error let the next one grow; 0 if there is none from which
        the next one follows.
    across : bool
        True if that is a tiny one that goes across a zero of what switches.
    passed : float
        Time at which such a zero was passed last, s; minus infinity if none was.
    eigenvalue : float
        Size of the largest eigenvalue of late, 1/s; 0 if it is not known.
    regularity : float
        Largest regularity that was seen.
    stiff, not_stiff : int
        Steps at the limit of stability, and steps off it since the last of these.
    """

    step: float = 0.0
    last_step: float = 0.0
    last_gain: float = 0.0
    across: bool = False
    passed: float = -np.inf
    eigenvalue: float = 0.0
    regularity: float = 0.0
    stiff: int = 0
    not_stiff: int = 0


class Stretch(NamedTuple):
    """A part of a run.

    Attributes
    ----------
    start : float
        s.
    x : numpy.ndarray
        State at the start, on the constraints (n_x,).
    times : numpy.ndarray
        Increasing, later than the start (k,), s.
    stops : numpy.ndarray of bool
        Over which of them no step may go.
    channels : numpy.ndarray
        Values in the interval that ends at each of the times (k, n_channel).
    p, levels, weights : numpy.ndarray
        Parameters, levels of the inputs, metric of the projection.
    reltol, abstol : float
        Tolerances.
    max_step : float
        Longest step, s.
    most_steps : int
        Steps after which it pauses; 0 for never.
    every_step : bool
        True if the states at the ends of steps are returned too.
    keep_samples : bool
        True if states inside steps are returned too.
    spacing : float
        Largest distance of samples, s.
    offset, band, side : numpy.ndarray
        By event: what is taken from its value, below which size its sign does not count, and its
        sign at the start (0: that of its value).
    fall : float
        Fall of the regularity, relative to the largest one seen, that is reported; 0 for none.
    stiff_after : int
        Steps at the limit of stability that are reported; 0 for none.
    """

    start: float
    x: np.ndarray
    times: np.ndarray
    stops: np.ndarray
    channels: np.ndarray
    p: np.ndarray
    levels: np.ndarray
    weights: np.ndarray
    reltol: float
    abstol: float
    max_step: float = np.inf
    most_steps: int = 0
    every_step: bool = False
    keep_samples: bool = False
    spacing: float = np.inf
    offset: np.ndarray = np.zeros(0)
    band: np.ndarray = np.zeros(0)
    side: np.ndarray = np.zeros(0)
    fall: float = 0.0
    stiff_after: int = 0


@dataclass(frozen=True, eq=False)
class Cases:
    """Runs of one system over equally many times.

    Attributes
    ----------
    starts, p, levels : numpy.ndarray
        Starts on the constraints, parameters, levels of the inputs, by case (k, …).
    times : numpy.ndarray
        Increasing, later than the start (k, n), s; (1, n) if all cases share them, as all that follows.
    requested, stops : numpy.ndarray of bool
        Times that are outputs, and times that no step may cross.
    channels : numpy.ndarray
        Values in the interval that ends at each of the times (k, n, n_channel).
    max_step : numpy.ndarray
        Longest steps (k,), s.
    needs_dynamics : bool
        True if the outputs contain accelerations, multipliers or inputs.
    """

    starts: np.ndarray
    p: np.ndarray
    levels: np.ndarray
    times: np.ndarray
    requested: np.ndarray
    stops: np.ndarray
    channels: np.ndarray
    max_step: np.ndarray
    needs_dynamics: bool


@dataclass(frozen=True, eq=False)
class Reached:
    """Result of a stretch.

    Attributes
    ----------
    times, x, integrals : numpy.ndarray
        Outputs, and other states where asked for, (r,), (r, n_x), (r, n_integrals); integrals since the start.
    index : numpy.ndarray of int
        Place of each among the times of the stretch, or -1.
    status : Status
        Cause of its end.
    steps, rejected, evaluations : int
        Steps that were accepted and repeated, and evaluations of the equations.
    least_regularity : float
        Smallest one that was seen.
    """

    times: np.ndarray
    x: np.ndarray
    integrals: np.ndarray
    index: np.ndarray
    status: Status
    steps: int
    rejected: int
    evaluations: int
    least_regularity: float
