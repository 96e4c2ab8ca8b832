"""Linearisation of the equations of motion on the constraint manifold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import inputs_and_parameters
from ..assembly.consistent_start import complete_state, consistent_start
from ..assembly.setup import Setup
from ..equations import equations
from ..errors import ModelError, warn
from ..kinematics.singular import singular_pose
from ..model.forces.friction.modes import held_at, switching
from ..model.mechanism import Mechanism
from ..model.quantities import entries
from ..model.symbols import Input, Parameter, as_expression, place_of
from ..model.texts import text_of
from ..numerics.console import keyboard_interrupts
from ..results.columns import component_names
from ..results.state import State
from ..simulation.changes.contact_modes import modes_of
from .coordinates import independent
from .directions import Directions
from .model import LinearModel


@keyboard_interrupts("linearize")
def linearize(
    mechanism: Mechanism,
    state: State,
    wrt: Sequence[Input | Parameter] = (),
    outputs: Any = (),
    parameters: Any = None,
    *,
    inputs: Any = None,
    coordinates: Any = None,
) -> LinearModel:
    """Linearise the equations of motion about a state.

    ``ẋ = A x + B u``, ``y = C x + D u`` for small changes on the constraints,
    ``x = (w, ẇ, z)``: independent coordinates, their rates, first-order
    states. All derivatives are exact; changes of the multipliers (geometric
    stiffness), of lengths, and the terms of a steady motion are included.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    state : State
        At rest (see :func:`equilibrium`), in steady motion, or anywhere on a motion.
        It brings along its inputs and parameters.
    wrt : sequence of Input or Parameter
        Columns of B and D.
    outputs : sequence of expressions, or {name: expression}
        Rows of C and D: positions, reactions, accelerations, anything.
    parameters, inputs : mapping, optional
        Values other than those of the state. An input that is given as an
        expression in the state is fed back: the loop is closed in A.
    coordinates : sequence of expressions, optional
        Independent coordinates to use, as many as there are degrees of freedom, in positions:
        ``[hinge.angle]``. Otherwise coordinates of the bodies are chosen, angles before displacements.

    Returns
    -------
    LinearModel
        ``.A, .B, .C, .D``, names of states, inputs and outputs, ``.modes()``, hand-over to control packages.

    Notes
    -----
    Exact friction and rigid contacts are those of the mode that holds at the state: what sticks stays where it is, what
    touches stays closed, what slides goes on in its sense with ``F = -μ N sgn v`` and changes with N alone. The linear
    model holds for changes that are small enough to keep the mode.

    In a singular pose, of which a warning is given, infinitesimal motions are more than the degrees of freedom.

    A periodic motion is linearised by :func:`stability`: its monodromy matrix across impacts and changes of the
    mechanism, and the Floquet multipliers.

    About a steady motion that turns, A is constant in coordinates that do not
    see the turn: angles, or ``coordinates=`` of your own.

    References
    ----------
    Negrut and Ortiz, "A practical approach for the linearization of the constrained multibody dynamics equations",
    ASME J. Comput. Nonlinear Dynam. 1, 2006.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0, -0.5, -1.5707963))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])
    >>> model = mbd.linearize(pendulum, mbd.equilibrium(pendulum))
    >>> model.state_names
    ('arm.phi', 'arm.omega')
    >>> round((6.283185307 * model.modes()[0].frequency) ** 2, 6)
    14.715
    """
    if not isinstance(state, State):
        raise ModelError(
            "linearize: takes a State (from equilibrium, assemble or a trajectory); a periodic motion is linearised by "
            f"stability, across impacts, too; got {state!r}"
        )
    setup = Setup(mechanism, "linearize", t=state.t, initial=state, inputs=inputs, parameters=parameters)
    names, out = read_outputs(outputs)
    if switching(mechanism):
        setup, out = _in_mode(setup, out, {"inputs": inputs, "parameters": parameters})
        mechanism = setup.mechanism
    eom, point = setup.eom, setup.start
    _ = point[eom.a]  # raises if there are no accelerations
    changed = inputs_and_parameters(mechanism, wrt, "wrt=")
    eom.function(out)  # refuses foreign symbols
    chosen = independent(setup.numeric, point, coordinates)
    held = _feedback(setup, changed)
    _warn_of_singular_pose(setup, point)
    directions = Directions(setup.numeric, point, chosen.positions, chosen.rates, held, changed)
    rate = ca.vertcat(chosen.position_rate, chosen.acceleration, eom.z_rate)
    change = directions.of(rate)
    answer = directions.of(out) if out.numel() else np.zeros((0, directions.count))
    k = change.shape[0]

    def later(step: float) -> np.ndarray:
        """A on the same motion a short time later."""
        q, v = point.q + step * point.v + step**2 / 2 * point.a, point.v + step * point.a
        z = point.z + step * np.atleast_1d(point[eom.z_rate]).ravel() if eom.z.numel() else point.z
        after = complete_state(setup.numeric, setup.signals, point.t + step, q, v, z)
        return Directions(setup.numeric, after, chosen.positions, chosen.rates, held, ()).of(rate)

    timed = ca.depends_on(ca.vertcat(eom.Phi, eom.nu, eom.Q, eom.z_rate, held), eom.t)
    return LinearModel(
        *np.split(change, [k], axis=1),
        *np.split(answer, [k], axis=1),
        state_names=(*chosen.names, *(z.label for z in mechanism.states)),
        input_names=tuple(s.label for s in changed),
        output_names=tuple(names),
        state=point,
        rate=np.atleast_1d(point[rate]),
        directions=directions,
        speeds=chosen.positions.numel(),
        later=later if timed or np.any(point.v) else None,
    )


def read_outputs(outputs: Any) -> tuple[list[str], ca.SX]:
    """Names and a column of outputs; a vector of two becomes ``name.x`` and ``name.y``."""
    pairs: list[tuple[str | None, Any]]
    pairs = list(outputs.items()) if isinstance(outputs, Mapping) else [(None, e) for e in entries(outputs, "outputs=")]
    names: list[str] = []
    expressions: list[ca.SX] = []
    for name, value in pairs:
        expression = ca.vec(as_expression(value, "outputs="))
        if name is not None and not isinstance(name, str):
            raise ModelError(f"outputs= takes {{name: expression}} with texts as names, got the name {name!r}")
        label = name or (text_of(expression) if expression.numel() == 1 else f"output {len(names) + 1}")
        names += component_names(label, expression.shape)
        expressions.append(ca.densify(expression))
    return names, ca.vertcat(ca.SX(0, 1), *expressions)


def _in_mode(setup: Setup, out: ca.SX, values: dict[str, Any]) -> tuple[Setup, ca.SX]:
    """Setup in the mode of friction and contacts that holds at a state, and outputs in the symbols of that mode.

    What sticks is held where it is, contacts that touch are closed, and what slides goes on in its sense.
    """
    whole, state, modes = setup.mechanism, setup.initial, modes_of(setup)
    mode, here = modes.decided(consistent_start(modes.numeric(modes.free), state, setup.time, setup.signals))
    out = ca.substitute(out, setup.eom.lam, modes.reactions(mode))
    eom = here.equations
    held = held_at(modes.variant(mode), whole, eom.q, eom.v, here.q)
    theirs = equations(held)
    nothing = np.zeros(theirs.lam.numel())
    start = State(held, here.t, here.q, here.v, here.a, here.z, nothing, here.inputs, here.parameters)
    return Setup(held, "linearize", t=here.t, initial=start, **values), out


def _warn_of_singular_pose(setup: Setup, point: State) -> None:
    """Warn if infinitesimal motions of the pose, which become states, are more than the degrees of freedom."""
    numeric = setup.numeric
    if numeric.rank(point.t, point.q).rank == setup.eom.lam.numel():
        return
    pose = singular_pose(numeric, point.t, point.q, point.z)
    if pose is not None:
        warn(
            f"linearize: at t = {point.t:.6g} s the pose is singular, {pose.text}; small changes along several motions "
            "at once do not meet the constraints, and the linear model does not hold for them"
        )


def _feedback(setup: Setup, changed: Sequence[Any]) -> ca.SX:
    """Inputs as expressions: constants do not matter here, feedback closes the loop."""
    held = ca.SX(setup.signals.at_time(setup.time))
    for k, symbol in enumerate(setup.mechanism.inputs):
        if place_of(symbol, changed) is not None and not held[k].is_constant():
            raise ModelError(f"linearize: input '{symbol.label}' is given by feedback and cannot be in wrt= as well")
    return held
