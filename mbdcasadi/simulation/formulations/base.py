"""The base class of forms of the equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from ...arguments.inputs import Signals
from ...equations.numeric import NumericEquations
from ...equations.tree import TreeCoordinates, tree_coordinates
from ...integrators import Integrator
from ...integrators.compiled import Clock, Dae, PartOfState
from ..contact.compiled_elements import CompiledElements

#: Arguments of the equations of a piece: ``t, q, v, z, u, p`` and the rate at which drift decays.
Arguments = tuple[ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX, ca.SX]


@dataclass(frozen=True)
class Formulation(ABC):
    """A form of the equations.

    Attributes
    ----------
    name : str
        Its name in the statistics of a run.
    is_algebraic : bool
        True if accelerations and multipliers are unknowns of the integrator.
    tolerates_redundancy : bool
        True if rows may depend on each other.
    """

    name: ClassVar[str]
    is_algebraic: ClassVar[bool] = False
    tolerates_redundancy: ClassVar[bool] = False

    @classmethod
    @abstractmethod
    def suits(cls, numeric: NumericEquations, integrator: Integrator, *, redundant: bool) -> bool:
        """Return True if an integrator should take the equations in this form.

        Parameters
        ----------
        redundant : bool
            True if rows are dependent.
        """

    @abstractmethod
    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return ``(a, lam, residual)`` in the symbols of the equations: expressions, or unknowns with their residual.

        Parameters
        ----------
        force : casadi.SX
            Generalised forces (n,): ``Q``, or symbols in its place.
        rate : casadi.SX
            Rate at which drift decays, 1/s.
        """

    def accelerations(self, numeric: NumericEquations, arguments: Arguments) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return ``(a, lam, residual)`` under the generalised forces of the equations, at some arguments."""
        eom = numeric.eom
        return self._system(numeric)(*arguments, eom.a, eom.lam)

    def _system(self, numeric: NumericEquations, force: ca.SX | None = None) -> ca.Function:
        """``(t, q, v, z, u, p, rate, a, lam) -> (a, lam, residual)``; forces that are symbols are the last argument."""
        eom, rate = numeric.eom, ca.SX.sym("rate")
        results = self.under_forces(numeric, eom.Q if force is None else force, rate)
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p, rate, eom.a, eom.lam]
        arguments += [] if force is None else [force]
        return ca.Function("system", arguments, [ca.densify(part) for part in results])

    def takes_tree(self, numeric: NumericEquations, tree: TreeCoordinates) -> bool:
        """Return True if the coordinates that a tree of joints gives are better left out of the states."""
        return False

    def dae(
        self,
        numeric: NumericEquations,
        signals: Signals,
        integrands: ca.SX | None = None,
        quadratures: ca.SX | None = None,
        *,
        in_tree: bool = False,
    ) -> Dae:
        """Return the system of the integrator over a piece.

        The state is ``x = (q, v, z)`` and the integrals of `integrands`; parameters are
        those of the mechanism, the levels of the inputs, and the rate at which drift decays.

        Parameters
        ----------
        integrands : casadi.SX, optional
            Expressions whose integrals are states of their own.
        quadratures : casadi.SX, optional
            Expressions that are integrated outside the state and its error test.
        in_tree : bool
            True to leave coordinates that a tree of joints gives out of what is integrated, if that pays.
        """
        eom, clock, none = numeric.eom, Clock(), ca.SX(0, 1)
        tree = self._tree(numeric) if in_tree else None
        q, v = (eom.q, eom.v) if tree is None else (tree.q, tree.v)
        (u,) = ca.substitute([signals.parametrised], [eom.t, eom.q, eom.v], [clock.t, q, v])
        rate = ca.SX.sym("rate")
        integrands = none if integrands is None else integrands
        a, lam, residual = self.accelerations(numeric, (clock.t, q, v, eom.z, u, eom.p, rate))
        rates = ca.Function(
            "rates", [*eom.symbols], [ca.vertcat(eom.z_rate, integrands), none if quadratures is None else quadratures]
        )
        z_rate, quad = rates(clock.t, q, v, a, eom.z, lam, u, eom.p)
        x, part = ca.vertcat(eom.q, eom.v, eom.z, ca.SX.sym("integrals", integrands.numel())), None
        ode = ca.vertcat(v, a, z_rate)
        p = ca.vertcat(eom.p, signals.levels, rate)
        if tree is not None:
            places, states = tree.places_in(x), ca.vertcat(q, v, x[2 * eom.q.numel() :])
            x, ode = x[places], ode[places]
            part = PartOfState(places, ca.Function("whole", [x, p], [states]))
        return Dae(
            clock,
            x=x,
            z=ca.vertcat(a, lam) if self.is_algebraic else none,
            p=p,
            u=signals.channel,
            ode=ode,
            alg=residual,
            quad=quad,
            part=part,
        )

    def _tree(self, numeric: NumericEquations) -> TreeCoordinates | None:
        """Coordinates that are left out of what is integrated; None if there are none, or if they are better kept."""
        tree = tree_coordinates(numeric.eom)
        return tree if tree.dependent and self.takes_tree(numeric, tree) else None

    def compiled_dae(self, numeric: NumericEquations, signals: Signals, elements: CompiledElements) -> Dae:
        """Return the same system with forces of compiled elements, and their rates integrated along."""
        eom, clock, MX = numeric.eom, Clock(ca.MX), ca.MX
        q, v, z, p = (MX.sym(name, getattr(eom, name).numel()) for name in ("q", "v", "z", "p"))
        levels, channel = MX.sym("levels", signals.levels.numel()), MX.sym("channel", signals.channel.numel())
        rate, force = MX.sym("rate"), ca.SX.sym("Q", eom.q.numel())
        unknown = [MX.sym(name, getattr(eom, name).numel()) for name in ("a", "lam")] if self.is_algebraic else None
        u = signals.function(eom)(clock.t, q, v, z, p, levels, channel)
        none = [MX.zeros(symbols.numel()) for symbols in (eom.a, eom.lam, eom.z)]
        values = elements.values
        column = values.column(clock.t, q, v, none[0], z, none[1], u, p, z_rate=none[2])
        lam = none[1] if unknown is None else unknown[1]
        total = elements.rest(clock.t, q, v, z, lam, u, p) + elements.forces(column)
        system = self._system(numeric, force)
        a, lam, residual = system(clock.t, q, v, z, u, p, rate, *(unknown or none[:2]), total)
        z_rate = ca.Function("z_rate", list(eom.symbols), [ca.densify(eom.z_rate)])(clock.t, q, v, a, z, lam, u, p)
        return Dae(
            clock,
            x=ca.vertcat(q, v, z),
            z=ca.vertcat(a, lam) if self.is_algebraic else MX(0, 1),
            p=ca.vertcat(p, levels, rate),
            u=channel,
            ode=ca.vertcat(v, a, z_rate),
            alg=residual,
            quad=elements.rates(values.column(clock.t, q, v, a, z, lam, u, p, z_rate=z_rate)),
        )
