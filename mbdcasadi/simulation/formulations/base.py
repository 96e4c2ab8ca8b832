"""The base class of forms of the equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca

from ...arguments.inputs import Signals
from ...equations import Equations
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

    def accelerations(
        self, numeric: NumericEquations, arguments: Arguments, unknown: Sequence[ca.SX]
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return ``(a, lam, residual)`` under the generalised forces of the equations, for arguments and unknowns."""
        return self._system(numeric)(*arguments, *unknown)

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

    def accelerations_in_tree(
        self, numeric: NumericEquations, tree: TreeCoordinates, arguments: Arguments
    ) -> ca.SX | None:
        """Return the accelerations by the inertia of a tree of joints; None if they are better found otherwise.

        Parameters
        ----------
        arguments : tuple
            With the coordinates and velocities of the tree.
        """
        return None

    def given_accelerations(self, numeric: NumericEquations, tree: TreeCoordinates) -> list[int]:
        """Return the places of accelerations that their own rows of motion give, so that they are no unknowns."""
        return []

    def dae(
        self,
        numeric: NumericEquations,
        signals: Signals,
        integrands: ca.SX | None = None,
        quadratures: ca.SX | None = None,
        *,
        elements: CompiledElements | None = None,
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
        elements : CompiledElements, optional
            Elements whose forces are compiled; their rates are the quadratures.
        in_tree : bool
            True to leave coordinates that a tree of joints gives out of what is integrated, if that pays.
        """
        eom, none = numeric.eom, ca.SX(0, 1)
        kind = ca.SX if elements is None else ca.MX
        clock, rate, symbols = Clock(kind), kind.sym("rate"), self._symbols(eom, signals, kind)
        q, v, z, p, levels, channel, *unknown = symbols
        integrands, quadratures = (none if part is None else part for part in (integrands, quadratures))
        x, part = ca.vertcat(q, v, z, kind.sym("integrals", integrands.numel())), None
        tree = self._tree(numeric) if in_tree and elements is None else None
        if tree is not None:
            q, v = tree.q, tree.v
        given = [] if tree is None else self.given_accelerations(numeric, tree)
        u = signals.function(eom)(clock.t, q, v, z, p, levels, channel)
        arguments = clock.t, q, v, z, u, p, rate
        in_terms_of_lam = ca.depends_on(ca.vertcat(eom.z_rate, integrands, quadratures), eom.lam)
        light = None if tree is None or in_terms_of_lam else self.accelerations_in_tree(numeric, tree, arguments)
        if light is not None:
            a, lam, residual = light, ca.SX.zeros(eom.lam.numel()), none
        elif elements is None:
            known = self._with_given(numeric, given, arguments, unknown)
            a, lam, residual = self.accelerations(numeric, arguments, known)
        else:
            a, lam, residual = self._among_elements(numeric, elements, arguments, unknown)
        algebraic = ca.vertcat(*unknown) if self.is_algebraic else kind(0, 1)
        kept = [k for k in range(algebraic.numel()) if k not in given]
        rates = ca.Function("rates", [*eom.symbols], [ca.densify(ca.vertcat(eom.z_rate, integrands)), quadratures])
        z_rate, quad = rates(clock.t, q, v, a, z, lam, u, p)
        if elements is not None:
            quad = elements.rates(elements.values.column(clock.t, q, v, a, z, lam, u, p, z_rate=z_rate))
        ode, p = ca.vertcat(v, a, z_rate), ca.vertcat(p, levels, rate)
        if tree is not None:
            places, states = tree.places_in(x), ca.vertcat(q, v, x[2 * eom.q.numel() :])
            x, ode = x[places], ode[places]
            part = PartOfState(places, kept, ca.Function("whole", [x, p], [states]))
            algebraic, residual = algebraic[kept], residual[kept]
        return Dae(clock, x=x, z=algebraic, p=p, u=channel, ode=ode, alg=residual, quad=quad, part=part)

    def _with_given(
        self, numeric: NumericEquations, given: list[int], arguments: Arguments, unknown: Sequence[ca.SX]
    ) -> Sequence[ca.SX]:
        """``a, lam`` with the accelerations that their own rows of motion give, in terms of the others."""
        if not given:
            return unknown
        a, lam = ca.SX(unknown[0]), unknown[1]
        a[given] = 0
        missing = self.accelerations(numeric, arguments, [a, lam])[2][given]
        a[given] = missing * (-1 / numeric.eom.mass_diagonal[given])
        return a, lam

    def _symbols(self, eom: Equations, signals: Signals, kind: Any) -> list[Any]:
        """``q, v, z, p, levels, channel, a, lam``; zeros for the last two if they are no unknowns."""
        symbols = [eom.q, eom.v, eom.z, eom.p, signals.levels, signals.channel, eom.a, eom.lam]
        if kind is ca.MX:
            symbols = [ca.MX.sym("symbols", part.numel()) for part in symbols]
        return symbols if self.is_algebraic else [*symbols[:6], *(kind.zeros(part.numel()) for part in symbols[6:])]

    def _among_elements(
        self, numeric: NumericEquations, elements: CompiledElements, arguments: Any, unknown: Sequence[ca.MX]
    ) -> tuple[ca.MX, ca.MX, ca.MX]:
        """``(a, lam, residual)`` under the forces of compiled elements and of the others."""
        eom, values = numeric.eom, elements.values
        t, q, v, z, u, p, _ = arguments
        a, lam, z_rate = (ca.MX.zeros(part.numel()) for part in (eom.a, eom.lam, eom.z))
        column = values.column(t, q, v, a, z, lam, u, p, z_rate=z_rate)
        force = elements.rest(t, q, v, z, unknown[1], u, p) + elements.forces(column)
        return self._system(numeric, ca.SX.sym("Q", eom.q.numel()))(*arguments, *unknown, force)

    def _tree(self, numeric: NumericEquations) -> TreeCoordinates | None:
        """Coordinates that are left out of what is integrated; None if there are none, or if they are better kept."""
        tree = tree_coordinates(numeric.eom)
        return tree if tree.dependent and self.takes_tree(numeric, tree) else None
