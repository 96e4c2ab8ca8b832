"""Motion up to an event at whose zero forces jump, with the switches of these forces held on their sides.

The sign of a sliding velocity in a clutch that locks, say, changes where the event is: an integrator that steps across
it meets a force that turns against the motion on either side, and gets stuck. With the sign held, the motion is smooth
and passes the event, behind which it is not used.
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
from ..outputs import Outputs
from ..path import StatesAt
from ..stepper import SteppedSystem
from .compiled_stepper import CompiledStepper

#: Distance from its border where an integrator got stuck, relative to that some time before, below which a switch is
#: what it got stuck at: the place is known to the 2^-16 of the time between two outputs.
NEAR = 1e-2
#: Points of the way to an event at which held switches must be on their sides.
CHECKS = 32


def parts_of_motion(
    numeric: NumericEquations, signals: Signals, integrands: ca.SX | None = None
) -> tuple[JumpingPart, ...]:
    """Return the parts of the equations, of inputs and of integrands in which something jumps."""
    parts = list(jumping_parts(numeric))
    for k in signals.given_by_expressions:
        description = f"input '{numeric.eom.mechanism.inputs[k].label}'"
        parts += part_of(numeric, "input", k, (signals.parametrised[k],), description)
    integrands = ca.SX(0, 1) if integrands is None else integrands
    for k in range(integrands.numel()):
        parts += part_of(numeric, "integrand", k, (integrands[k],), "the running cost")
    return tuple(parts)


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


class HeldMotion:
    """A motion on which the switches that an integrator got stuck at are held on the sides on which they were before.

    Parameters
    ----------
    system : SteppedSystem
        The equations, inputs and method of the run.
    outputs : Outputs
        What makes its outputs.
    start : tuple of (float, numpy.ndarray)
        Time and state from which it goes on.
    before, stuck : tuple of (float, numpy.ndarray)
        Times and states at which the switches are on their sides, and where the integrator got stuck.
    free : collection of int
        Operations that are left as they are.

    Attributes
    ----------
    switches : tuple of Switch
        Switches that are held; none if nothing switches where the integrator got stuck.
    """

    def __init__(
        self,
        system: SteppedSystem,
        outputs: Outputs,
        start: tuple[float, np.ndarray],
        before: tuple[float, np.ndarray],
        stuck: tuple[float, np.ndarray],
        free: Collection[int] = (),
    ):
        (self._start, x_start), self._levels = start, system.levels
        numeric, signals = system.numeric, system.signals
        parts = signals.kept(
            numeric.eom, ("parts of the motion",), lambda: parts_of_motion(numeric, signals), bounded=True
        )
        every = [s for part in parts for s in hold(part.expressions, free=part.continuous)[1]]
        whole = np.array([switch.whole for switch in every], bool)
        natural = ca.densify(ca.vertcat(ca.SX(0, 1), *[switch.natural for switch in every]))
        values = [self._values(outputs, signals, natural, np.array([t]), x[None])[:, 0] for t, x in (before, stuck)]
        sides = sides_of(values[0], whole)
        far, near = (margins_of(value, sides, whole) for value in values)
        chosen = (far > 0) & (np.abs(near) <= NEAR * far)
        self.switches: tuple[Switch, ...] = ()
        if not np.any(chosen):
            return
        nodes = {switch.node for switch, at_border in zip(every, chosen, strict=True) if at_border}
        free = frozenset(switch.node for switch in every) - (nodes - set(free))
        (eom, held), _ = signals.kept(  # the operations are kept beside it: hashes are unique only while they live
            numeric.eom, ("held", free), lambda: (held_motion(numeric, signals, parts, free), parts), bounded=True
        )
        side_of = {switch.node: side for switch, side in zip(every, sides, strict=True)}
        if not eom.switches:
            return
        self.switches, self._whole = eom.switches, np.array([switch.whole for switch in eom.switches], bool)
        self._sides = np.array([side_of[switch.node] for switch in eom.switches])
        self._stepper = CompiledStepper(
            replace(
                system,
                numeric=NumericEquations(eom, np.r_[numeric.p, self._sides]),
                signals=replace(signals, parametrised=held.parametrised),
            )
        )
        self.states_at: StatesAt = self._stepper.states_from(self._start, x_start, precise=True)

    def passed(self, until: float) -> frozenset[int]:
        """Operations that are held and come to their borders before a time; without any the motion is the true one."""
        if until <= self._start:
            return frozenset()
        times = np.linspace(self._start, until, CHECKS + 1)[1:]
        outputs, signals = self._stepper.outputs, self._stepper.signals
        quantities = ca.densify(ca.vertcat(*[switch.quantity for switch in self.switches]))
        margins = margins_of(
            self._values(outputs, signals, quantities, times, self.states_at(times)), self._sides, self._whole
        )
        return frozenset(self.switches[k].node for k in np.flatnonzero(~np.all(margins >= 0, axis=1)))

    def release(self) -> None:
        """Give back what is kept for later motions."""
        if self.switches:
            self._stepper.release()

    def _values(
        self, outputs: Outputs, signals: Signals, quantities: ca.SX, times: np.ndarray, x: np.ndarray
    ) -> np.ndarray:
        """Values of quantities at states (quantities, k), under the inputs of the interval of the motion."""
        since = np.full(times.size, min(self._start, times[0]))
        known = [*outputs.numeric.eom.symbols, signals.levels, signals.channel]
        evaluator = Evaluator(ca.Function("quantities", known, [quantities]))
        t, *rest = outputs.block(times, x, since)
        return evaluator.rows(t[:, None], *rest, outputs.numeric.p, self._levels, signals.columns_from(since))[0].T
