"""Fatrop, which factors a program stage by stage."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...motion.guess import Iterate
from ...program.collocation_program import Bounds, CollocationProgram
from ...program.elastic_program import ElasticProgram
from ...program.statistics import Attempt
from ...transcription.mesh import interval_count
from .base import QUIET, Beginning, Elsewhere, NLPSolver, Result, SolverWatch
from .ipopt import Ipopt

#: Options of fatrop that were measured best on these programs.
DEFAULTS: dict[str, Any] = {
    "fatrop.print_level": 0,
    "fatrop.tolerance": 1e-8,
    "fatrop.constr_viol_tol": 1e-10,
    "fatrop.max_iter": 200,
    # pivots below this one count as zero: rows of fine meshes are small, and with the default of 1e-5 fatrop took them
    # for dependent and crept
    "fatrop.linsol_lu_fact_tol": 1e-12,
    "fatrop.mu_init": 1e-2,
}
#: Further ones for a guess that is a solution of nearly the same problem; fatrop takes no multipliers.
WARM_START: dict[str, dict[str, Any]] = {
    "cold": {},
    "warm": {"fatrop.mu_init": 1e-4},
    "hot": {"fatrop.mu_init": 1e-6, "fatrop.bound_push": 1e-8, "fatrop.bound_frac": 1e-8},
}
#: Tightest tolerance, below which steps are rounding.
TIGHTEST = 1e-13


class Fatrop(NLPSolver):
    """Fatrop, and IPOPT for what it does not solve.

    Fatrop gives no reason if it fails: IPOPT then solves the program from the same start, or says why it does not.
    Options of the user are for the solver whose name they begin with.
    """

    name = "fatrop"
    defaults = DEFAULTS
    warm_start = WARM_START

    def __init__(self, options: dict[str, Any], progress: bool, elsewhere: Elsewhere | None = None):
        fatrop_options, others = (
            {name: value for name, value in options.items() if not name.startswith(other)}
            for other in ("ipopt.", "fatrop.")
        )
        super().__init__(fatrop_options, progress, elsewhere)
        self._ipopt = Ipopt(others, progress, elsewhere)

    def cost_factor(self, ratio: float) -> float:
        """Factor by which IPOPT raises the cost."""
        return self._ipopt.cost_factor(ratio)

    def with_cost_factor(self, factor: float) -> Fatrop:
        """Return the same solver with a tolerance that is as much tighter, since fatrop does not raise a cost."""
        other = copy(self)
        tolerance = max(self.defaults["fatrop.tolerance"] / factor, TIGHTEST)
        other.options = {"fatrop.tolerance": tolerance} | self.options
        other._ipopt = self._ipopt.with_cost_factor(factor)
        return other

    def run(
        self, begin: Beginning, bounds: Bounds, warmth: str, iterate: Iterate | None = None, limit: int | None = None
    ) -> Result:
        """Solve a program between bounds; see :meth:`NLPSolver.run`."""
        result = super().run(begin, bounds, warmth, iterate, limit)
        if result.succeeded or result.interrupted:
            return result
        ipopt = self._ipopt.run(begin, bounds, warmth, iterate, limit)
        s, cost = result.statistics, float(result.answer["f"][0]) * begin.program.cost_scale
        failed = Attempt(self.name, cost, s.iterations, s.status, s.seconds, interval_count(begin.meshes))
        return replace(ipopt, statistics=replace(ipopt.statistics, stages=[failed, *ipopt.statistics.stages]))

    def least_violation(self, begin: Beginning, elastic: ElasticProgram, limit: int) -> tuple[Result, dict[str, float]]:
        """Minimise the violations of a program by IPOPT: it has no stages."""
        return self._ipopt.least_violation(begin, elastic, limit)

    def make(self, program: CollocationProgram, options: dict[str, Any]) -> ca.Function:
        """Return the solver of a program without callback, which can travel."""
        return program.staged.solver(QUIET | options)

    def make_watched(self, program: CollocationProgram, options: dict[str, Any]) -> tuple[ca.Function, SolverWatch]:
        """Return the solver of a program and the function by which it is watched."""
        watch = WatchedGradient(program)
        return program.staged.solver(QUIET | options, watch), watch

    def _solve(self, begin: Beginning, warmth: str, chosen: dict[str, Any], arguments: dict[str, Any]) -> Result:
        """Solve the program in stages."""
        staged = begin.program.staged
        try:
            result = super()._solve(begin, warmth, chosen, staged.arguments(arguments))
        except RuntimeError as error:  # fatrop reads its options as it begins
            raise ModelError(f"optimize: the solver refuses the options: {error}") from None
        status = "Solve_Succeeded" if result.succeeded else f"fatrop stopped with {result.statistics.status}"
        statistics = replace(result.statistics, status=status, solver=self.name)
        return replace(result, answer=staged.answer(result.answer), statistics=statistics)


class WatchedGradient(SolverWatch, ca.Callback):
    """Gradient of the cost, which fatrop asks for once an iteration, since it has no callback of its own.

    After Ctrl-C it is not a number, at which fatrop stops and returns the last iterate.
    """

    def __init__(self, program: CollocationProgram):
        ca.Callback.__init__(self)
        SolverWatch.__init__(self, program.lower, program.cost_scale)
        self._staged = program.staged
        self.construct(program.staged.gradient.name(), {})

    def get_n_in(self) -> int:
        """Two: variables and data."""
        return 2

    def get_name_in(self, i: int) -> str:
        """Name of a value that fatrop hands over."""
        return str(self._staged.gradient.name_in(i))

    def get_name_out(self, i: int) -> str:
        """Name of the gradient."""
        return str(self._staged.gradient.name_out(i))

    def get_sparsity_in(self, i: int) -> ca.Sparsity:
        """Shape of a value that fatrop hands over."""
        return self._staged.gradient.sparsity_in(i)

    def get_sparsity_out(self, i: int) -> ca.Sparsity:
        """Shape of the gradient."""
        return self._staged.gradient.sparsity_out(i)

    def eval(self, arg: list) -> list:
        """Show the iterate and return the gradient."""
        if self.is_shown:
            cost, rows = self._staged.evaluate(*arg)
            self.show(float(cost), rows.full().ravel())
        return [ca.DM.nan(arg[0].size1(), 1) if self.is_stopped else self._staged.gradient(*arg)]
