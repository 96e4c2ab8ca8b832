"""IPOPT: its options, and its callback for progress and Ctrl-C."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ....numerics.console import quiet
from ...program.collocation_program import CollocationProgram
from ...program.elastic_program import ElasticProgram
from ...program.limit_sides import Slacks
from .base import QUIET, Beginning, NLPSolver, Result, SolverWatch

#: Residual of the conditions of an optimum, scaled, at which IPOPT ends.
TOLERANCE = 1e-8
#: Options of IPOPT that were measured best on these programs.
DEFAULTS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": TOLERANCE,
    "ipopt.constr_viol_tol": 1e-11,
    "ipopt.acceptable_tol": 1e-7,
    "ipopt.acceptable_constr_viol_tol": 1e-9,
    "ipopt.acceptable_dual_inf_tol": 1e-5,
    "ipopt.max_iter": 1000,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_pivot_order": 0,
    # workspace beyond the estimate, in per cent, which MUMPS is given anew if it is too small: with the default of 1000
    # a twentieth to a seventh of the time of a solve was spent on memory
    "ipopt.mumps_mem_percent": 20,
    "ipopt.mu_strategy": "adaptive",
    # progress by the residual of the optimality conditions, and no barrier above the scale of the program: of the
    # programs of the examples some needed half the iterations, and none failed by rounding of its data any more
    "ipopt.adaptive_mu_globalization": "kkt-error",
    "ipopt.mu_max": 1.0,
    "ipopt.honor_original_bounds": "yes",
    # the multipliers of the data are not used: CasADi would derive a gradient for them
    "calc_lam_p": False,
    "no_nlp_grad": True,
}
#: Further ones for several phases: no step without centring, since the first one of a gait led next to its limits,
#: where later ones were short; and limits as sharp at the end as without it.
SEVERAL_PHASES = {"ipopt.sigma_min": 1e-2, "ipopt.compl_inf_tol": 1e-10}
#: Further ones for a guess that is a solution of nearly the same problem, on another mesh or on the same one.
WARM_START: dict[str, dict[str, Any]] = {
    "cold": {},
    "warm": {"ipopt.mu_init": 1e-4, "ipopt.max_iter": 300},
    "hot": {
        "ipopt.mu_init": 1e-6,
        "ipopt.max_iter": 60,
        "ipopt.warm_start_init_point": "yes",
        "ipopt.warm_start_bound_push": 1e-8,
        "ipopt.warm_start_mult_bound_push": 1e-8,
        "ipopt.warm_start_slack_bound_push": 1e-8,
    },
}
#: Tightest tolerance of IPOPT, below which steps are rounding, and the range of the products of multiplier and slack at
#: which limits count as met.
SHARPEST, SLACKS = 1e-10, (1e-13, 1e-10)

#: Ratio from which on a cost is far smaller than its typical size, and the largest power of ten by which it is raised.
FAR_SMALLER, MOST_RAISED = 100.0, 6


def sharp_options(tolerance: float) -> dict[str, float]:
    """Return options by which inputs and limits are found to a tolerance, as a share of their sizes.

    A small residual of the conditions of an optimum, each of the weight of a stage in the cost, is a far larger error
    of the inputs. An input that holds a position at its limit is off by the second derivative of the slack.
    """
    slack = float(np.clip(1e-6 * tolerance, *SLACKS))
    return {
        "ipopt.tol": float(np.clip(1e-3 * tolerance, SHARPEST, TOLERANCE)),
        "ipopt.compl_inf_tol": slack,
        "ipopt.mu_min": slack / 10,
        "ipopt.bound_relax_factor": slack,
    }


class Ipopt(NLPSolver):
    """IPOPT, the interior-point method of Wächter and Biegler (doi 10.1007/s10107-004-0559-y)."""

    name = "ipopt"
    defaults = DEFAULTS
    warm_start = WARM_START

    def cost_factor(self, ratio: float) -> float:
        """Power of ten by which the cost is raised; one that the user chose prevails."""
        chosen = self.options.get("ipopt.obj_scaling_factor")
        if chosen is not None or ratio < FAR_SMALLER:
            return 1.0 if chosen is None else float(chosen)
        return float(10.0 ** np.clip(np.round(np.log10(ratio)), 0, MOST_RAISED))

    def with_cost_factor(self, factor: float) -> Ipopt:
        """Return the same solver, whose residual is that of a raised cost; multipliers stay as they are."""
        return Ipopt(self.options | {"ipopt.obj_scaling_factor": factor}, self.progress, self.elsewhere)

    def make(self, program: CollocationProgram, options: dict[str, Any]) -> ca.Function:
        """Return the solver of a program without callback, which can travel."""
        return program.nlp.solver(QUIET | (SEVERAL_PHASES if program.changes else {}) | options)

    def make_watched(self, program: CollocationProgram, options: dict[str, Any]) -> tuple[ca.Function, SolverWatch]:
        """Return the solver of a program and its callback; options of the user prevail."""
        callback = SolverCallback(program.size, program.lower, program.cost_scale, program.nlp.data_size)
        return self.make(program, {"iteration_callback": callback} | options), callback

    def least_violation(self, begin: Beginning, elastic: ElasticProgram, limit: int) -> tuple[Result, Slacks]:
        """Minimise the violations of a program near a start; see :meth:`NLPSolver.least_violation`."""
        program = begin.program
        arguments = elastic.arguments(begin.x, begin.data, program.rows_at(begin.x, begin.data))
        callback = SolverCallback(elastic.size, arguments["lbg"], 1.0, arguments["p"].size)
        with quiet():
            run_options = {"iteration_callback": callback, "ipopt.max_iter": limit}
            solver = elastic.solver(QUIET | self.defaults | run_options | self.options)
        result = self._call(begin, solver, callback, arguments)
        x, slacks = elastic.split(result.answer["x"])
        x = np.clip(x, *elastic.limits)
        cost, rows = (value.full().ravel() for value in program.nlp.evaluate(x, begin.data))
        answer = {"lam_x": np.zeros(x.size), "lam_g": np.zeros(rows.size), "x": x, "g": rows, "f": cost}
        return Result(answer, result.statistics, result.succeeded, result.interrupted), slacks


class SolverCallback(SolverWatch, ca.Callback):
    """Function that IPOPT calls after every iteration, with so many variables, rows and data.

    It shows iteration, cost and violation if asked to, and stops the solver after Ctrl-C or if the cost falls without
    bound, so that the last iterate is not lost.
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

    def has_eval_buffer(self) -> bool:
        """True: the values are read where they are, since copies of all of them took a tenth of a small solve."""
        return True

    def eval_buffer(self, arg: tuple[memoryview, ...], res: tuple[memoryview, ...]) -> int:
        """Show the iterate; 1 asks the solver to stop."""
        cost = float(np.frombuffer(arg[1])[0])
        if self.is_shown:
            self.show(cost, np.frombuffer(arg[2]))
        np.frombuffer(res[0])[0] = self.is_stopped or self.note_cost(cost)
        return 0
