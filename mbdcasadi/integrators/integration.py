"""Integration of differential-algebraic equations over chunks of an output grid.

CasADi's integrators return all outputs or none. Running them in chunks gives
progress, cancelling and the part of a run that was finished; a chunk that
fails is repeated output by output to keep what can be had.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ..errors import SimulationError
from ..numerics.console import quiet
from .plugins import compiler_options, flag_of, last_line, plugin_options

#: Steps that an integrator may take between two outputs, at first and at the most.
FEW_STEPS, MAX_STEPS = 5_000, 200_000
#: Bisections by which the place of a failure is narrowed down.
APPROACHES = 16
#: Size of integrals, as a share of the tolerance, below which no integrator adapts its steps to them.
QUAD_SHARE = 1e-9


@dataclass(frozen=True)
class Dae:
    """A semi-explicit index-1 system in time counted from the start of a chunk.

    Attributes
    ----------
    t, x, z, p, u : casadi.SX or casadi.MX
        Time since the start of the chunk, states, algebraic unknowns,
        parameters (the start of the chunk first), values by interval.
    ode, alg : casadi.SX or casadi.MX
        Rates and residuals.
    quad : casadi.SX or casadi.MX
        Rates of integrals that take no part in the error test.
    """

    t: Any
    x: Any
    z: Any
    p: Any
    u: Any
    ode: Any
    alg: Any
    quad: Any = field(default_factory=lambda: ca.SX(0, 1))


class IntegrationFailure(Exception):
    """An integrator stopped; carries what it had and its own word for the cause."""

    def __init__(
        self, flag: str, x: np.ndarray, z: np.ndarray, last: float | None = None, last_x: np.ndarray | None = None
    ):
        super().__init__(flag)
        self.flag = flag
        self.x, self.z = x, z
        self.last, self.last_x = last, last_x


class Integrator:
    """An integrator of one system, compiled once for each pattern of output times.

    Parameters
    ----------
    dae : Dae
        The system.
    method : {"idas", "erk", "rosenbrock"}
        Plugin of CasADi.
    reltol, abstol : float
        Tolerances.
    jit : bool
        Whether the functions are compiled by the C compiler of the machine.
    options : dict
        Passed on to the plugin.

    Notes
    -----
    The Runge–Kutta and Rosenbrock plugins return zeros after a failure and no
    flag; a clock ``dτ/dt = 1`` among the states tells.
    """

    def __init__(
        self, dae: Dae, method: str, reltol: float, abstol: float, *, jit: bool = False, options: dict | None = None
    ):
        self.method = method
        clock = type(dae.x).sym("clock")
        self._system = {
            "t": dae.t,
            "x": ca.vertcat(dae.x, clock),
            "p": dae.p,
            "ode": ca.vertcat(dae.ode, 1),
        }
        if dae.z.numel():
            self._system |= {"z": dae.z, "alg": dae.alg}
        if dae.u.numel():
            self._system["u"] = dae.u
        # all but IDAS count integrals in their error test: so small they do not matter there
        self._quad_scale = 1.0 if method == "idas" else QUAD_SHARE * abstol
        if dae.quad.numel():
            self._system["quad"] = self._quad_scale * dae.quad
        self._options = (
            plugin_options(method, reltol, abstol, bool(dae.z.numel())) | compiler_options(jit) | (options or {})
        )
        self._functions: dict[tuple[Any, ...], ca.Function] = {}
        self._stretched: ca.Function | None = None
        self.starts = 0
        #: steps of the last call, where the plugin counts them
        self.steps = 0
        #: integrals at the outputs of the last call (k, n), since its start
        self.integrals = np.zeros((0, 0))

    def function(self, offsets: np.ndarray, steps: int) -> ca.Function:
        """The compiled integrator for outputs at times after the start; the last state is a clock."""
        digits = 12 - int(np.ceil(np.log10(max(offsets[-1], 1e-300))))
        key = (steps, *np.round(offsets, digits))
        if key not in self._functions:
            options = {"max_num_steps": steps} | self._options
            try:
                self._functions[key] = ca.integrator("motion", self.method, self._system, 0.0, offsets, options)
            except RuntimeError as error:
                raise SimulationError(f"method '{self.method}' refuses the options: {last_line(error)}") from None
        return self._functions[key]

    def advance(
        self,
        x: np.ndarray,
        z: np.ndarray,
        start: float,
        times: np.ndarray,
        p: np.ndarray,
        u: np.ndarray | None = None,
        steps: int = MAX_STEPS,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Integrate from a state at `start` to each of the times.

        Parameters
        ----------
        x, z : numpy.ndarray
            State and estimate of the algebraic unknowns at `start`.
        start : float
            Time of the state, s.
        times : numpy.ndarray
            Outputs (k,), later than `start`.
        p : numpy.ndarray
            Parameters after the start.
        u : numpy.ndarray, optional
            Values by interval (n_u, k).
        steps : int
            Steps that may be taken between two outputs.

        Returns
        -------
        x, z : numpy.ndarray
            (k, n_x), (k, n_z).

        Raises
        ------
        IntegrationFailure
            With nothing reached; :meth:`rescue` finds what can be had.
        """
        found = self._attempt(x, z, start, times, p, u, steps)
        if isinstance(found, str):
            raise IntegrationFailure(found, np.zeros((0, x.size)), np.zeros((0, z.size)))
        return found

    def advance_once(
        self, x: np.ndarray, z: np.ndarray, start: float, end: float, p: np.ndarray, u: np.ndarray | None = None
    ) -> np.ndarray:
        """State at any one later time; one compiled function serves all lengths of the step."""
        if self._stretched is None:
            self._stretched = ca.integrator(
                "step", self.method, _stretched(self._system), 0.0, 1.0, {"max_num_steps": MAX_STEPS} | self._options
            )
        arguments: dict[str, Any] = {"x0": np.r_[x, 0.0], "p": np.r_[start, p, end - start]}
        arguments |= {"z0": z} if z.size else {}
        arguments |= {"u": u} if u is not None else {}
        self.starts += 1
        try:
            with quiet():
                reached = self._stretched(**arguments)["xf"].full().ravel()
        except RuntimeError as error:
            raise IntegrationFailure(flag_of(error), np.zeros((0, x.size)), np.zeros((0, z.size))) from None
        return reached[:-1]

    def _attempt(
        self,
        x: np.ndarray,
        z: np.ndarray,
        start: float,
        times: np.ndarray,
        p: np.ndarray,
        u: np.ndarray | None,
        steps: int,
    ) -> tuple[np.ndarray, np.ndarray] | str:
        """Outputs at all times, or the integrator's word for its failure."""
        offsets = times - start
        self.starts += 1
        arguments: dict[str, Any] = {"x0": np.r_[x, 0.0], "p": np.r_[start, p]}
        if z.size:
            arguments["z0"] = z
        if u is not None:
            arguments["u"] = u
        function = self.function(offsets, steps)
        try:
            with quiet():
                result = function(**arguments)
        except RuntimeError as error:
            return flag_of(error)
        self.steps = int(function.stats().get("nsteps", 0))
        states = result["xf"].full().T
        clock_is_right = np.abs(states[:, -1] - offsets) <= 1e-6 * offsets[-1]
        if not np.all(clock_is_right) or not np.all(np.isfinite(states)):
            return "the step size became too small, or a value was not finite"
        self.integrals = result["qf"].full().T / self._quad_scale
        return states[:, :-1], result["zf"].full().T

    def rescue(
        self,
        flag: str,
        x: np.ndarray,
        z: np.ndarray,
        start: float,
        times: np.ndarray,
        p: np.ndarray,
        u: np.ndarray | None,
    ) -> IntegrationFailure:
        """Repeat a chunk that failed one output at a time: the failure with what was reached."""
        states, algebraic, now = [], [], start
        for k, time in enumerate(times):
            found = self._attempt(x, z, now, np.array([time]), p, None if u is None else u[:, k : k + 1], FEW_STEPS)
            if isinstance(found, str):
                flag = found
                break
            x, z, now = found[0][0], found[1][0], float(time)
            states.append(x)
            algebraic.append(z)
        reached = len(states)
        column = None if u is None else u[:, min(reached, len(times) - 1)][:, None]
        last, x = self._approach(x, z, now, float(times[min(reached, len(times) - 1)]), p, column)
        return IntegrationFailure(
            flag,
            np.reshape(np.array(states), (reached, x.size)),
            np.reshape(np.array(algebraic), (reached, z.size)),
            last,
            x,
        )

    def _approach(
        self, x: np.ndarray, z: np.ndarray, start: float, end: float, p: np.ndarray, u: np.ndarray | None
    ) -> tuple[float, np.ndarray]:
        """Last time before a failure that can be reached, by bisection, and the state there."""
        low, high = start, end
        for _ in range(APPROACHES):
            middle = (low + high) / 2
            if not low < middle < high:
                break
            found = self._attempt(x, z, low, np.array([middle]), p, u, FEW_STEPS // 5)
            if isinstance(found, str):
                high = middle
            else:
                low, x, z = middle, found[0][0], found[1][0]
        return low, x


def _stretched(system: dict[str, Any]) -> dict[str, Any]:
    """The system over a step of unit length: time and rates scaled by the last parameter."""
    length = ca.SX.sym("length")
    scaled = {name: part for name, part in system.items() if name != "quad"}
    for name in ("ode", "alg"):
        if name in system:
            scaled[name] = ca.substitute(system[name], system["t"], length * system["t"])
    scaled["ode"] = length * scaled["ode"]
    scaled["p"] = ca.vertcat(system["p"], length)
    return scaled
