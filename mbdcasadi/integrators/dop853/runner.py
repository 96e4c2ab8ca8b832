"""The engine of DOP853."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import ClassVar

from ...numerics.roots import TOUCHES
from ..native.run import defined
from ..native.runner import Runner
from . import constants
from .coefficients import coefficients_in_c


@cache
def steps_in_c() -> str:
    """C code of the method, for :func:`engine_source`."""
    source = (Path(__file__).parent / "steps.c").read_text(encoding="utf-8")
    names = [name for name in vars(constants) if name.isupper()]
    return f"{defined(constants, names)}#define TOUCHES {TOUCHES!r}\n\n{coefficients_in_c()}\n{source}"


class ExplicitRunner(Runner):
    """Runs one system by DOP853."""

    method: ClassVar[str] = "dop853"
    instead: ClassVar[str] = 'method="erk" or "idas"'

    @staticmethod
    def _steps() -> str:
        return steps_in_c()
