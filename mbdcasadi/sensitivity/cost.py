"""Cost functions of a motion with their gradients, as optimisers take them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import Numbers, Scalar, as_expression
from ..numerics.console import keyboard_interrupts
from ..numerics.real import real_array
from ..results.state import Conditions
from ..simulation.changes.events import refuse_events
from .compiled_run import CompiledRun, MotionSetup


class CostFunction:
    """``J(x)``: the integral of a running cost and a terminal cost, over one simulation.

    Made by :func:`cost_function`; ``scipy.optimize.minimize(J.value_and_gradient,
    J.start, jac=True, bounds=J.bounds)`` minimises it.

    Attributes
    ----------
    start : numpy.ndarray
        The values given (n_x,).
    bounds : list of (float, float)
        Limits of the parameters and inputs.
    labels : tuple of str
        Variables of the entries of x.
    """

    def __init__(self, run: CompiledRun):
        self._run = run
        self.start = run.design.values
        self.bounds = run.design.bounds
        self.labels = tuple(
            e.label if e.size == 1 else f"{e.label}, sample {k}" for e in run.design.entries for k in range(e.size)
        )

    def __call__(self, x: Any) -> float:
        """Value of the cost."""
        d = self._checked(x)
        with keyboard_interrupts("cost_function"):
            return self._cost(self._run.values(d))

    def value_and_gradient(self, x: Any) -> tuple[float, np.ndarray]:
        """Value and gradient (n_x,), by one adjoint integration, or forward in C and through loads that are short."""
        d = self._checked(x)
        with keyboard_interrupts("cost_function"):
            y = self._run.values(d)
            weights = np.zeros(y.size)
            weights[-2:] = 1.0
            return self._cost(y), self._run.adjoint(d, weights, y)

    def gradient(self, x: Any) -> np.ndarray:
        """Gradient alone (n_x,)."""
        return self.value_and_gradient(x)[1]

    def values_of(self, x: Any) -> dict[Any, float | np.ndarray]:
        """Entries of x by symbol, as ``parameters=`` and ``inputs=`` take them."""
        d, design = self._checked(x), self._run.design
        parts = np.split(d, design.places[1:-1])
        return {e.key: float(part[0]) if e.size == 1 else part for e, part in zip(design.entries, parts, strict=True)}

    @staticmethod
    def _cost(y: np.ndarray) -> float:
        return float(y[-2] + y[-1])

    def _checked(self, x: Any) -> np.ndarray:
        try:
            d = np.atleast_1d(real_array(x))
        except (TypeError, ValueError):
            d = np.zeros(0)
        if d.shape != self.start.shape or not np.all(np.isfinite(d)):
            raise ModelError(
                f"cost function: x must be {self.start.size} finite numbers ({', '.join(self.labels)}), got {x!r}"
            )
        return d


def cost_function(
    mechanism: Mechanism,
    times: Numbers,
    wrt: Any,
    *,
    running_cost: Scalar = 0,
    terminal_cost: Scalar = 0,
    initial: Conditions = (),
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    events: Sequence[Event] = (),
    method: str | Integrator = "idas",
    reltol: float | None = None,
    abstol: float | None = None,
) -> CostFunction:
    """Return a cost of the motion as a function of parameters, starts and inputs, with its gradient.

    ``J = ∫ running_cost dt + terminal_cost at the end``

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Grid from start to end, on which sampled inputs are given, s.
    wrt : sequence
        Variables of J; see :func:`sensitivities`. An input that is given as samples counts once for each sample.
    running_cost, terminal_cost : expression
        May hold anything, reactions and accelerations too.
    initial, inputs, parameters, method, reltol, abstol
        As for :func:`sensitivities`.
    events : sequence of Event
        Not supported: refused with the analyses that take them.

    Returns
    -------
    CostFunction
        ``J(x)``, ``J.gradient(x)``, ``J.value_and_gradient(x)``, ``J.start``, ``J.bounds``.

    Notes
    -----
    With IDAS value and adjoint are each integrated to the tolerance, and their
    steps differ: the gradient is that of the motion to some 1e-7, not that of
    the numbers J returns to the last digit. With samples of an input each
    interval is an integration of its own, and with splines, steps and motion
    programs each stretch between two of their knots, which costs time. If the motion
    meets loads that are short beside the run, or contacts, the gradient is found forward,
    at a cost that grows with the number of entries. With
    ``method="erk"`` it is both, and quicker where the motion is not stiff;
    through a pose in which the linkage could fold it is the only method.
    ``method="dop853"`` finds it forward too, in C, where the motion is smooth and not stiff: the fastest and most exact
    method for up to some fifty entries. For more, as the samples of an input, the adjoint of "erk" costs as much as
    for one entry, and that of IDAS where the motion is stiff.
    Events have no place here: a motion that is restarted has other derivatives.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> speed = mbd.Parameter("speed", 1.0)
    >>> ball = mbd.Body("ball", mass=1, inertia=1)
    >>> thrown = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()], parameters=[speed])
    >>> miss = mbd.cost_function(thrown, [0, 1], [speed], terminal_cost=(ball.y - 2) ** 2, initial=[ball.vy == speed])
    >>> np.round(miss.gradient([5.0]), 6)
    array([-3.81])
    """
    refuse_events(events, "cost_function")
    running, terminal = (
        as_expression(c, name) for c, name in ((running_cost, "running_cost"), (terminal_cost, "terminal_cost"))
    )
    if running.numel() != 1 or terminal.numel() != 1:
        raise ModelError("cost_function: running_cost and terminal_cost must be scalars")
    with keyboard_interrupts("cost_function"):
        arguments = {"initial": initial, "inputs": inputs, "parameters": parameters, "method": method}
        setup = MotionSetup(mechanism, "cost_function", times, reltol=reltol, abstol=abstol, **arguments)
        setup.eom.function(ca.vertcat(running, terminal))  # refuses foreign symbols
        return CostFunction(CompiledRun(setup, wrt, [terminal], running, reversible=True))
