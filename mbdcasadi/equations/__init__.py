"""Equations of motion of a mechanism as CasADi expressions, and compiled functions of them."""

from .derivation import Equations
from .public import equations

__all__ = ["Equations", "equations"]
