"""DOP853: explicit Runge–Kutta of order 8, compiled."""

from __future__ import annotations

from typing import ClassVar

from ..base import Integrator
from ..native.runner import Runner
from .runner import ExplicitRunner


class DOP853(Integrator):
    """Explicit Runge–Kutta of order 8(5,3) with dense output of order 7, the whole run in C.

    The fastest method for motion that is smooth and not stiff: 6 to 27 times as fast as
    IDAS at equal error on the models of the benchmarks. Every step is projected onto the constraints, at position
    and velocity level; events are looked at inside every step, and steps end where contacts open and close and where
    comparisons in the state switch.

    The equations are interpreted in C at first, and compiled by the compiler of the
    system once that pays; what was compiled is kept for later (in the folder
    ``$MBDCASADI_CACHE``, or that of the user's platform). ``motion.statistics.notes``
    names the code that ran. Without a C compiler the method is refused, and ``method="auto"`` takes another one.

    Sweeps run it in threads. In derivatives, which it finds forward, the variations of the motion are states like
    others, in the error test and in the projection: gradients are nearer to those of the motion than with other methods
    at the same tolerance.

    It needs a C compiler (gcc, clang, cc, or what ``$CC`` names), rows that do not depend on each other, and forces
    that do not depend on reactions. Stiff motion, as with stiff bushings or lasting hard contacts, ends in an
    error or takes long: use :class:`IDAS` or :class:`Rosenbrock`.

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
        For tolerances and steps that are not positive, for options, and without a compiler for ``jit=True``; by the
        analysis without a compiler, and for equations and outputs that are not written as C.

    References
    ----------
    Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., Springer 1993, section II.5.
    Gustafsson, "Control-theoretic techniques for stepsize selection in implicit Runge-Kutta methods", ACM Trans. Math.
    Softw. 20 (1994) 496.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.DOP853(reltol=1e-10, abstol=1e-10)
    DOP853(reltol=1e-10, abstol=1e-10)
    """

    name: ClassVar[str] = "dop853"
    solves_algebraic: ClassVar[bool] = False
    variations_in_error_test: ClassVar[bool] = True
    whole_run: ClassVar[type[Runner] | None] = ExplicitRunner
