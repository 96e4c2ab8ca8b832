"""Motion up to where forces jump, with the switches of these forces held on their sides.

The sign of a sliding velocity in a clutch that locks, say, changes where an event is: an integrator that steps across
it meets a force that turns against the motion on either side, and gets stuck. So does one whose unknown reactions jump
with a force on which they depend. With the switches held, the motion is smooth and passes the border; behind it the
integrator starts anew.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import casadi as ca
import numpy as np

from ...arguments.inputs import Signals
from ...equations.numeric import NumericEquations
from ...equations.switching.held import HeldEquations, JumpingPart, jumping_parts, part_of
from ...equations.switching.switches import Switch, hold, margins_of, sides_of
from ...numerics.evaluation import Evaluator
from ...numerics.roots import bracketed_root
from ..outputs import Outputs
from ..path import StatesAt
from ..stepper import SteppedSystem
from .compiled_stepper import CompiledStepper

#: Distance from its border where an integrator got stuck, relative to that some time before, below which a switch is
#: what it got stuck at: the place is known to the 2^-16 of the time between two outputs.
NEAR = 1e-2
#: The same of an event that was located, relative to some 1e-5 of a run before it.
AT_EVENT = 1e-3


def parts_of_motion(
    numeric: NumericEquations, signals: Signals, integrands: ca.SX | None = None, *, bends: bool = False
) -> tuple[JumpingPart, ...]:
    """Return the parts of equations, inputs and integrands in which a value jumps, or with `bends` a slope."""
    parts = list(jumping_parts(numeric, bends=bends))
    for k in signals.given_by_expressions:
        description = f"input '{numeric.eom.mechanism.inputs[k].label}'"
        parts += part_of(numeric, "input", k, (signals.parametrised[k],), description, bends=bends)
    integrands = ca.SX(0, 1) if integrands is None else integrands
    for k in range(integrands.numel()):
        parts += part_of(numeric, "integrand", k, (integrands[k],), "the running cost", bends=bends)
    return tuple(parts)


class MotionSwitches:
    """The parts of a motion in which something jumps, and all their switches; made once for a mechanism.

    Attributes
    ----------
    parts : tuple of JumpingPart
        The parts.
    switches : tuple of Switch
        Their switches.
    whole : numpy.ndarray of bool
        True if a switch has its borders at whole numbers.
    natural : casadi.SX
        Their quantities with nothing held.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals):
        self.parts = parts_of_motion(numeric, signals)
        self.switches = tuple(s for part in self.parts for s in hold(part.expressions, free=part.continuous)[1])
        self.whole = np.array([switch.whole for switch in self.switches], bool)
        self.natural = ca.densify(ca.vertcat(ca.SX(0, 1), *[switch.natural for switch in self.switches]))


def switches_of(numeric: NumericEquations, signals: Signals) -> MotionSwitches:
    """Return the switches of a motion."""
    return signals.kept(
        numeric.eom, ("switches of the motion",), lambda: MotionSwitches(numeric, signals), bounded=True
    )


def held_motion(
    numeric: NumericEquations, signals: Signals, parts: Collection[JumpingPart], free: Collection[int]
) -> tuple[HeldEquations, Signals]:
    """Return the equations and the inputs with their switches held; the sides are the last parameters.

    Parameters
    ----------
    parts : collection of JumpingPart
        The parts in which something jumps.
    free : collection of int
        Operations that are left as they are.
    """
    eom = HeldEquations(numeric.eom, tuple(parts), free)
    parametrised = ca.SX(signals.parametrised)
    for (kind, place), held in eom.held.items():
        if kind == "input":
            parametrised[place] = held[0]
    return eom, replace(signals, parametrised=parametrised)


