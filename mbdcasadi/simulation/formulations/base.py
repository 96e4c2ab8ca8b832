"""The base class of forms of the equations."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from ...arguments.inputs import Signals
from ...equations.numeric import NumericEquations
from ...integrators.compiled import Clock, Dae

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

    @abstractmethod
    def accelerations(self, numeric: NumericEquations, arguments: Arguments) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Return ``(a, lam, residual)``: expressions, or unknowns with their residual."""

    def dae(
        self,
        numeric: NumericEquations,
        signals: Signals,
        integrands: ca.SX | None = None,
        quadratures: ca.SX | None = None,
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
        """
        eom, clock, none = numeric.eom, Clock(), ca.SX(0, 1)
        u = ca.substitute(signals.parametrised, eom.t, clock.t)
        rate = ca.SX.sym("rate")
        integrands = none if integrands is None else integrands
        a, lam, residual = self.accelerations(numeric, (clock.t, eom.q, eom.v, eom.z, u, eom.p, rate))
        rates = ca.Function(
            "rates", [*eom.symbols], [ca.vertcat(eom.z_rate, integrands), none if quadratures is None else quadratures]
        )
        z_rate, quad = rates(clock.t, eom.q, eom.v, a, eom.z, lam, u, eom.p)
        return Dae(
            clock,
            x=ca.vertcat(eom.q, eom.v, eom.z, ca.SX.sym("integrals", integrands.numel())),
            z=ca.vertcat(a, lam) if self.is_algebraic else none,
            p=ca.vertcat(eom.p, signals.levels, rate),
            u=signals.channel,
            ode=ca.vertcat(eom.v, a, z_rate),
            alg=residual,
            quad=quad,
        )
