"""The loads at which a mechanism rests: between them friction sticks, and contacts stay closed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..equations import equations
from ..errors import ModelError
from ..model.conditions import read_conditions
from ..model.forces.friction.modes import without_exact_friction
from ..model.mechanism import Mechanism
from ..model.symbols import Input, Parameter
from ..numerics.console import keyboard_interrupts
from ..results.state import Conditions, State
from .equilibrium import Equilibrium, rest_near, start_of, value_of
from .held import Held, HoldingProgram, laws_of_limits
from .statics import Statics


@dataclass(frozen=True)
class HoldingRange:
    """Loads at which a mechanism rests.

    Attributes
    ----------
    load : Input or Parameter
        The symbol.
    least, greatest : float
        Its range; infinite if there is no end.
    at_least, at_greatest : Equilibrium or None
        The equilibria there; None if there is no end.
    gives_at_least, gives_at_greatest : tuple of str
        What happens beyond: which places slide and open, or that an input is at its limit.
    """

    load: Input | Parameter
    least: float
    greatest: float
    at_least: Equilibrium | None
    at_greatest: Equilibrium | None
    gives_at_least: tuple[str, ...]
    gives_at_greatest: tuple[str, ...]

    def __repr__(self) -> str:
        lines = [f"HoldingRange: {self.load.label} = {self.least:.6g} … {self.greatest:.6g}"]
        for word, gives in (("below", self.gives_at_least), ("above", self.gives_at_greatest)):
            lines += [f"  {word}: {', '.join(gives)}"] if gives else []
        return "\n".join(lines)


def holding_range(
    mechanism: Mechanism,
    load: Input | Parameter,
    conditions: Conditions = (),
    *,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    t: float = 0.0,
) -> HoldingRange:
    """Find the least and the greatest load at which dry friction holds a mechanism at rest.

    ``min, max P`` with ``Q(q, P) - Phi_q^T lam = 0``, ``N >= 0`` of every contact that touches and ``|F| <= μ_s N`` of
    every friction: a linear program, so that reactions need not be unique. What is free to move, as a mass on a
    spring, follows the load; limits that are no linear functions of the reactions are followed by several programs.

    Parameters
    ----------
    mechanism : Mechanism
        The model, with ``DryFriction``, ``RigidContact`` or clutches.
    load : Input or Parameter
        Symbol of a load: any that moves no joint; an input stays within its limits.
    conditions, inputs, parameters, t
        The pose, and values of everything else, as for :func:`equilibrium`; the pose need not hold at the value of
        the load.

    Returns
    -------
    HoldingRange
        ``.least``, ``.greatest``, and what slides or opens beyond them.

    Raises
    ------
    EquilibriumError
        If no load holds the pose, or an end is not found.
    ModelError
        If nothing in the mechanism sticks or touches, or joints move with the load.

    References
    ----------
    Moreau, "Unilateral contact and dry friction in finite freedom dynamics", 1988; Pfeiffer and Glocker, *Multibody
    Dynamics with Unilateral Contacts*, 1996.

    Examples
    --------
    A block of 2 kg on an incline of 20°, ``m g (sin a ∓ μ cos a)``:

    >>> import numpy as np, mbdcasadi as mbd
    >>> block, push = mbd.Body("block", mass=2, inertia=0.1), mbd.Parameter("push", 0.0)
    >>> rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=np.radians(20)), block.at(0, 0))
    >>> rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.5))
    >>> along = mbd.Force("along", block.at(0, 0), (np.cos(np.radians(20)) * push, np.sin(np.radians(20)) * push))
    >>> incline = mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), rub, along], parameters=[push])
    >>> found = mbd.holding_range(incline, push)
    >>> round(found.least, 6), round(found.greatest, 6)
    (-2.507949, 15.92882)
    """
    if not isinstance(load, Input | Parameter):
        raise ModelError(f"holding_range: takes an Input or a Parameter, got {load!r}")
    with keyboard_interrupts("holding_range"):
        setup = Setup(mechanism, "holding_range", t=t, initial=conditions, inputs=inputs, parameters=parameters)
        setup.eom.function(load)  # refuses a symbol that the mechanism does not have
        if ca.depends_on(ca.vertcat(setup.eom.Phi, ca.vec(setup.eom.Phi_q), setup.eom.nu), load):
            raise ModelError(f"holding_range: joints move with '{load.label}', which is a load only if they do not")
        statics, x, held = _at_rest(setup, load)
        program = HoldingProgram(statics, [*held.laws, *laws_of_limits(load)])
        (low, below), (high, above) = (program.extreme(x, sign) for sign in (-1, 1))
        return HoldingRange(
            load,
            -np.inf if low is None else float(low[-1]),
            np.inf if high is None else float(high[-1]),
            None if low is None else Equilibrium(statics, low, held),
            None if high is None else Equilibrium(statics, high, held),
            tuple(dict.fromkeys(law.event for law in below)),
            tuple(dict.fromkeys(law.event for law in above)),
        )


def _at_rest(setup: Setup, load: Input | Parameter) -> tuple[Statics, np.ndarray, Held]:
    """The mechanism with everything stuck, balanced at the value of the load, which is the last of the unknowns."""
    start = start_of(setup, () if isinstance(setup.initial, State) else read_conditions(setup.initial))
    held, eom = Held(setup, start), equations(without_exact_friction(setup.mechanism))
    if not held.laws:
        raise ModelError("holding_range: nothing in the mechanism sticks or touches in this pose")
    q, z = (np.atleast_1d(start[group]) if group.numel() else np.zeros(0) for group in (eom.q, eom.z))
    alone = Statics(held.numeric, setup.signals, setup.time, (q, z))
    rest = rest_near(alone, alone.join(q, z, np.zeros(alone.m)))
    statics = Statics(held.numeric, setup.signals, setup.time, (q, z), [load])
    return statics, np.append(rest, value_of(load, eom, setup.p, start)), held
