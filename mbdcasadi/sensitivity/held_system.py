"""A motion under equations whose switches are held: its rates, and the quantities that pass the borders."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations import Equations
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..equations.switching.held import JumpingPart
from ..equations.switching.switches import Switch, hold, sides_of
from ..integrators.compiled import CompiledIntegrator
from ..integrators.reversible import ReversibleIntegrator
from ..simulation.stepping.held_switches import held_motion

#: Steps of projection after an integration, whose drift is of the size of its tolerance.
PROJECTIONS = 3


class SwitchesInTime:
    """Switches that depend on time and parameters alone.

    Parameters
    ----------
    parts : sequence of JumpingPart
        The parts in which something jumps.

    Attributes
    ----------
    nodes : tuple of int
        Operations that jump in time alone.
    jump : numpy.ndarray of bool
        False for those over which their part is known to be continuous (switches,).
    rough : numpy.ndarray of bool
        False for those over which nothing need be held (switches,).
    descriptions : tuple of str
        Elements in which they stand.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals, parts: Collection[JumpingPart]):
        eom = numeric.eom
        owned = [(part, switch) for part in parts for switch in hold(part.expressions, bends=part.bends)[1]]
        switches = [switch for _, switch in owned]
        natural = ca.substitute(ca.vertcat(ca.SX(0, 1), *[s.natural for s in switches]), eom.u, signals.parametrised)
        timed = _in_time_alone(natural, eom)
        self.nodes = tuple(switches[k].node for k in timed)
        self.jump = np.array([owned[k][1].node not in owned[k][0].continuous for k in timed], bool)
        self.rough = np.array([owned[k][1].node not in owned[k][0].smooth for k in timed], bool)
        self.descriptions = tuple(owned[k][0].description for k in timed)
        self._whole = np.array([switches[k].whole for k in timed], bool)
        self._by_parameter = ca.jacobian_sparsity(natural[timed], eom.p) if timed and eom.p.numel() else None
        self._quantities = ca.Function("quantities", [eom.t, eom.p], [natural[timed]])

    def sides(self, times: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Sides of the switches at times (switches, k)."""
        if not self.nodes:
            return np.zeros((0, times.size))
        values = self._quantities(times[None, :], p).full()
        return sides_of(np.broadcast_to(values, (len(self.nodes), times.size)), self._whole)

    def depend_on(self, parameters: Collection[int]) -> np.ndarray:
        """True for switches that depend on some of the parameters, by the positions of these (switches,)."""
        depends = np.zeros(len(self.nodes), bool)
        if self._by_parameter is not None:
            rows, columns = (np.array(part, int) for part in self._by_parameter.get_triplet())
            depends[rows[np.isin(columns, list(parameters))]] = True
        return depends


def _in_time_alone(quantities: ca.SX, eom: Equations) -> list[int]:
    """Positions of the quantities that contain time and parameters alone."""
    known = {symbol.element_hash() for symbol in ca.vertsplit(ca.vertcat(eom.t, eom.p))}
    return [
        k
        for k, quantity in enumerate(ca.vertsplit(quantities))
        if all(symbol.element_hash() in known for symbol in ca.symvar(quantity))
    ]


class HeldSystem:
    """Equations of motion, inputs and integrands with their switches held.

    Parameters
    ----------
    integrands : casadi.SX
        Integrands along the motion.
    redundant : bool
        True if rows are dependent.
    parts : sequence of JumpingPart
        The parts in which something jumps.
    free : collection of int
        Operations that are left as they are.
    in_time : collection of int
        Operations that jump in time alone.
    ending : casadi.SX, optional
        Expression whose zero ends the motion.

    Attributes
    ----------
    numeric, signals, integrands
        Equations, inputs and integrands with the switches held; the sides are the last parameters.
    switches : tuple of Switch
        Switches that are held.
    whole : numpy.ndarray of bool
        True if a switch has its borders at whole numbers.
    in_time : numpy.ndarray of bool
        True if it jumps in time alone.
    bends : numpy.ndarray of bool
        True if slopes jump there, and no values: the instant has no part in the derivatives.
    quantities, switching, rates : casadi.Function
        Of ``(t, x, p, levels, channel)``: the quantities; quantities, their rates, and the rates of the state; the
        rates of the state alone. x is ``(q, v, z)`` and the integrals.
    slopes : casadi.Function
        Derivatives of the quantities by ``(t, x, p)``, of the same arguments.
    shares : casadi.Function
        Shares of their largest jumps that the switches have at a state, of the same arguments.
    ending : casadi.Function or None
        Rate of the expression whose zero ends the motion, and its derivatives by ``(t, x, p)``, of the same arguments.
    quantities_in_time, slopes_in_time : casadi.Function
        Quantities in time, and their derivatives by ``(t, p)``, of these; zero for others.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        integrands: ca.SX,
        *,
        redundant: bool,
        parts: Collection[JumpingPart],
        free: Collection[int],
        in_time: Collection[int],
        ending: ca.SX | None = None,
    ):
        held = [part for part in parts if part.nodes - part.smooth - set(free)]
        self.integrands, self.signals = ca.SX(integrands), signals
        self.numeric = numeric
        self.switches: tuple[Switch, ...] = self._hold(held, free) if held else ()
        self.whole = np.array([switch.whole for switch in self.switches], dtype=bool)
        self.in_time = np.array([switch.node in in_time for switch in self.switches], dtype=bool)
        self.bends = np.array([switch.share.is_zero() for switch in self.switches], dtype=bool)
        self.recovery = Recovery(self.numeric, redundant=redundant)
        self.ending: ca.Function | None = None
        if self.size:
            self._compile(redundant, ending)

    def _hold(self, parts: Collection[JumpingPart], free: Collection[int]) -> tuple[Switch, ...]:
        """Put held expressions in the place of natural ones; what is held."""
        eom, self.signals = held_motion(self.numeric, self.signals, parts, free)
        self.numeric = NumericEquations(eom, np.r_[self.numeric.p, np.zeros(len(eom.switches))])
        for (kind, place), held in eom.held.items():
            if kind == "integrand":
                self.integrands[place] = held[0]
        return eom.switches

    @property
    def state_size(self) -> int:
        """Number of components of the state ``(q, v, z)``."""
        return 2 * int(self.numeric.eom.q.numel()) + int(self.numeric.eom.z.numel())

    @property
    def size(self) -> int:
        """Number of switches."""
        return len(self.switches)

    def _compile(self, redundant: bool, ending: ca.SX | None) -> None:
        eom, signals = self.numeric.eom, self.signals
        kind = ca.MX if eom.Q_depends_on_lam else ca.SX
        n, k = eom.q.numel(), eom.z.numel()
        quantities = ca.vertcat(ca.SX(0, 1), *[switch.quantity for switch in self.switches])
        substituted = ca.substitute(quantities, eom.u, signals.parametrised)
        sizes = [1, 2 * n + k + self.integrands.numel(), eom.p.numel()]
        sizes += [signals.levels.numel(), signals.channel.numel()]
        t, x, p, levels, channel = arguments = [kind.sym(f"argument {i}", size) for i, size in enumerate(sizes)]
        q, v, a, z, lam, u = completed(self.numeric, signals, arguments, redundant=redundant)
        of_all = [*eom.symbols, signals.levels, signals.channel]
        rest = ca.Function(
            "rest", of_all, [ca.densify(ca.vertcat(eom.z_rate, self.integrands)), ca.densify(quantities)]
        )
        z_rate, w = rest(t, q, v, a, z, lam, u, p, levels, channel)
        rates = ca.vertcat(v, a, z_rate)
        everything, all_rates = ca.vertcat(t, x), ca.vertcat(1, rates)
        w_rates = ca.jtimes(w, everything, all_rates)
        self.quantities = ca.Function("quantities", arguments, [w])
        self.rates = ca.Function("rates", arguments, [rates])
        self.switching = ca.Function("switching", arguments, [w, w_rates, rates])

        def by_all(expression: Any) -> Any:
            return ca.densify(ca.horzcat(*[ca.jacobian(expression, part) for part in (t, x, p)]))

        self.slopes = ca.Function("slopes", arguments, [by_all(w)])
        shares = ca.densify(ca.vertcat(*[switch.share for switch in self.switches]))
        of_state = ca.Function("shares", of_all, [ca.substitute(shares, eom.u, signals.parametrised)])
        self.shares = ca.Function("shares", arguments, [of_state(t, q, v, a, z, lam, u, p, levels, channel)])
        if ending is not None:
            end = eom.function(ending)(t, q, v, a, z, lam, u, p)
            self.ending = ca.Function("ending", arguments, [ca.jtimes(end, everything, all_rates), by_all(end)])
        timed = ca.vertcat(*[w if own else 0 for w, own in zip(ca.vertsplit(substituted), self.in_time, strict=True)])
        self.quantities_in_time = ca.Function("quantities_in_time", [eom.t, eom.p], [ca.densify(timed)])
        by_time = ca.densify(ca.jacobian(ca.sparsify(timed), ca.vertcat(eom.t, eom.p)))
        self.slopes_in_time = ca.Function("slopes_in_time", [eom.t, eom.p], [by_time])

    def projected(self, time: float, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return a state on the constraints, for parameters with the sides."""
        eom, weights = self.numeric.eom, self.numeric.projection_weights
        n = eom.q.numel()
        q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + eom.z.numel()]
        for _ in range(PROJECTIONS if eom.Phi.numel() else 0):
            q = self.recovery.position_step(time, q, z, p, weights)[0].full().ravel()
        for _ in range(2 if eom.lam.numel() else 0):
            v = self.recovery.velocity_step(time, q, v, z, p, weights)[0].full().ravel()
        return np.r_[q, v, x[2 * n :]]


def completed(
    numeric: NumericEquations, signals: Signals, arguments: Sequence[Any], *, redundant: bool
) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return ``q, v, a, z, lam, u`` at ``t, x, p, levels, channel``, of which x begins with ``(q, v, z)``."""
    (t, x, p, levels, channel), eom = arguments, numeric.eom
    n, k = eom.q.numel(), eom.z.numel()
    q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + k]
    u = signals.function(eom)(t, q, v, z, p, levels, channel)
    a, lam = numeric.forward_dynamics(redundant=redundant)(t, q, v, z, u, p)
    return q, v, a, z, lam, u


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """A motion with its switches held: equations and integrators.

    Attributes
    ----------
    system : HeldSystem
        The equations.
    compiled : CompiledIntegrator
        Their integrator.
    backwards : ReversibleIntegrator or None
        The one that is differentiated backwards too, if any.
    unknowns : numpy.ndarray
        Estimate of the algebraic unknowns.
    decay : float
        Rate at which drift decays in the regularised form, 1/s.
    """

    system: HeldSystem
    compiled: CompiledIntegrator
    backwards: ReversibleIntegrator | None
    unknowns: np.ndarray
    decay: float
