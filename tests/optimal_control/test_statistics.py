"""Records of how a solution was found: attempts are kept and added up over the solves that follow each other."""

from __future__ import annotations

import json

import numpy as np
import pytest
from motions import guided_block

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.statistics import Attempt, SolveStatistics


def attempt(description: str, iterations: int) -> Attempt:
    return Attempt(description, 1.0, iterations, "Solve_Succeeded", 0.5, 10)


def statistics(iterations: int, *stages: Attempt) -> SolveStatistics:
    return SolveStatistics(iterations, "Solve_Succeeded", 0.5, 0.25, 7, 5, stages=list(stages))


def test_a_solve_that_goes_on_keeps_the_stages_before():
    first, second = statistics(3, attempt("no limits", 3)), statistics(4, attempt("prices", 2))
    both = second.after(first)
    assert (both.iterations, both.seconds, both.build_seconds) == (7, 1.0, 0.5)
    assert [stage.description for stage in both.stages] == ["no limits", "prices"]


def test_how_far_starts_agree():
    """By the costs of those that were solved, of which each says how many there are."""
    costs = [(3.0, 1), (2.0, 2), (2.0, 2), (float("nan"), 0)]
    starts = [Attempt("start", cost, 5, "", 0.1, 10, found=found) for cost, found in costs]
    whole = SolveStatistics(5, "Solve_Succeeded", 0.5, 0.25, 7, 5, starts=starts)
    assert whole.agreement == "4 starts led to 2 optima, the lowest 2 times"
    assert statistics(5).agreement == "one start" and statistics(5, attempt("no limits", 1)).agreement == "one start"
    alone = SolveStatistics(5, "", 0.5, 0.25, 7, 5, starts=[starts[0], starts[3]])
    assert alone.agreement == "2 starts led to 1 optimum, the lowest once"
    none = SolveStatistics(5, "", 0.5, 0.25, 7, 5, starts=[starts[3], starts[3]])
    assert none.agreement == "2 starts led to no motion on their meshes"


def test_starts_of_earlier_files_are_read(tmp_path):
    """They were named by their guess, and had neither time nor mesh; the statistics named the solver."""
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    ends = dict(initial=[block.x == 0, block.vx == 0], final=[block.x == 1, block.vx == 0])
    problem = mbd.OptimalControlProblem(mechanism, duration=1.0, running_cost=u**2, **ends)
    mbd.optimize(problem, intervals=4).save(tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as content:
        entries = dict(content)
    old = json.loads(str(entries["statistics"])) | {"solver": "ipopt"}
    old["starts"] = [{"guess": "kinematic", "cost": 12.0, "iterations": 3, "status": "Solve_Succeeded"}]
    np.savez(tmp_path / "old.npz", **(entries | {"statistics": json.dumps(old)}))
    (start,) = mbd.read_solution(tmp_path / "old.npz", problem).statistics.starts
    assert (start.description, start.guess, start.cost) == ("kinematic", "kinematic", pytest.approx(12.0))
