"""The explicit form: multipliers eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import casadi as ca

from ...equations.numeric import NumericEquations
from ...equations.tree import TreeCoordinates
from ...integrators import Integrator
from .base import Arguments, Formulation

#: With a method that takes algebraic unknowns the explicit form pays up to this number of bodies.
EXPLICIT_BODIES = 10


class Explicit(Formulation):
    """``a = M⁻¹ (Q - Phi_q^T lam)`` with ``lam`` eliminated by a sparse symbolic LDL factorisation: an ODE.

    Where each body of a tree of joints moves with few coordinates, the same accelerations by the inertia of the tree.
    """

    name: ClassVar[str] = "explicit"

    @classmethod
    def suits(cls, numeric: NumericEquations, integrator: Integrator, *, redundant: bool) -> bool:
        eom = numeric.eom
        if redundant or eom.Q_depends_on_lam:
            return False
        # without constraints nothing is eliminated, and algebraic unknowns would only make the system larger
        many = len(eom.mechanism.bodies) > EXPLICIT_BODIES and eom.lam.numel() > 0
        return not integrator.solves_algebraic or not (numeric.massless or many)

    def takes_tree(self, numeric: NumericEquations, tree: TreeCoordinates) -> bool:
        return True

    def accelerations_in_tree(
        self, numeric: NumericEquations, tree: TreeCoordinates, arguments: Arguments
    ) -> ca.SX | None:
        if numeric.augmentation is not None or not tree.is_light:
            return None
        t, _, _, z, u, p, _ = arguments
        return tree.accelerations(t, z, u, p)

    def accelerations(
        self, numeric: NumericEquations, arguments: Arguments, unknown: Sequence[ca.SX]
    ) -> tuple[ca.SX, ca.SX, ca.SX]:
        # the function is there for the outputs
        a, lam = numeric.forward_dynamics(redundant=False)(*arguments[:-1])
        return a, lam, ca.SX(0, 1)

    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        return *numeric.saddle().solve(force, numeric.eom.gamma), ca.SX(0, 1)
