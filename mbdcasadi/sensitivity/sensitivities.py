"""Sensitivities: how a motion changes with parameters, starts and inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..integrators import Integrator
from ..model.immutable import HoldsSymbols
from ..model.mechanism import Mechanism
from ..model.quantities import entries
from ..model.symbols import Parameter, as_expression
from ..numerics.console import keyboard_interrupts
from .compiled_run import CompiledRun, MotionSetup
from .design_variables import DesignVariables, same


class Sensitivities(HoldsSymbols):
    """Values and derivatives of outputs over time.

    ``found[output]`` are the values (n_t,) or (n_t, k); ``found[output, parameter]``
    the derivatives, of the same shape. By an input that is given as samples
    there is one derivative for each sample, in a last axis.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n_t,), s.
    """

    def __init__(
        self, t: np.ndarray, outputs: list[tuple[Any, ca.SX]], design: DesignVariables, y: np.ndarray, slope: np.ndarray
    ):
        self.t = t
        self._outputs, self._design = outputs, design
        rows = sum(e.numel() for _, e in outputs)
        self._y = y.reshape(t.size, rows)
        self._slope = slope.reshape(t.size, rows, design.size)

    def _rows(self, key: Any) -> tuple[slice, ca.SX]:
        first = 0
        for name, expression in self._outputs:
            if (isinstance(key, str) and name == key) or (not isinstance(key, str) and same(expression, ca.SX(key))):
                return slice(first, first + expression.numel()), expression
            first += expression.numel()
        names = ", ".join(repr(name) if isinstance(name, str) else str(name) for name, _ in self._outputs)
        raise ModelError(f"{key!r} is not among the outputs: {names}")

    def __getitem__(self, key: Any) -> np.ndarray:
        """``found[output]`` or ``found[output, parameter]``."""
        if not isinstance(key, tuple):
            rows, expression = self._rows(key)
            return self._y[:, rows.start] if expression.numel() == 1 else self._y[:, rows]
        output, wrt = key
        rows, expression = self._rows(output)
        columns = self._design.slice_of(wrt)
        slopes = self._slope[:, rows, columns]
        if expression.numel() == 1:
            slopes = slopes[:, 0]
        return slopes[..., 0] if columns.stop - columns.start == 1 else slopes

    def __repr__(self) -> str:
        by = ", ".join(e.label for e in self._design.entries)
        return f"Sensitivities of {len(self._outputs)} outputs at {self.t.size} times by {by}"


def sensitivities(
    mechanism: Mechanism,
    times: Any,
    outputs: Any,
    wrt: Any = None,
    initial: Any = (),
    *,
    inputs: Any = None,
    parameters: Any = None,
    method: str | Integrator = "idas",
    reltol: float | None = None,
    abstol: float | None = None,
) -> Sensitivities:
    """Differentiate outputs along a motion.

    The variational equations are integrated with the motion, the start is
    differentiated as the implicit function of its conditions that it is, and
    accelerations and multipliers come from the equations of motion at each
    output: derivatives of reactions are as exact as those of positions.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, the first one the start, s.
    outputs : sequence of expressions, or {name: expression}
        Positions, reactions, energies, anything; scalars or vectors.
    wrt : sequence
        Parameters, also those that only `initial` holds; inputs (by a constant
        added to them, or by each sample where samples are given); state
        variables (by their initial value); relations of `initial` (by their right side).
        By default the parameters that `parameters` lists without values.
    initial, inputs, parameters
        As for :func:`simulate`.
    method : {"idas", "erk", "rosenbrock", "auto"}
        Integrator.
    reltol, abstol : float, default 1e-8
        Tolerances, of the derivatives too.

    Returns
    -------
    Sensitivities
        ``found[output, parameter]`` (n_t,).

    Raises
    ------
    ModelError
        For what the mechanism does not have.
    SimulationError
        If the integrator stops.

    References
    ----------
    Cao, Li, Petzold, Serban, "Adjoint sensitivity analysis for differential-algebraic equations", SIAM J. Sci. Comput.
    24, 2003; Serban and Haug, "Kinematic and kinetic derivatives in multibody system analysis", 1998.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> g = mbd.Parameter("g", 9.81)
    >>> stone = mbd.Body("stone", mass=1, inertia=1)
    >>> fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    >>> found = mbd.sensitivities(fall, [0, 1, 2], outputs=[stone.y], wrt=[g])
    >>> np.round(found[stone.y, g], 6)
    array([ 0. , -0.5, -2. ])
    """
    with keyboard_interrupts("sensitivities"):
        if wrt is None:
            wrt, parameters = _listed(parameters), None
        setup = MotionSetup(
            mechanism,
            "sensitivities",
            times,
            initial=initial,
            inputs=inputs,
            parameters=parameters,
            method=method,
            reltol=reltol,
            abstol=abstol,
        )
        named = named_outputs(outputs)
        run = CompiledRun(setup, wrt, [e for _, e in named])
        y, slope = run.forward(run.design.values)
        return Sensitivities(setup.grid, named, run.design, y, slope)


def _listed(parameters: Any) -> list[Parameter]:
    """Parameters that are listed without values, in place of `wrt`."""
    listed = list(parameters) if isinstance(parameters, Sequence) else []
    if not listed or not all(isinstance(p, Parameter) for p in listed):
        raise ModelError("sensitivities: wrt= is missing; name the parameters, inputs or initial values of interest")
    return listed


def named_outputs(outputs: Any) -> list[tuple[Any, ca.SX]]:
    """Outputs with their names, or with themselves where they have none."""
    pairs = list(outputs.items()) if isinstance(outputs, Mapping) else [(e, e) for e in entries(outputs, "outputs=")]
    if not pairs:
        raise ModelError("outputs= is empty; name the expressions that are wanted")
    return [(name, as_expression(e, "outputs=")) for name, e in pairs]
