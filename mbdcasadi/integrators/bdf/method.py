"""BDF: backward differentiation formulas for many contacts, in C."""

from __future__ import annotations

from typing import ClassVar

from ..base import Integrator
from ..compiled import Forms
from .pieces import ImplicitIntegrator


class BDF(Integrator):
    """Backward differentiation formulas of order 1 to 5 in C, for bodies that no joint holds.

    The fastest method for many contacts: Newton's matrix is that of the velocities, and its factorisation passes
    over the zeros of what is apart, so that contacts that are open cost little. IDAS, to the same accuracy, would
    factorise a matrix of all pairs that may ever touch.

    It takes bodies with mass that no joint, driver or exact stiction holds, under any forces that do not depend on
    reactions, with inputs and first-order states; it needs a C compiler. It serves :func:`simulate` alone. For anything
    else use :class:`IDAS`. ``method="auto"`` takes it for many contacts.

    Parameters
    ----------
    reltol, abstol : float, default 1e-8
        Relative and absolute tolerance of the local error.
    max_step : float, optional
        Longest step, s.
    jit : bool, default False
        Compile the equations before the run, and not only once that pays.

    Raises
    ------
    SimulationError
        For tolerances and steps that are not positive, for options, and without a compiler for ``jit=True``.

    References
    ----------
    Shampine and Reichelt, "The MATLAB ODE suite", SIAM J. Sci. Comput. 18 (1997) 1.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.BDF(reltol=1e-6, abstol=1e-6)
    BDF(reltol=1e-06, abstol=1e-06)
    """

    name: ClassVar[str] = "bdf"
    solves_algebraic: ClassVar[bool] = False

    def over_pieces(self, forms: Forms) -> ImplicitIntegrator:
        return ImplicitIntegrator(forms.explicit(), self, forms.equations.mechanism.cache)