class HeldSwitches:
    """Switches at their borders at a state, and the system in which they are held on the sides that they were on.

    Parameters
    ----------
    system : SteppedSystem
        The equations, inputs and method of the run.
    outputs : Outputs
        What makes its outputs.
    since : float
        Start of the interval of whose inputs the motion is.
    before, there : tuple of (float, numpy.ndarray)
        Times and states at which the switches are on their sides, and at which they are at their borders.
    near : float
        Distance from a border, relative to that before, that counts as none.

    Attributes
    ----------
    switches : tuple of Switch
        Switches that are held; none if nothing switches there.
    sides : numpy.ndarray
        Their sides.
    system : SteppedSystem
        That in which they are held; the given one if there are none.
    """

    def __init__(
        self,
        system: SteppedSystem,
        outputs: Outputs,
        since: float,
        before: tuple[float, np.ndarray],
        there: tuple[float, np.ndarray],
        near: float = NEAR,
    ):
        self.switches: tuple[Switch, ...] = ()
        self.system, self.sides = system, np.zeros(0)
        numeric, signals = system.numeric, system.signals
        motion = switches_of(numeric, signals)
        parts, every, whole = motion.parts, motion.switches, motion.whole
        if not every:
            return
        values = [natural_values(system, outputs, since, *at) for at in (before, there)]
        sides = sides_of(values[0], whole)
        far, rest = (margins_of(value, sides, whole) for value in values)
        chosen = (far > 0) & (np.abs(rest) <= near * far)
        if not np.any(chosen):
            return
        nodes = {switch.node for switch, at_border in zip(every, chosen, strict=True) if at_border}
        free = frozenset(switch.node for switch in every) - nodes
        (eom, held), _ = signals.kept(  # the operations are kept beside it: hashes are unique only while they live
            numeric.eom, ("held", free), lambda: (held_motion(numeric, signals, parts, free), parts), bounded=True
        )
        if not eom.switches:
            return
        side_of = {switch.node: side for switch, side in zip(every, sides, strict=True)}
        self.switches, self.sides = eom.switches, np.array([side_of[switch.node] for switch in eom.switches])
        self.system = replace(
            system,
            numeric=NumericEquations(eom, np.r_[numeric.p, self.sides]),
            signals=replace(signals, parametrised=held.parametrised),
        )

    @property
    def outputs(self) -> Outputs:
        """What makes outputs with the switches held."""
        system = self.system
        return Outputs(system.numeric, system.signals, system.levels, redundant=system.redundant)


class HeldMotion:
    """The motion from a state on which switches are held on the sides on which they were before.

    Parameters
    ----------
    held : HeldSwitches
        The switches, at least one.
    start : float
        Time from which it goes on.
    x : numpy.ndarray
        State there.
    """

    def __init__(self, held: HeldSwitches, start: float, x: np.ndarray):
        self._held, self._start = held, start
        self._stepper = CompiledStepper(held.system)
        self.states_at: StatesAt = self._stepper.states_from(start, x, precise=True)

    def beyond_border(self, until: float, instant: float) -> float | None:
        """Time just after the first at which a switch passes its border, by at least an instant; None up to a time."""
        first, last = (float(self._margin(np.array([time]))[0]) for time in (self._start, until))
        if not first > 0 >= last:
            return None
        passing = bracketed_root(self._margin, self._start, until, first, last)
        while passing < until:
            passing, instant = min(passing + instant, until), 2 * instant
            if self._margin(np.array([passing]))[0] < 0:
                return passing
        return None

    def _margin(self, at: np.ndarray) -> np.ndarray:
        """Smallest distance of a switch from the border of its side at one time (1,); negative beyond."""
        switches = self._held.switches
        quantities = ca.densify(ca.vertcat(*[switch.quantity for switch in switches]))
        whole = np.array([switch.whole for switch in switches], bool)
        system, outputs = self._held.system, self._stepper.outputs
        values = _values(system, outputs, quantities, self._start, at, self.states_at(at))
        smallest: np.ndarray = np.min(margins_of(values, self._held.sides, whole), axis=0)
        return smallest

    def release(self) -> None:
        """Give back what is kept for later motions."""
        self._stepper.release()


def natural_values(system: SteppedSystem, outputs: Outputs, since: float, time: float, x: np.ndarray) -> np.ndarray:
    """Quantities of all switches of a motion at a state, with nothing held (switches,)."""
    natural = switches_of(system.numeric, system.signals).natural
    return _values(system, outputs, natural, since, np.array([time]), x[None, :])[:, 0]


def _values(
    system: SteppedSystem, outputs: Outputs, quantities: ca.SX, start: float, times: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Values of quantities at states (quantities, k), under the inputs of the interval of a motion."""
    since, signals = np.full(times.size, min(start, times[0])), system.signals
    known = [*outputs.numeric.eom.symbols, signals.levels, signals.channel]
    evaluator = Evaluator(ca.Function("quantities", known, [quantities]))
    t, *rest = outputs.block(times, x, since)
    return evaluator.rows(t[:, None], *rest, outputs.numeric.p, system.levels, signals.columns_from(since))[0].T
