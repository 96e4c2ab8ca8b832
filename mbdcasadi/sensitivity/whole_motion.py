"""A method that runs in C of its own as a function of CasADi, with derivatives forward.

The run is a callback, and so is its derivative: that one runs the system with variations of its motion, which are
states like others, in the error test too.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..integrators import Integrator
from ..integrators.compiled import KEPT, MAX_STEPS, CompiledIntegrator, InitialValueProblem
from ..integrators.dop853.pieces import ExplicitIntegrator
from .varied_system import VariedSystem

#: Variations that run together, at most: the code of more takes longer to make than one run instead of two saves.
TOGETHER = 6
#: Numbers in the motions that are remembered, at most.
REMEMBERED = 1_000_000


class WholeIntegrator(CompiledIntegrator):
    """An integrator in C of the explicit equations, as a function of CasADi.

    Parameters
    ----------
    signals : Signals
        Inputs.
    integrands : casadi.SX
        Rates of integrals, which are states.
    integrator : Integrator
        Method and tolerances.

    Raises
    ------
    SimulationError
        Without a C compiler, and for operations that are not written as C.
    """

    only_forward: ClassVar[bool] = True
    on_constraints: ClassVar[bool] = True

    def __init__(self, numeric: NumericEquations, signals: Signals, integrands: ca.SX, integrator: Integrator):
        self.integrator, self._weights = integrator, numeric.projection_weights
        self._equations = VariedSystem(numeric, signals, integrands)
        self._runs: dict[tuple[int, tuple[int, ...]], ExplicitIntegrator] = {}
        # a function of CasADi does not keep the callbacks in it alive
        self._callbacks: dict[int, _Callback] = {}
        # functions within functions ask for one motion again and again, each for its own derivative
        self._known: OrderedDict[tuple[bytes, ...], np.ndarray] = OrderedDict()
        self._lock = threading.Lock()
        self._run_of(0, ())  # raises where the method cannot run: within a function of CasADi the reason would be lost
        self.restart_counting()

    # --- functions of CasADi -------------------------------------------------------------------
    def function(
        self,
        fractions: np.ndarray,
        *,
        groups: tuple[int, ...] | None = None,
        steps: int = MAX_STEPS,
        least_steps: int = 0,
    ) -> ca.Function:
        count, system = fractions.size, self._equations
        size, parameters = system.size + 1, 3 + system.parameters + system.levels
        if count not in self._callbacks:
            shapes = [(size, 1), (parameters, 1), (system.channel + 1, count), (count + 1, 1), (size, count)]
            self._callbacks[count] = _Callback("motion", shapes, self._motion, self._variations)
        arguments = [ca.MX.sym("x0", size), ca.MX.sym("p", parameters), ca.MX.sym("u", system.channel + 1, count)]
        states = self._callbacks[count](*arguments, ca.DM(np.r_[fractions, least_steps]))
        return ca.Function("whole", arguments, [states], ["x0", "p", "u"], ["xf"])

    def _motion(self, *arguments: np.ndarray) -> np.ndarray:
        """States at the ends of intervals by column, the clock as the last row; see :func:`_problem`."""
        key = tuple(argument.tobytes() for argument in arguments)
        known = self._known.get(key)
        if known is not None:
            return known
        problem, clock, fractions = _problem(*arguments)
        states = np.vstack([self._states(problem).T, clock + fractions])
        self._known[key] = states
        while len(self._known) > max(1, min(KEPT, REMEMBERED // states.size)):
            self._known.popitem(last=False)
        return states

    def _variations(self, count: int, *arguments: np.ndarray) -> np.ndarray:
        """Variations of the motion along some directions, side by side, as CasADi asks for them.

        With the rate f of the state, that by the start ``s`` of a piece of length ``l`` is that by its first state
        along ``-f ds``, and the states at fractions ``k`` move along ``f (ds + k dl)`` with their times.
        """
        problem, _, fractions = _problem(*arguments[:4])
        states, dx, dp, du, _ = arguments[4:]
        times, du = fractions.size, du[:-1].reshape(len(du) - 1, count, fractions.size).swapaxes(0, 1)
        (start, length), dp, clock, dx = dp[:2, :, None], dp[2:-1].T, dx[-1], dx[:-1].T
        moves = bool(np.any(start) or np.any(length))
        if moves:
            dx = dx - start * self._equations.rates(problem, np.array([problem.start]), problem.x[None, :])
        parameters = tuple(np.flatnonzero(np.any(dp[:, : self._equations.parameters], axis=0)).tolist())
        parts = []
        for some in np.array_split(np.arange(count), -(-count // TOGETHER)):
            varied = self._equations.varied(problem, parameters, dx[some], dp[some], du[some])
            parts.append(self._equations.variations(self._states(varied, some.size, parameters), some.size))
        varied_states = np.concatenate(parts)
        if moves:
            rates = self._equations.rates(problem, problem.times, states[:-1].T)
            varied_states = varied_states + (start + length * fractions)[:, :, None] * rates
        rows = varied_states.transpose(2, 0, 1).reshape(-1, count * times)
        return np.vstack([rows, np.repeat(clock, times)])

    # --- integrating -------------------------------------------------------------------------
    def _attempt(
        self, problem: InitialValueProblem, steps: int, variations: int = 0, parameters: tuple[int, ...] = ()
    ) -> tuple[np.ndarray, np.ndarray] | str:
        # no step may cross a change of the inputs
        changes = np.append(np.any(np.diff(problem.channel, axis=1) != 0, axis=0), True)
        problem = replace(problem, stops=problem.stops | changes)
        with self._lock:
            return self._run_of(variations, parameters)._attempt(problem, steps)

    def _run_of(self, variations: int, parameters: tuple[int, ...]) -> ExplicitIntegrator:
        key = variations, parameters
        if key not in self._runs:
            system, cache = self._equations.with_variations(*key)
            weights = np.tile(self._weights, 1 + variations)
            self._runs[key] = ExplicitIntegrator(system, self.integrator, cache, weights)
        return self._runs[key]

    def _states(
        self, problem: InitialValueProblem, variations: int = 0, parameters: tuple[int, ...] = ()
    ) -> np.ndarray:
        """States at the times of a problem (n_t, n).

        Parameters
        ----------
        variations : int
            Number of variations in the problem.
        parameters : tuple of int
            Positions of the parameters that vary.
        """
        outcome = self._attempt(problem, MAX_STEPS, variations, parameters)
        if isinstance(outcome, str):
            raise SimulationError(outcome)
        return outcome[0]


class _Callback(ca.Callback):
    """A function of CasADi with one result, by a function of arrays.

    Parameters
    ----------
    shapes : sequence of (int, int)
        Shapes of the arguments, and of the result as the last one.
    value : callable
        ``arguments -> result``.
    variations : callable, optional
        ``(count, arguments, result, changes of the arguments, …) ->`` changes of the result in some directions, which
        stand side by side.
    """

    def __init__(
        self,
        name: str,
        shapes: Sequence[tuple[int, int]],
        value: Callable[..., np.ndarray],
        variations: Callable[..., np.ndarray] | None = None,
    ):
        ca.Callback.__init__(self)
        self._shapes, self._value, self._variations = list(shapes), value, variations
        self._derivatives: dict[int, _Callback] = {}
        self.construct(name)

    def get_n_in(self) -> int:
        return len(self._shapes) - 1

    def get_n_out(self) -> int:
        return 1

    def get_sparsity_in(self, k: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shapes[k])

    def get_sparsity_out(self, k: int) -> ca.Sparsity:
        return ca.Sparsity.dense(*self._shapes[-1])

    def has_eval_buffer(self) -> bool:
        return True  # matrices of CasADi would take longer to make than the run

    def eval_buffer(self, arguments: Any, results: Any) -> int:
        *known, result = (
            np.frombuffer(part).reshape(shape, order="F")
            for part, shape in zip([*arguments, *results], self._shapes, strict=True)
        )
        result[:] = self._value(*known)
        return 0

    def has_forward(self, count: int) -> bool:
        return self._variations is not None

    def get_forward(self, count: int, name: str, inputs: Any, outputs: Any, options: Any) -> ca.Function:
        if count not in self._derivatives:
            assert self._variations is not None
            shapes = [*self._shapes, *((rows, columns * count) for rows, columns in self._shapes)]
            self._derivatives[count] = _Callback(name, shapes, partial(self._variations, count))
        return self._derivatives[count]


def _problem(
    x0: np.ndarray, p: np.ndarray, u: np.ndarray, course: np.ndarray
) -> tuple[InitialValueProblem, float, np.ndarray]:
    """The problem of a piece, the clock at its start, and the ends of its intervals as fractions of its length.

    Parameters
    ----------
    x0 : numpy.ndarray
        Start; its last component is the clock.
    p : numpy.ndarray
        Start and length of the piece, parameters and levels, and a rate that has no use here.
    u : numpy.ndarray
        What changes by interval; its last row changes where a stop is.
    course : numpy.ndarray
        The fractions, and the least number of steps over the piece, 0 for no limit.
    """
    (start, length), parameters, fractions, least_steps = p[:2, 0], p[2:, 0], course[:-1, 0], course[-1, 0]
    stops = np.append(np.diff(u[-1]) != 0, True)
    max_step = length / least_steps if least_steps else None
    times = start + length * fractions
    problem = InitialValueProblem(x0[:-1, 0], np.zeros(0), start, times, parameters, u[:-1], stops, max_step)
    return problem, float(x0[-1, 0]), fractions
