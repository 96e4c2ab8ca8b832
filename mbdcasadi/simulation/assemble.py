"""Assembly: the consistent state nearest to the estimate that meets conditions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..assembly.setup import Setup
from ..model.conditions import read_conditions
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..numerics.console import keyboard_interrupts
from ..results.state import Conditions, State
from .changes.contact_modes import start_in_mode


def assemble(
    mechanism: Mechanism,
    conditions: Conditions = (),
    t: float = 0.0,
    inputs: Mapping[Any, Any] | None = None,
    parameters: Mapping[Any, Any] | None = None,
) -> State:
    """Find the consistent state that meets conditions, nearest to the estimate.

    Position, then velocity, each nearest to the bodies' estimates in the mass
    metric among all that meet the constraints and the conditions: parts without
    mass follow those that have some; if none has any, lengths and angles count by
    the size of the mechanism. Then accelerations and multipliers from the
    equations of motion. From the nearest consistent pose the conditions are
    approached by continuation, so that the branch of the linkage is kept.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    conditions : sequence of relations
        In positions, or linear in velocities; inequalities as well.
    t : float, default 0
        Time, s.
    inputs : mapping of Input to number or expression, optional
        Values other than the inputs' own.
    parameters : mapping of Parameter to number, optional
        Values other than the parameters' own.

    Returns
    -------
    State
        ``|Phi|`` and ``|Phi_q v - nu|`` vanish to rounding.

    Raises
    ------
    AssemblyError
        If the parts cannot be put together; ``.residuals`` holds the gaps by element.
    ConditionError
        For a condition that cannot be met, or contradicts the constraints or another one.

    References
    ----------
    Haug 1989, section 4.3 (assembly) and 7.3 (initial conditions).

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1, pose=(0.4, 0.1, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge])
    >>> state = mbd.assemble(pendulum, [arm.phi == np.pi / 2, arm.omega == 3])
    >>> float(np.round(state[arm.vx], 9))
    -1.5
    """
    rows = read_conditions(conditions)
    with keyboard_interrupts("assemble"):
        setup = Setup(mechanism, "assemble", t=t, initial=rows, inputs=inputs, parameters=parameters)
        return start_in_mode(setup) if switching(mechanism) else setup.start
