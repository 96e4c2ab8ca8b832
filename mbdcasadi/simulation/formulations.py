"""Forms of the equations of motion that an integrator can take, and the choice among them.

===============  ==========================================================  =====================================
name             when                                                        integrator gets
===============  ==========================================================  =====================================
explicit         every body has mass, no force depends on lam, few bodies    an ODE, lam eliminated
KKT              massless bodies, forces that depend on lam, many bodies     a DAE in ``(a, lam)``
regularised      redundant rows, rank lost on the way                        an ODE, ``S + epsilon I``, drift damped
===============  ==========================================================  =====================================
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..integrators.integration import Dae

#: With IDAS the explicit form pays up to this number of bodies.
EXPLICIT_BODIES = 10

METHODS = ("idas", "erk", "rosenbrock", "auto")


@dataclass(frozen=True)
class Formulation:
    """A form of the equations.

    Attributes
    ----------
    name : {"explicit", "KKT", "regularised"}
        Which form.
    """

    name: str

    @property
    def redundant(self) -> bool:
        """Whether solves have to stand dependent rows."""
        return self.name == "regularised"

    @property
    def algebraic(self) -> bool:
        """Whether accelerations and multipliers are unknowns of the integrator."""
        return self.name == "KKT"

    def dae(
        self, numeric: NumericEquations, signals: Signals, integrands: ca.SX | None = None, watched: ca.SX | None = None
    ) -> Dae:
        """The system in time counted from the start of a chunk, ``x = (q, v, z)`` and integrals of expressions.

        What is watched is integrated along too, outside the state and its error test.
        """
        eom = numeric.eom
        since, start = ca.SX.sym("since"), ca.SX.sym("start")
        u = ca.substitute(signals.expressions, eom.t, start + since)
        integrands = ca.SX(0, 1) if integrands is None else integrands
        x = ca.vertcat(eom.q, eom.v, eom.z, ca.SX.sym("integrals", integrands.numel()))
        inner = [start + since, eom.q, eom.v, eom.z, u, eom.p]
        rate = ca.SX.sym("rate")
        parameters = ca.vertcat(start, eom.p, rate)
        if not self.algebraic:
            if self.name == "regularised":
                a, lam = numeric.stabilised_dynamics()(*inner, rate)
            else:
                a, lam = numeric.forward_dynamics(redundant=False)(*inner)
            unknowns = residual = ca.SX(0, 1)
        else:
            a, lam = eom.a, eom.lam
            unknowns, residual = ca.vertcat(a, lam), self._residual(eom)(*inner, a, lam)
        watched = ca.SX(0, 1) if watched is None else watched
        rates = ca.Function("z_rate", [*eom.symbols], [ca.vertcat(eom.z_rate, integrands), watched])
        z_rate, quad = rates(inner[0], eom.q, eom.v, a, eom.z, lam, u, eom.p)
        ode = ca.vertcat(eom.v, a, z_rate)
        return Dae(since, x, unknowns, parameters, signals.channel, ode, residual, quad)

    @staticmethod
    def _residual(eom) -> ca.Function:
        motion = eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q
        rows = ca.vertcat(motion, eom.Phi_q @ eom.a - eom.gamma)
        return ca.Function("residual", [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p, eom.a, eom.lam], [rows])


def choose(numeric: NumericEquations, method: str, *, redundant: bool) -> Formulation:
    """Choose the form for an integrator.

    Raises
    ------
    SimulationError
        Where the integrator has no form that fits.
    """
    eom = numeric.eom
    if eom.Q_depends_on_lam:
        if method == "erk":
            raise SimulationError(
                'method="erk" needs forces that do not depend on reactions, and friction here does; use method="idas"'
            )
        if redundant:
            raise SimulationError(
                "a force depends on reactions, and with redundant constraints these are not unique: "
                "remove the redundant rows (see check) or the friction"
            )
        return Formulation("KKT")
    if redundant:
        return Formulation("regularised")
    if method == "erk":
        return Formulation("explicit")
    many = len(eom.mechanism.bodies) > EXPLICIT_BODIES
    return Formulation("KKT" if numeric.massless or many else "explicit")
