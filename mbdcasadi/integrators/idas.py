"""IDAS: backward differentiation formulas for differential-algebraic equations."""

from __future__ import annotations

from typing import Any, ClassVar

from .base import TIGHTEST, Integrator, tightened

#: IDAS is given this much tighter tolerances than asked for: its error accumulates faster than that of one-step
#: methods (measured: the energy of a pendulum over 10 s then stays within 6e-7 of its range of 10 at the default 1e-8).
TIGHTER = 60.0
#: Error that Newton's method may leave in a step, relative to the local tolerance (0.33 in IDAS otherwise): as that is
#: tightened, one evaluation a step is enough, of 1.25; the errors of motions stay the same.
NEWTON_ERROR = 1.0


class IDAS(Integrator):
    """Backward differentiation formulas of order 1 to 5 with variable steps, of SUNDIALS: for any mechanism.

    Takes every form of the equations: bodies without mass, forces that depend
    on reactions, stiff motion. Parameters are those of :class:`Integrator`.

    References
    ----------
    Hindmarsh et al., "SUNDIALS: Suite of nonlinear and differential/algebraic
    equation solvers", ACM Trans. Math. Softw. 31 (2005) 363.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.IDAS(reltol=1e-6, max_step=0.01)
    IDAS(reltol=1e-06, abstol=1e-08, max_step=0.01)
    """

    name: ClassVar[str] = "idas"
    plugin: ClassVar[str] = "idas"
    is_multistep: ClassVar[bool] = True
    variations_in_error_test: ClassVar[bool] = True
    quadratures_in_error_test: ClassVar[bool] = False

    def plugin_options(self, *, algebraic: bool) -> dict[str, Any]:
        settings: dict[str, Any] = {
            "reltol": tightened(self.reltol, TIGHTER, TIGHTEST),
            "abstol": tightened(self.abstol, TIGHTER, TIGHTEST),
            "linear_solver": "csparse",
            "nonlin_conv_coeff": NEWTON_ERROR,
            "disable_internal_warnings": True,
            "show_eval_warnings": False,
            "print_time": False,
        }
        # multipliers left out of the error test at a tighter tolerance: faster at equal error
        settings |= {"suppress_algebraic": True} if algebraic else {}
        return settings | self._compiler_options | dict(self.options)
