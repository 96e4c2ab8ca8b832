"""Integration by a multistep method whose derivatives backwards in time are as accurate as the motion.

The derivative of a motion by a parameter is, backwards in time, an integral
along the adjoint ``mu``,

    dJ/dp = ∫ mu^T f_p dt,

and IDAS chooses its order by the error of the states alone: where the adjoint
is constant it stays at order 1, and the integral converges by tiny steps or to
an error far above the tolerance. A parameter that is a state of its own,
``p' = 0``, has its derivative among the adjoint states, whose error is controlled.

References
----------
Cao, Li, Petzold, Serban, "Adjoint sensitivity analysis for differential-algebraic equations", SIAM J. Sci. Comput.
24 (2003) 1076.
"""

from __future__ import annotations

from collections.abc import Collection

import casadi as ca
import numpy as np

from .base import Integrator
from .compiled import Clock, CompiledIntegrator, Dae

#: Steps that are kept for the adjoint. From more than that, stretches are integrated again on the way back.
KEPT_STEPS = 100
#: Steps between two outputs, there and back: an adjoint that needs more grows without bound.
STEPS = 20_000


class ReversibleIntegrator:
    """An integrator of one system over pieces without stops inside, to be differentiated backwards.

    IDAS goes over its checkpoints once more on the way back, and knows the last
    stop only: with a stop inside a piece the repetition would be another motion,
    whose steps do not fit into the memory that the first one allocated.

    Parameters
    ----------
    dae : Dae
        The system, without integrals of its own.
    integrator : Integrator
        Method and tolerances.
    carried : collection of int
        Positions among ``dae.p`` of what is differentiated by; start and length of the piece and ``dae.u`` always are.
    """

    def __init__(self, dae: Dae, integrator: Integrator, carried: Collection[int]):
        self._size = dae.x.numel()
        self._carried = [0, 1, *[2 + k for k in sorted(carried)]]
        self._others = np.setdiff1d(np.arange(2 + dae.p.numel()), self._carried).tolist()
        self._u, self._p = dae.u.numel(), 2 + dae.p.numel()
        system = self._with_states(dae)
        # states that do not change have no error: the norm over all of them must not hide that of the others
        share = float(np.sqrt(self._size / max(system.x.numel(), 1)))
        integrator = integrator.replace(
            reltol=share * integrator.reltol,
            abstol=share * integrator.abstol,
            options={"steps_per_checkpoint": KEPT_STEPS} | dict(integrator.options),
        )
        self._compiled = CompiledIntegrator(system, integrator)

    def _with_states(self, dae: Dae) -> Dae:
        """The system in which all that is carried is a state, over a piece of length 1."""
        kind, own = type(dae.x), dae.clock
        rates = ca.Function(
            "rates",
            [own.tau, dae.x, dae.z, ca.vertcat(own.start, own.length, dae.p), dae.u],
            [own.length * dae.ode, dae.alg],
        )
        clock, x, z = Clock(kind), kind.sym("x", self._size), kind.sym("z", dae.z.numel())
        carried, others = kind.sym("carried", len(self._carried)), kind.sym("others", len(self._others))
        u = kind.sym("u", self._u)
        order = np.argsort(np.r_[self._carried, self._others]).tolist()
        ode, alg = rates(clock.tau, x, z, ca.vertcat(carried, others)[order], u)
        still = kind.zeros(carried.numel() + self._u)
        none = kind(0, 1)
        return Dae(clock, ca.vertcat(x, carried, u), z, others, none, ca.vertcat(ode, still), alg)

    def function(self, fractions: np.ndarray, *, least_steps: int = 0) -> ca.Function:
        """Return the compiled integrator ``(x0, z0, p, u) -> xf``, as :meth:`CompiledIntegrator.function` has it.

        Parameters
        ----------
        fractions : numpy.ndarray
            Outputs as fractions of the piece, the last one 1.
        least_steps : int
            The step is at most the length of the piece divided by this; 0 for no limit.
        """
        inner = self._compiled.function(fractions, steps=STEPS, least_steps=least_steps)
        x0, z0 = ca.MX.sym("x0", self._size + 1), ca.MX.sym("z0", inner.size1_in("z0"))
        p, u = ca.MX.sym("p", self._p), ca.MX.sym("u", self._u)
        states = inner(x0=ca.vertcat(x0[:-1], p[self._carried], u, x0[-1]), z0=z0, p=ca.vertcat(0, 1, p[self._others]))[
            "xf"
        ]
        xf = ca.vertcat(states[: self._size, :], states[-1, :])
        return ca.Function("reversible", [x0, z0, p, u], [xf], ["x0", "z0", "p", "u"], ["xf"])
