"""Equilibria along a parameter."""

from __future__ import annotations

from typing import Any

from ..arguments.inputs import read_signals
from ..arguments.values import pairs_of
from ..equations.numeric import NumericEquations
from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..model.symbols import Input, Parameter, number
from .equilibrium import equilibrium
from .follower import EquilibriumPath, Follower
from .statics import Statics


def equilibrium_path(
    mechanism: Mechanism,
    parameter: Input | Parameter,
    start: float,
    end: float,
    conditions: Any = (),
    *,
    steps: int = 50,
    inputs: Any = None,
    parameters: Any = None,
    prefer: str = "stable",
    t: float = 0.0,
) -> EquilibriumPath:
    """Follow an equilibrium while a parameter or an input changes.

    The path is followed along its length, so that it passes the points at which
    it turns back (snap-through). Where the number of negative eigenvalues of
    the reduced stiffness changes, or where oscillations begin to grow with the
    damping that the model has (under loads that follow a body, feedback, or
    falling friction), the critical value is located.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    parameter : Parameter or Input
        What changes: a load, a length, a torque.
    start, end : float
        From where to where. A path that turns back may go beyond the start, by as much again.
    conditions, inputs, parameters, prefer, t
        Of the equilibrium at the start; see :func:`equilibrium`.
    steps : int, default 50
        Steps from start to end, where the path is straight; it takes smaller ones where it is not.

    Returns
    -------
    EquilibriumPath
        ``.critical`` holds the buckling loads.

    Raises
    ------
    EquilibriumError
        Where there is no equilibrium at the start, or the path cannot be followed.

    References
    ----------
    Crisfield, "A fast incremental/iterative solution procedure that handles snap-through", Computers & Structures 13,
    1981; Seydel, *Practical Bifurcation and Stability Analysis*, Springer 2010, chapters 4 and 5.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> load = mbd.Parameter("load", 0.0)
    >>> bar = mbd.Body("bar", mass=1, inertia=1, pose=(0, 0.5, np.pi / 2))
    >>> foot = mbd.Revolute("foot", mbd.ground.at(0, 0), bar.at(-0.5, 0))
    >>> spring = mbd.RSDA("spring", mbd.ground.at(0, 0), bar.at(-0.5, 0), stiffness=30, free_angle=np.pi / 2)
    >>> push = mbd.Force("push", bar.at(0.5, 0), (0, -load))
    >>> column = mbd.Mechanism(bodies=[bar], joints=[foot], forces=[spring, push], parameters=[load])
    >>> path = mbd.equilibrium_path(column, load, 0, 50)
    >>> round(path.critical[0].value, 6), path.critical[0].kind
    (30.0, 'bifurcation')
    """
    if not isinstance(parameter, Input | Parameter):
        raise ModelError(f"equilibrium_path: takes an Input or a Parameter, got {parameter!r}")
    first, last = (number(x, "equilibrium_path", name) for x, name in ((start, "start"), (end, "end")))
    if first == last or not isinstance(steps, int) or steps < 1:
        raise ModelError(f"equilibrium_path: start = {first}, end = {last}, steps = {steps!r} leave nothing to follow")
    values = {"inputs": pairs_of(inputs, "inputs="), "parameters": pairs_of(parameters, "parameters=")}
    kind = "inputs" if isinstance(parameter, Input) else "parameters"
    values[kind] = [pair for pair in values[kind] if pair[0] is not parameter] + [(parameter, first)]
    origin = equilibrium(mechanism, conditions, values["inputs"], values["parameters"], prefer=prefer, t=t)
    numeric = NumericEquations(origin.equations, origin.parameters)
    statics = Statics(numeric, read_signals(numeric.eom, values["inputs"]), origin.t, [parameter])
    return Follower(statics, parameter, first, last, steps).run(origin)
