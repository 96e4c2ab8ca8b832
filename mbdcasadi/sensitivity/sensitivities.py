"""Sensitivities: how a motion changes with parameters, starts and inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController
from ..arguments.values import pairs_of, pairs_with
from ..errors import ModelError
from ..integrators import Integrator
from ..model.events import Event
from ..model.forces.friction.modes import switching, without_exact_friction
from ..model.immutable import HoldsSymbols
from ..model.mechanism import Mechanism
from ..model.quantities import entries
from ..model.symbols import Input, Numbers, Parameter, as_expression
from ..numerics.console import keyboard_interrupts
from ..results.state import Conditions
from ..simulation.changes.events import read_events
from ..simulation.simulate import simulate
from .compiled_run import CompiledRun, MotionSetup
from .derivatives import Compiled
from .design_variables import DesignVariables, PhasedDesignVariables, output_place
from .phase_flow import Directions, VariedMotion
from .phased_variation import EventVariation, phased_variation


class Sensitivities(HoldsSymbols):
    """Values and derivatives of outputs over time.

    ``found[output]`` are the values (n_t,) or (n_t, k); ``found[output, parameter]``
    the derivatives, of the same shape. By an input that is given as samples
    there is one derivative for each sample, in a last axis.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n_t,), s; the instant of a change of the mechanism twice.
    events : tuple of EventSensitivities
        Changes of the mechanism, and the event that ends the motion.
    """

    def __init__(
        self,
        t: np.ndarray,
        outputs: list[tuple[Any, ca.SX]],
        design: DesignVariables,
        y: np.ndarray,
        slope: np.ndarray,
        events: Sequence[EventSensitivities] = (),
    ):
        self.t, self.events = t, tuple(events)
        self._outputs, self._design = outputs, design
        rows = sum(e.numel() for _, e in outputs)
        self._y = y.reshape(t.size, rows)
        self._slope = slope.reshape(t.size, rows, design.size)

    def _rows(self, key: Any) -> tuple[slice, ca.SX]:
        k = output_place(self._outputs, key)
        expression, first = self._outputs[k][1], sum(e.numel() for _, e in self._outputs[:k])
        return slice(first, first + expression.numel()), expression

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


class EventSensitivities(HoldsSymbols):
    """An event, and how its instant and the state there change.

    ``event[output]`` is the value just before, ``event[output, parameter]`` its derivative along with the instant;
    ``event.after[output, parameter]`` those just after a change of the mechanism.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    after : Sensitivities or None
        Values just after, of one time; None of an event that ends the motion.
    """

    def __init__(self, variation: EventVariation, outputs: list[tuple[Any, ca.SX]], design: DesignVariables):
        self.name, self.t = variation.name, variation.t
        self._time, self._design = variation.time, design
        one = np.array([variation.t])
        self._before = _AtInstant(one, outputs, design, *variation.before)
        self.after = None if variation.after is None else _AtInstant(one, outputs, design, *variation.after)

    def time(self, wrt: Any) -> float | np.ndarray:
        """Derivative of the instant."""
        part = self._time[self._design.slice_of(wrt)]
        return float(part[0]) if part.size == 1 else part

    def __getitem__(self, key: Any) -> np.ndarray:
        return self._before[key]

    def __repr__(self) -> str:
        return f"EventSensitivities of '{self.name}' at t = {self.t:.6g} s"


class _AtInstant(Sensitivities):
    """Values and derivatives at one time, without an axis for it."""

    def __getitem__(self, key: Any) -> np.ndarray:
        value: np.ndarray = super().__getitem__(key)[0]
        return value


def sensitivities(
    mechanism: Mechanism,
    times: Numbers,
    outputs: Any,
    wrt: Any = None,
    initial: Conditions = (),
    *,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    events: Sequence[Event] = (),
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
        As for :func:`simulate`; through changes of the mechanism inputs are numbers and expressions.
    events : sequence of Event, optional
        Changes of the mechanism (``becomes=``) and terminal events: derivatives are carried across them, the instants
        of which change too. ``found.events`` has the derivatives of the instants and of the states there, also of the
        events of ``DryFriction``, clutches and ``RigidContact``: stick and slip, touching, impacts, lift-off.
    method : {"idas", "dop853", "erk", "rosenbrock", "auto"}
        Integrator. DOP853 serves the same motions as in :func:`simulate`, and is several times faster where the
        analysis is repeated; a single one of a large mechanism may take longer to prepare than to run.
    reltol, abstol : float, default 1e-8
        Tolerances, of the derivatives too.

    Returns
    -------
    Sensitivities
        ``found[output, parameter]`` (n_t,).

    Raises
    ------
    ModelError
        For what the mechanism does not have, events that reset velocities, and changes that take place together for
        the given values alone.
    SimulationError
        If the integrator stops; if the motion touches the zero of an event, or a joint would not close for other
        values, or friction stick or a contact touch at the start, so that there is no derivative.

    Warns
    -----
    MechanismWarning
        If a switch whose instant changes with the parameters is at an output, or several are at one instant:
        derivatives there are one-sided.

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
        named, read = named_outputs(outputs), read_events(events)
        arguments: dict[str, Any] = {"initial": initial, "inputs": inputs, "parameters": parameters}
        arguments |= {"method": method, "reltol": reltol, "abstol": abstol}
        if read or switching(mechanism):
            return _through_changes(mechanism, times, named, wrt, read, arguments)
        setup = MotionSetup(mechanism, "sensitivities", times, **arguments)
        run = CompiledRun(setup, wrt, [e for _, e in named])
        y, slope = run.forward(run.design.values)
        return Sensitivities(setup.grid, named, run.design, y, slope)


def _through_changes(
    mechanism: Mechanism,
    times: Any,
    named: list[tuple[Any, ca.SX]],
    wrt: Any,
    events: Sequence[Event],
    arguments: dict[str, Any],
) -> Sensitivities:
    """Sensitivities through changes of the mechanism, along a motion that is simulated first."""
    inputs = arguments["inputs"]
    controlled = isinstance(inputs, SampledController) or hasattr(inputs, "inputs")
    if controlled or any(not isinstance(x, ca.SX) and np.ndim(x) for _, x in pairs_of(inputs, "inputs=")):
        raise ModelError(
            "sensitivities: through changes of the mechanism, stick and slip, and contacts inputs= takes numbers and "
            "expressions alone"
        )
    motion = simulate(mechanism, times, events=events, **arguments)
    whole, all_inputs = motion.mechanism, pairs_of(inputs, "inputs=")
    own = {
        "inputs": pairs_with(mechanism.inputs, all_inputs),
        "parameters": pairs_with(mechanism.parameters, pairs_of(arguments["parameters"], "parameters=")),
    }
    # what sticks and touches at the start does so by the conditions there
    setup = MotionSetup(without_exact_friction(mechanism), "sensitivities", times, **(arguments | own))
    p = motion.phases[0].parameters if len(motion.phases) == 1 else motion.parameters
    values = dict(zip(whole.parameters, p.tolist(), strict=True)) | dict(all_inputs)
    design = PhasedDesignVariables(wrt, setup, setup.differentiable_start, whole, values)
    rows = np.eye(design.size)
    by_key = {entry.key: rows[low] for entry, low in zip(design.entries, design.places[:-1], strict=True)}
    directions = Directions(
        _start_slopes(design),
        {key: row for key, row in by_key.items() if isinstance(key, Parameter)},
        {key: row for key, row in by_key.items() if isinstance(key, Input)},
    )
    varied = VariedMotion(motion, setup.grid, [e for _, e in named], directions, setup.integrator, all_inputs)
    variation = phased_variation(varied, events)
    at_events = [EventSensitivities(event, named, design) for event in variation.events]
    return Sensitivities(variation.t, named, design, variation.y, variation.slope, at_events)


def _start_slopes(design: DesignVariables) -> np.ndarray:
    """Derivatives of the start ``(q, v, z)`` by the design variables (n_x, k)."""
    start, d = design.start, ca.MX.sym("d", design.size)
    right, z, p, *_ = design.function(d)
    of_start = Compiled(ca.Function("start", [d], [start.function(p, right, z, start.guess)[0]]))
    return np.asarray(of_start.changes([design.values], [of_start(design.values)], np.eye(design.size)).full())


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
