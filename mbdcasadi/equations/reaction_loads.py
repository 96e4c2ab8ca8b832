"""Forces that depend on reactions, such as friction by the load of a joint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

if TYPE_CHECKING:
    from .derivation import Equations


def loaded_by_reactions(eom: Equations) -> list[str]:
    """Return the descriptions of the elements whose forces depend on reactions."""
    return [
        element.description
        for element in eom.mechanism.elements
        if any(ca.depends_on(ca.vec(ca.SX(force)), eom.lam) for _, force in element.virtual_work)
    ]


def why_not_unique(eom: Equations) -> str:
    """Return a sentence on forces that depend on reactions in a mechanism with redundant rows."""
    return (
        f"the force of {', '.join(loaded_by_reactions(eom)[:3])} depends on reactions, and with redundant constraints "
        "these are not unique: remove the redundant rows (see check), or take LoadIndependentFriction"
    )
