"""The KKT form: accelerations and multipliers as algebraic unknowns."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.tree import TreeCoordinates
from ...integrators import Integrator
from .base import Formulation

#: Reactions on a coordinate up to which its acceleration is written in terms of them: more would make the equations of
#: a body that carries many others dense.
FEW = 3


class KKT(Formulation):
    """``M a + Phi_q^T lam - Q = 0``, ``Phi_q a - gamma = 0`` with the unknowns ``(a, lam)``: a DAE of index 1.

    Where a tree of joints without loops leaves coordinates to be advanced, the accelerations of all others are
    ``(Q - Phi_q^T lam) / M``, unless a body carries many others, is light or has no mass.
    """

    name: ClassVar[str] = "KKT"
    is_algebraic: ClassVar[bool] = True

    @classmethod
    def suits(cls, numeric: NumericEquations, integrator: Integrator, *, redundant: bool) -> bool:
        return integrator.solves_algebraic and not redundant

    def takes_tree(self, numeric: NumericEquations, tree: TreeCoordinates) -> bool:
        # positions of bodies in terms of all angles before them would make the sparse equations dense
        eom = numeric.eom
        given = ca.vertcat(eom.q[tree.dependent], eom.v[tree.dependent])
        return not ca.depends_on(ca.vertcat(eom.residual(), eom.z_rate), given)

    def given_accelerations(self, numeric: NumericEquations, tree: TreeCoordinates) -> list[int]:
        # those of the angles stay, and in loops all: without them the iterations of an integrator converge worse, of
        # angles everywhere, and in loops where these become singular
        if numeric.augmentation is not None or numeric.eom.has_loops:
            return []
        reactions = np.diff(numeric.eom.Phi_q.sparsity().colind())
        return [k for k in tree.dependent if reactions[k] <= FEW]

    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        return numeric.eom.a, numeric.eom.lam, numeric.eom.residual(force)
