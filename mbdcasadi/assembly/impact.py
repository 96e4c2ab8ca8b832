"""The state just after an impact: joints that close while the bodies move."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import read_signals
from ..arguments.values import mapping_of, parameter_vector
from ..equations import equations
from ..equations.impact_law import ImpactLaw, Jump
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import ModelError, SimulationError
from ..model.events import read_restitution
from ..model.mechanism import Mechanism
from ..numerics.console import keyboard_interrupts
from ..numerics.least_squares import largest
from ..numerics.newton import solve
from ..numerics.tolerances import NEGLIGIBLE
from ..results.state import State
from .consistent_start import carried_by, complete_state, position_limits


@keyboard_interrupts("impact")
def impact(
    mechanism: Mechanism, state: State, *, restitution: Any = None, inputs: Any = None, parameters: Any = None
) -> State:
    """Return the state from which a motion continues in another mechanism: the one just after a plastic impact.

    Positions are continuous; velocities jump by impulses of the joints of the new mechanism,
    ``M (v⁺ - v⁻) + Phi_q^T Λ = 0``, ``Phi_q v⁺ = nu``. Two bodies that latch share their momentum; if joints only
    open, nothing jumps.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism afterwards, of the same bodies or of some of them.
    state : State
        Just before, of another mechanism.
    restitution : mapping of joint to float, optional
        Joints that act only at the instant, with Newton's coefficients of restitution e.
    inputs, parameters : mapping, optional
        Values other than those of the state.

    Returns
    -------
    State
        Just after; it knows the impulses: ``after[joint.impulse_on(body).force]``, N s.

    Raises
    ------
    SimulationError
        If the position rows of the new mechanism do not hold, or no velocities meet all its rows.

    Examples
    --------
    A block of 1 kg at 3 m/s latches to one of 2 kg at rest.

    >>> import mbdcasadi as mbd
    >>> a = mbd.Body("a", mass=1, inertia=1, velocity=(3, 0, 0))
    >>> b = mbd.Body("b", mass=2, inertia=1)
    >>> apart = mbd.Mechanism(bodies=[a, b])
    >>> latch = mbd.Weld("latch", a.at(0, 0), b.at(0, 0))
    >>> after = mbd.impact(apart.replace(joints=[latch]), mbd.assemble(apart))
    >>> round(after[b.vx], 9), round(after[latch.impulse_on(b).force[0]], 9)
    (1.0, 2.0)
    """
    if not isinstance(mechanism, Mechanism) or not isinstance(state, State):
        raise ModelError(f"impact takes a Mechanism and a State, got {mechanism!r} and {state!r}")
    eom, carried = equations(mechanism), carried_by(state, mechanism)
    p = parameter_vector(eom, carried["parameters"] | mapping_of(parameters, "parameters="))
    numeric = NumericEquations(eom, p)
    law = ImpactLaw(eom, read_restitution(restitution, "impact"))
    z = states_after(mechanism, state)
    q, jump = pose_and_jump(numeric, law, state, z, f"impact at t = {state.t:.6g} s")
    signals = read_signals(eom, inputs, carried=carried["inputs"])
    s = complete_state(numeric, signals, state.t, q, jump.v, z)
    values = (s.q, s.v, s.a, s.z, s.lam, s.inputs, s.parameters)
    return State(mechanism, s.t, *values, s.obstacle, law.by_joint(jump.impulses))


def states_after(mechanism: Mechanism, before: State) -> np.ndarray:
    """Return the first-order states (k,) of a new mechanism: as they were before, those that are new by their value."""
    return np.array([before[x] if before.equations.contains(x) else x.value for x in mechanism.states], float)


def pose_and_jump(
    numeric: NumericEquations, law: ImpactLaw, before: State, z: np.ndarray, what: str
) -> tuple[np.ndarray, Jump]:
    """Return the pose on the constraints of a new mechanism, and the velocities and impulses there.

    Parameters
    ----------
    numeric : NumericEquations
        Equations of the new mechanism.
    law : ImpactLaw
        Its law of impact.
    before : State
        Just before.
    z : numpy.ndarray
        First-order states of the new mechanism (k,).
    what : str
        Event and time, for messages.

    Raises
    ------
    SimulationError
        See :func:`impact`.
    """
    q, v = _carried(numeric, before, what)
    q = _closed(numeric, law, before.t, q, z, what)
    jump = law.solve(numeric, before.t, q, v, z)
    if largest(jump.left_over) > NEGLIGIBLE * (1 + largest(jump.v) + largest(v)):
        worst = law.row_names[int(np.argmax(np.abs(jump.contradiction)))]
        raise SimulationError(
            f"{what}: no velocities meet all rows of the new mechanism; {worst} would be missed by "
            f"{largest(jump.left_over):.3g}",
            time=before.t,
        )
    return q, jump


def _carried(numeric: NumericEquations, before: State, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates and velocities of the bodies, and estimates of other coordinates that are new."""
    eom, theirs = numeric.eom, before.mechanism
    for body in eom.mechanism.bodies:
        if body not in theirs.bodies:
            raise SimulationError(
                f"{what}: body '{body.name}' of the new mechanism is not in the one before, and so its place is not "
                "known; bodies may be removed, not added",
                time=before.t,
            )
    q, v = eom.estimate[0].copy(), np.zeros(eom.q.numel())
    for values, symbols in ((q, eom.q), (v, eom.v)):
        for k, symbol in enumerate(ca.vertsplit(symbols)):
            if before.equations.contains(symbol):
                values[k] = before[symbol]
    return q, v


def _closed(numeric: NumericEquations, law: ImpactLaw, t: float, q: np.ndarray, z: np.ndarray, what: str) -> np.ndarray:
    """The pose on the constraints of a new mechanism; one in which they do not hold is refused."""
    eom, count = numeric.eom, 3 * len(numeric.eom.mechanism.bodies)
    of_bodies, others = np.split(q, [count])

    def rows(others: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi, jacobian = numeric.position(t, np.r_[of_bodies, others], z)
        return phi, jacobian[:, count:]

    if others.size:  # coordinates without inertia belong to the joints that close
        q = np.r_[of_bodies, solve(rows, others, np.ones(others.size)).x]
    phi = numeric.position(t, q, z)[0]
    function = ca.Function("momentary", [eom.t, eom.q, eom.p], [ca.densify(law.momentary)])
    moment = function(t, q, numeric.p).full().ravel()
    limits = np.r_[position_limits(numeric), position_limits(numeric, np.zeros(moment.size, bool))]
    residual = np.abs(np.r_[phi, moment])
    if np.any(residual > limits):
        worst = int(np.argmax(residual / limits))
        raise SimulationError(
            f"{what}: the position of '{law.position_names[worst]}' of the new mechanism does not hold, it is off by "
            f"{residual[worst]:.3g}; a joint closes where its rows vanish, or a parameter in it takes the value of "
            "that instant",
            time=t,
        )
    return np.asarray(Recovery(numeric, redundant=False).positions(np.array([t]), q[None, :], z[None, :])[0])
