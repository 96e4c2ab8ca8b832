"""Several starts at a time, in threads and in processes."""

import math
import multiprocessing
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor

import pytest
from motions import pendulum, rest_to_rest

import mbdcasadi as mbd


def swing_up():
    """A pendulum with a weak motor, of which there are several swing-ups."""
    bob, tau, mechanism = pendulum(limit=8.0)
    return mbd.OptimalControlProblem(
        mechanism,
        2.0,
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == math.pi, bob.omega == 0],
        running_cost=tau**2,
    )


def summary(solution):
    return [(s.description, s.status, s.iterations) for s in solution.statistics.starts]


@pytest.mark.parametrize("make", [ThreadPoolExecutor, pytest.param(ProcessPoolExecutor, marks=pytest.mark.slow)])
def test_an_executor_finds_what_one_start_after_the_other_does(make):
    """The same starts with the same labels, costs and iterations, and the best of them."""
    problem = swing_up()
    one_by_one = mbd.optimize(problem, intervals=16, starts=4)
    context = {"mp_context": multiprocessing.get_context("spawn")} if make is ProcessPoolExecutor else {}
    with make(2, **context) as executor:
        found = mbd.optimize(problem, intervals=16, starts=4, executor=executor)
    assert summary(found) == summary(one_by_one) and len(summary(found)) == 4
    costs = [s.cost for s in found.statistics.starts]
    assert costs == pytest.approx([s.cost for s in one_by_one.statistics.starts], rel=1e-9, nan_ok=True)
    assert found.cost == pytest.approx(one_by_one.cost, rel=1e-9) == min(c for c in costs if c == c)
    assert found.active_limits and found.verify().final_error < 0.1


def test_starts_that_all_fail():
    """The failure is that of the last one."""
    problem, *_ = rest_to_rest(3.0, 2.0, lower=-1, upper=1)
    with ThreadPoolExecutor(2) as executor, pytest.raises(mbd.OptimizationError, match="infeasible"):
        mbd.optimize(problem, intervals=6, starts=2, executor=executor)


def test_ctrl_c_ends_what_runs_elsewhere():
    """The search is given up, whatever the worker does; one that is lost is reported."""

    class Stuck(ThreadPoolExecutor):
        def submit(self, *arguments):
            if self.runs:
                future = Future()
                future.set_exception(KeyboardInterrupt())
                return future
            self.runs.append(Future())
            return self.runs[0]

    class Lost(ThreadPoolExecutor):
        def submit(self, *arguments):
            raise BrokenExecutor("gone")

    with Lost(1) as executor, pytest.raises(mbd.MechanismError, match=r"a worker of the executor was lost \(gone\)"):
        mbd.optimize(swing_up(), intervals=8, starts=2, executor=executor)
    with Stuck(1) as executor, pytest.raises(mbd.Interrupted):
        executor.runs = []
        mbd.optimize(swing_up(), intervals=8, starts=3, executor=executor)


def test_arguments():
    problem, *_ = rest_to_rest()
    with pytest.raises(mbd.ModelError, match=r"executor= takes a concurrent\.futures executor, got 3"):
        mbd.optimize(problem, starts=2, executor=3)
    with ThreadPoolExecutor(1) as executor:
        with pytest.raises(mbd.ModelError, match=r"give starts=, too"):
            mbd.optimize(problem, executor=executor)
        with pytest.raises(mbd.ModelError, match=r"refuses the options"):
            mbd.optimize(problem, starts=2, executor=executor, options={"no_such_option": 1})
