"""Methods of integration of one's own: a class that goes from step to step."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..errors import SimulationError
from ..model.cache import Cache
from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.tolerances import NEGLIGIBLE
from .base import Integrator
from .compiled import TOO_MANY_STEPS, CompiledIntegrator, Forms, InitialValueProblem

#: Points and weights on a step from 0 to 1 for integrals along it: exact to degree seven, as dense output is at most.
POINTS, WEIGHTS = (0.5 * x for x in np.polynomial.legendre.leggauss(4))


class IntegratorStep(NamedTuple):
    """A step of a method.

    Attributes
    ----------
    t0, t1 : float
        Its start and end, s.
    y0, y1 : numpy.ndarray
        States there (n,).
    dense : callable, optional
        ``times (k,) -> states (n, k)`` inside the step, as dense output of SciPy; cubic polynomials through the states
        and their rates at both ends if left out.
    """

    t0: float
    t1: float
    y0: np.ndarray
    y1: np.ndarray
    dense: Callable[[np.ndarray], np.ndarray] | None = None


class RunEquations:
    """Equations of motion for a :class:`SteppingMethod`: ``dy/dt = f(t, y)`` with ``y = (q, v, z)``.

    Parameters and inputs have the values of the run.

    Attributes
    ----------
    equations : Equations
        Their expressions, for methods that take more than rates.
    max_step : float
        Longest step by the method and by the model, s; infinite if there is none.
    cache : Cache
        Keeps what a method makes of the expressions: ``cache.get_or_create(key, make)``.
    """

    def __init__(self, forms: Forms, options: dict[str, Any]):
        self.equations, self.max_step, self.cache = forms.equations, np.inf, Cache()
        self._input, self._options = forms.input, options
        self._p, self._levels, self._u = (np.zeros(self._input.numel_in(k)) for k in (4, 5, 6))
        eom, forward = self.equations, forms.forward()
        rates = ca.Function("rates", [*eom.symbols], [ca.densify(eom.z_rate), ca.densify(forms.integrands)])
        #: number of integrals of what is watched
        self.watched = forms.integrands.numel()
        t, y = ca.MX.sym("t"), ca.MX.sym("y", 2 * eom.q.numel() + eom.z.numel())
        q, v, z = ca.vertsplit(y, np.cumsum([0, eom.q.numel(), eom.v.numel(), eom.z.numel()]).tolist())
        p, levels, channel = (ca.MX.sym("constants", x.size) for x in self._constants)
        u = self._input(t, q, v, z, p, levels, channel)
        a, lam = forward(t, q, v, z, u, p)
        z_rate, integrands = rates(t, q, v, a, z, lam, u, p)
        arguments = [t, y, p, levels, channel]
        self._rates = Evaluator(ca.Function("rates", arguments, [ca.densify(ca.vertcat(v, a, z_rate))], options))
        self._integrands = ca.Function("integrands", arguments, [integrands], options)

    @property
    def _constants(self) -> tuple[np.ndarray, ...]:
        return self._p, self._levels, self._u

    def rates(self, t: float, y: np.ndarray) -> np.ndarray:
        """Rates of the state (n,)."""
        return self._rates(t, y, *self._constants)[0].ravel()

    def jacobian(self, t: float, y: np.ndarray) -> np.ndarray:
        """Derivatives of the rates by the state (n, n)."""
        return self._jacobian(t, y, *self._constants)[0]

    @cached_property
    def _jacobian(self) -> Evaluator:
        rates, arguments = self._rates.function, self._rates.function.mx_in()
        slopes = ca.densify(ca.jacobian(rates(*arguments), arguments[1]))
        return Evaluator(ca.Function("jacobian", arguments, [slopes], self._options))

    def function(self, *expressions: Any) -> Callable[..., list[np.ndarray]]:
        """Return expressions in the symbols of the equations as a function of ``(t, q, v, a, z, lam)``.

        It returns one array for each of them, in its shape. The expressions may contain inputs and parameters.
        """
        eom = self.equations
        symbols = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam]
        levels, channel = (ca.SX.sym("inputs", self._input.numel_in(k)) for k in (5, 6))
        u = self._input(eom.t, eom.q, eom.v, eom.z, eom.p, levels, channel)
        results = [ca.densify(r) for r in ca.substitute([ca.SX(e) for e in expressions], [eom.u], [u])]
        made = Evaluator(ca.Function("expressions", [*symbols, eom.p, levels, channel], results, self._options))
        return lambda *arguments: made(*arguments, *self._constants)

    # --- for what runs the method ------------------------------------------------------------------
    def take(self, p: np.ndarray, max_step: float) -> None:
        """Take parameters and levels of the inputs of a run, and the longest step."""
        ends = np.cumsum([self._p.size, self._levels.size])
        (self._p, self._levels, _), self.max_step = np.split(p, ends), max_step

    def take_inputs(self, u: np.ndarray) -> None:
        """Take the values of the inputs that hold over an interval."""
        self._u = u

    def inside(self, step: IntegratorStep, times: np.ndarray) -> np.ndarray:
        """States inside a step (k, n)."""
        if step.dense is not None:
            return np.asarray(step.dense(times)).T
        from scipy.interpolate import CubicHermiteSpline

        ends = [step.t0, step.t1], [step.y0, step.y1], [self.rates(step.t0, step.y0), self.rates(step.t1, step.y1)]
        return CubicHermiteSpline(*ends)(times)

    def integrals(self, step: IntegratorStep, start: float, times: np.ndarray) -> np.ndarray:
        """Integrals of what is watched from a time in a step to later ones (k, m)."""
        begins = np.r_[start, times[:-1]]
        lengths = times - begins
        places = (begins[:, None] + lengths[:, None] * (0.5 + POINTS)).ravel()
        states = self.inside(step, places)
        values = self._integrands(places[None], states.T, *self._constants).full()
        parts = lengths[:, None] * (values.T.reshape(times.size, POINTS.size, -1) * WEIGHTS[:, None]).sum(axis=1)
        return np.cumsum(parts, axis=0)


class SteppingMethod(Integrator):
    """A method of one's own; a subclass says how it goes from one step to the next.

    It takes any mechanism: the rates of the state are those of the accelerations and multipliers that belong to it.
    Events, impacts, contacts, stick and slip are located by integrating again from the output before, and outputs are
    projected onto the constraints. Analyses that differentiate a run, or repeat it in C, take methods of CasADi alone.

    Parameters
    ----------
    reltol, abstol : float, default 1e-8
        Relative and absolute tolerance of the local error, for :meth:`steps` to keep.
    max_step : float, optional
        Longest step, s.
    jit : bool, default False
        Compile the equations with the C compiler of the machine.

    Attributes
    ----------
    name : str
        Name in results and messages.
    """

    def steps(self, system: RunEquations, t: float, y: np.ndarray, end: float) -> Iterator[IntegratorStep]:
        """Go from a state to a time, step by step.

        Forces and inputs are smooth on the way, but for what depends on the state.

        Parameters
        ----------
        system : RunEquations
            Equations, and the longest step.
        t : float
            Time of the state, s.
        y : numpy.ndarray
            State ``(q, v, z)`` (n,).
        end : float
            Time at which the last step is to end, s.

        Yields
        ------
        IntegratorStep
            Steps that follow each other; none longer than ``system.max_step``.

        Raises
        ------
        SimulationError
            If the method cannot go on, with the cause.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method steps, which goes from one state to the next")

    def over_pieces(self, forms: Forms) -> SteppedIntegrator:
        return SteppedIntegrator(forms, self)


