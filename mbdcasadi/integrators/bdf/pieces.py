"""Differentiation formulas in C over pieces of an output grid."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import ClassVar

from ..base import tightened
from ..native.pieces import NativeIntegrator
from ..native.runner import Runner

#: Tolerances are divided by this: the error accumulates, as that of IDAS does; and the tightest one.
TIGHTER, TIGHTEST = 100.0, 1e-13


class ImplicitRunner(Runner):
    """Runs one system by differentiation formulas."""

    method: ClassVar[str] = "bdf"
    instead: ClassVar[str] = 'method="idas"'

    @staticmethod
    @cache
    def _steps() -> str:
        return (Path(__file__).parent / "steps.c").read_text(encoding="utf-8")


class ImplicitIntegrator(NativeIntegrator):
    """An integrator of a system with its slopes by differentiation formulas.

    Raises
    ------
    SimulationError
        Without a C compiler.
    """

    runner = ImplicitRunner

    @property
    def tolerances(self) -> tuple[float, float]:
        reltol, abstol = (tightened(tolerance, TIGHTER, TIGHTEST) for tolerance in self.integrator.tolerances)
        return reltol, abstol
