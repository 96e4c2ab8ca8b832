"""Forms of the equations of motion that an integrator can take, and the choice among them.

===============  ==========================================================  =====================================
name             when                                                        the integrator gets
===============  ==========================================================  =====================================
explicit         every body has mass, no force depends on lam, and few       an ODE, lam eliminated
                 bodies or no joints
KKT              massless bodies, forces that depend on lam, many bodies     a DAE in ``(a, lam)``
                 with joints
regularised      redundant rows, rank lost on the way                        an ODE, ``S + epsilon I``, drift damped
===============  ==========================================================  =====================================
"""

from __future__ import annotations

from ...equations.numeric import NumericEquations
from ...errors import SimulationError, SingularityError
from ...integrators import Integrator
from .base import Formulation
from .explicit import Explicit
from .kkt import KKT
from .regularised import Regularised

__all__ = ["FORMULATIONS", "KKT", "Explicit", "Formulation", "Regularised", "choose_formulation"]

#: Every form, of which the first that suits is taken; a further one is a class in a file of its own.
FORMULATIONS: tuple[type[Formulation], ...] = (Explicit, KKT, Regularised)


def choose_formulation(numeric: NumericEquations, integrator: Integrator, *, redundant: bool) -> Formulation:
    """Choose the form for an integrator.

    Parameters
    ----------
    redundant : bool
        True if rows are dependent.

    Raises
    ------
    SimulationError
        If no form suits the integrator.
    SingularityError
        If forces depend on reactions that are not unique.
    """
    eom = numeric.eom
    if eom.Q_depends_on_lam:
        if not integrator.solves_algebraic:
            raise SimulationError(
                f'method="{integrator.name}" needs forces that do not depend on reactions, and '
                f'{", ".join(eom.loaded_by_reactions)} does; use method="idas"'
            )
        if redundant and not eom.Q_is_linear_in_lam:
            raise SingularityError(eom.why_not_unique)
    return next(form() for form in FORMULATIONS if form.suits(numeric, integrator, redundant=redundant))