class SteppedIntegrator(CompiledIntegrator):
    """Runs a :class:`SteppingMethod` over pieces of an output grid."""

    integrator: SteppingMethod

    def __init__(self, forms: Forms, integrator: SteppingMethod):
        self.integrator, self._equations = integrator, RunEquations(forms, integrator._compiler_options)
        self.restart_counting()

    def _attempt(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray] | str:
        count, u = problem.times.size, problem.channel
        self.starts += 1
        self.steps = 0
        self._equations.take(problem.p, self.integrator.longest_step(problem.max_step))
        states, integrals = np.zeros((count, problem.x.size)), np.zeros((count, self._equations.watched))
        changes = problem.stops[:-1] | np.any(u[:, 1:] != u[:, :-1], axis=0)
        ends = np.flatnonzero(np.r_[changes, True]) + 1
        t, y, integral = problem.start, problem.x, np.zeros(integrals.shape[1])
        try:
            for first, last in zip(np.r_[0, ends[:-1]], ends, strict=True):
                self._equations.take_inputs(u[:, first])
                times, since = problem.times[first:last], 0
                for step in self._checked(t, y, float(times[-1])):
                    t, y, since = step.t1, step.y1, since + 1
                    inside = (times > step.t0) & (times <= t)
                    rows = first + np.flatnonzero(inside)
                    if integral.size:
                        marks = np.union1d(times[inside], t)
                        passed = integral + self._equations.integrals(step, step.t0, marks)
                        integrals[rows], integral = passed[: rows.size], passed[-1]
                    if rows.size:
                        states[rows], since = self._equations.inside(step, times[inside]), 0
                    if since > steps:
                        return TOO_MANY_STEPS
                states[last - 1] = y
        except (SimulationError, ArithmeticError, np.linalg.LinAlgError) as stopped:
            return str(stopped)
        self.integrals = integrals
        return (states, np.zeros((count, problem.z.size))) if np.isfinite(states).all() else "a value was not finite"

    def _checked(self, t: float, y: np.ndarray, end: float) -> Iterator[IntegratorStep]:
        """The steps from a state to a time, of which the last one ends there.

        Raises
        ------
        SimulationError
            For steps that do not follow each other, are too long, or end elsewhere.
        """
        start = t
        for step in self.integrator.steps(self._equations, t, y, end):
            allowed = NEGLIGIBLE * (end - start)
            if not (abs(step.t0 - t) <= allowed and t < step.t1 <= end + allowed):
                raise SimulationError(
                    f"the step from t = {step.t0:.9g} to {step.t1:.9g} s does not lead on from t = {t:.9g} towards "
                    f"{end:.9g} s"
                )
            if step.t1 - step.t0 > self._equations.max_step * (1 + NEGLIGIBLE):
                raise SimulationError(
                    f"the step from t = {step.t0:.9g} to {step.t1:.9g} s is longer than max_step, "
                    f"{self._equations.max_step:.6g} s"
                )
            self.steps, self.all_steps = self.steps + 1, self.all_steps + 1
            t = end if abs(step.t1 - end) <= allowed else step.t1
            yield step._replace(t1=t)
            if t == end:
                return
        raise SimulationError(f"the steps end at t = {t:.9g} s, before {end:.9g} s")
