"""Callback of the solver: progress, and Ctrl-C."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from ...numerics.console import Interruption
from ...numerics.progress import progress_bar
from .rows import violations


class SolverWatch:
    """Progress of one solve at a time, and the wish of the user to stop it.

    Parameters
    ----------
    lower : numpy.ndarray
        Lower bounds of the rows.
    cost_scale : float
        Size by which the cost was divided.
    """

    def __init__(self, lower: np.ndarray, cost_scale: float):
        self._lower, self._cost_scale = lower, cost_scale
        self._bar: Any = None
        self.interruption: Interruption | None = None

    @contextmanager
    def watching(self, interruption: Interruption, show: bool) -> Iterator[None]:
        """Watch one solve; a bar writes to the standard error of now, which the solve redirects."""
        self.interruption = interruption
        form = "{desc}: {n} iterations{postfix}"
        with progress_bar(None, "optimize", " iterations", show=show, bar_format=form, file=sys.stderr) as bar:
            self._bar = bar if show else None
            try:
                yield
            finally:
                self._bar = None

    @property
    def is_shown(self) -> bool:
        """True if progress is shown."""
        return self._bar is not None

    @property
    def is_stopped(self) -> bool:
        """True after Ctrl-C."""
        return self.interruption is not None and self.interruption.requested

    def show(self, cost: ca.DM, rows: ca.DM) -> None:
        """Show scaled cost and rows of the next iterate."""
        worst = float(np.max(violations(rows.full().ravel(), self._lower), initial=0.0))
        cost_text = f"cost {float(cost) * self._cost_scale:.6g}"
        self._bar.set_postfix_str(f"{cost_text}, largest scaled violation {worst:.1e}", refresh=False)
        self._bar.update(1)


class SolverCallback(SolverWatch, ca.Callback):
    """Function that IPOPT calls after every iteration.

    It shows iteration, cost and violation if asked to, and stops the
    solver after Ctrl-C, so that the last iterate is not lost.

    Parameters
    ----------
    size : int
        Number of variables of the program.
    lower : numpy.ndarray
        Lower bounds of the rows.
    cost_scale : float
        Size by which the cost was divided.
    data_size : int
        Number of parameters of the program.
    """

    def __init__(self, size: int, lower: np.ndarray, cost_scale: float, data_size: int):
        ca.Callback.__init__(self)
        SolverWatch.__init__(self, lower, cost_scale)
        rows = lower.size
        self._sizes = {"x": size, "f": 1, "g": rows, "lam_x": size, "lam_g": rows, "lam_p": data_size}
        self.construct("callback", {})

    # --- what CasADi calls --------------------------------------------------------------------
    def get_n_in(self) -> int:
        """Number of values that the solver hands over."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """One: a number that is 1 to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """Name of a value."""
        return str(ca.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shape of a value."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arg: list) -> list:
        """Show the iterate; 1 asks the solver to stop."""
        if self.is_shown:
            self.show(arg[1], arg[2])
        return [int(self.is_stopped)]
