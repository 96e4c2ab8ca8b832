"""The equations of motion as users have them: with forward dynamics, code in C and print."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..numerics.lazy import cached_property
from . import derivation


def equations(mechanism: Mechanism) -> Equations:
    """Derive the equations of motion; the same mechanism gives the same object again.

    Parameters
    ----------
    mechanism : Mechanism
        The model.

    Returns
    -------
    Equations
        ``M a + Phi_q^T lam = Q``, ``Phi = 0``, ``Phi_q v = nu``, ``Phi_q a = gamma``.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1)
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> mbd.equations(mbd.Mechanism(bodies=[arm], joints=[hinge])).row_names
    ('hinge.x', 'hinge.y')
    """
    if not isinstance(mechanism, Mechanism):
        raise ModelError(f"expected a Mechanism, got {mechanism!r}")
    return mechanism.cache.get_or_create("equations", lambda: Equations(mechanism))


class Equations(derivation.Equations):
    """Constrained equations of motion in the textbook's names.

    Attributes
    ----------
    mechanism : Mechanism
        Mechanism from which they were derived.
    t, q, v, a, z, lam, u, p : casadi.SX
        Time; coordinates ``[x, y, phi]`` by body and then those without inertia
        (n,); their rates; first-order states (k,); multipliers (m,); inputs; parameters.
    M : casadi.SX
        Mass matrix (n, n), diagonal.
    Q : casadi.SX
        Generalised applied forces (n,).
    Phi : casadi.SX
        Position constraints, in the order of :attr:`position_rows`.
    Phi_q : casadi.SX
        Constraint Jacobian (m, n); for a velocity-level row its derivative by `v`.
    nu : casadi.SX
        Right side of the velocity equation (m,), ``Phi_q v = nu = -Phi_t``. Here and in `gamma` the partial derivative
        by time follows first-order states, ``Phi_t + Phi_z z_rate``, if drivers prescribe these.
    gamma : casadi.SX
        Right side of the acceleration equation (m,),
        ``gamma = -(Phi_q v)_q v - 2 Phi_qt v - Phi_tt``.
    velocity_rows : casadi.SX
        Velocity-level rows ``J v + c``, linear in `v`, held at zero; in their order among the rows.
    z_rate : casadi.SX
        Rates of the first-order states (k,).
    coordinate_names, row_names : tuple of str
        Names of the entries of `q` and of the rows (joints in order, then drivers).
    position_rows : numpy.ndarray of int
        Indices of the rows that are position constraints; all of them, unless there are velocity-level rows.

    References
    ----------
    Haug 1989, chapters 3 (constraints) and 6 (dynamics).
    """

    @cached_property
    def forward_dynamics(self) -> ca.Function:
        """``(t, q, v, z, u, p) -> (a, lam)``: accelerations and multipliers, exportable to C.

        For constraints with redundant rows use the analyses, which find the
        multipliers of least norm.
        """
        from .numeric import NumericEquations

        return NumericEquations(self, self.parameter_values).forward_dynamics(redundant=False)

    def effective_masses(self, p: np.ndarray) -> np.ndarray | None:
        """Effective masses of the rows (m,); None if no body is light. See :mod:`.augmentation`."""
        from .numeric import NumericEquations

        return NumericEquations(self, p).augmentation

    def generate_c(self, path: str | Path) -> tuple[Path, Path]:
        """Write the equations as C: one file and its header, which need a C compiler and nothing else.

        With ``engine.c`` the functions are ``engine_mass_matrix (p -> M)``,
        ``engine_constraints (t, q, p -> Phi, Phi_q, nu)`` (``t, q, z, p`` if drivers follow states), ``engine_residual
        (t, q, v, a, z, lam, u, p -> r)`` with ``r = [M a + Phi_q^T lam - Q; Phi;
        Phi_q v - nu; Phi_q a - gamma]``, ``engine_jacobians`` (of r by q, v, a, z,
        lam), ``engine_state_rates``, ``engine_forward_dynamics (t, q, v, z, u, p ->
        a, lam)`` and ``engine_right_side`` (the same arguments, ``-> [v; a; z_rate]``).
        Each is called as ``f(const double** arg, double** res, long long int* iw,
        double* w, int mem)``; ``f_work`` returns the lengths of the four; matrices are
        stored by columns.

        Parameters
        ----------
        path : str or Path
            A file that ends in ``.c``, named as a C identifier: its name goes before every function.

        Returns
        -------
        (Path, Path)
            The file and its header.

        Raises
        ------
        ModelError
            For a name that C does not take.

        Examples
        --------
        >>> mbd.equations(engine).generate_c("engine.c")  # doctest: +SKIP
        """
        from .code import generate_c

        return generate_c(self, path)

    def __str__(self) -> str:
        from .display import equations_as_text

        return equations_as_text(self)

    def _repr_latex_(self) -> str:
        from .display import equations_as_latex

        return equations_as_latex(self)
