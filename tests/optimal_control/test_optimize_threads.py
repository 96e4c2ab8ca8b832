"""One problem solved in several threads at a time."""

import os
import sys
import threading

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest, sprung_block
from threads import together

import mbdcasadi as mbd
from mbdcasadi.numerics.symbolic import LOCK, numeric_work, symbolic

THREADS = 8


@pytest.fixture(autouse=True)
def impatient():
    """Threads take turns as often as the interpreter lets them."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.slow
@pytest.mark.parametrize("solved", [False, True])
def test_eight_threads_find_the_same_optimum(solved):
    """12 d² / T³ in each, whether anything was compiled before or not; the program is made once."""
    for _ in range(3):
        problem, *_ = rest_to_rest(3.0, 2.0)
        if solved:
            mbd.optimize(problem, intervals=8)
        solutions = together([lambda problem=problem: mbd.optimize(problem, intervals=8)] * THREADS)
        assert [s.cost for s in solutions] == pytest.approx([13.5] * THREADS, rel=1e-9)
        assert {s.statistics.status for s in solutions} == {"Solve_Succeeded"}
        assert len(problem.compiled.programs) == 1 and len({id(s.program) for s in solutions}) == 1


@pytest.mark.slow
def test_a_linkage_is_evaluated_and_verified_in_threads():
    """Loops, trajectories, local errors and verification."""
    f = crank_rocker()
    problem = half_turn(f)

    def measures():
        solution = mbd.optimize(problem, intervals=12)
        motion = solution.trajectory
        reaction = np.max(motion[mbd.norm(f.a.reaction_on(f.coupler).force)])
        return [solution.cost, np.max(motion[f.tau]), reaction, solution.mesh_error, solution.verify().final_error]

    found = np.array(together([measures] * THREADS))
    np.testing.assert_allclose(found, np.tile(measures(), (THREADS, 1)), rtol=1e-6)


@pytest.mark.slow
def test_each_thread_has_its_own_start_parameters_and_options():
    """As one after the other, with refinement in some and several starts in others."""
    problem, _, k, block = sprung_block(3.0, 2.0)
    starts = [[block.x == 0.1 * i, block.vx == 0] for i in range(THREADS)]

    def cost(i):
        more = [{}, {"tolerance": 1e-7}, {"starts": 2}, {"options": {"ipopt.max_iter": 500}}][i % 4]
        return mbd.optimize(problem, intervals=8, initial=starts[i], parameters={k: 1.0 + i}, **more).cost

    found = together([lambda i=i: cost(i) for i in range(THREADS)])
    assert found == pytest.approx([cost(i) for i in range(THREADS)], rel=1e-8)


@pytest.mark.slow
def test_a_failure_in_one_thread_leaves_the_others_alone():
    problem, _u, block = rest_to_rest(3.0, 2.0, lower=-8, upper=8)

    starts = [[block.x == place, block.vx == 0] for place in (0.0, -100.0)]

    def attempt(start):
        try:
            return mbd.optimize(problem, intervals=8, initial=start).cost
        except mbd.OptimizationError as error:
            return str(error)

    found = together([lambda i=i: attempt(starts[i % 2]) for i in range(THREADS)])
    assert found[::2] == pytest.approx([13.5] * (THREADS // 2), rel=1e-9)
    assert all("infeasible" in text for text in found[1::2])


@pytest.mark.slow
def test_problems_are_made_in_threads():
    """Of one mechanism, whose equations are derived once; expressions are made before."""
    f = crank_rocker()
    arguments = dict(
        initial=[f.o2.angle == 0.5, f.crank.omega == 0],
        final=[f.o2.angle == 0.5 + np.pi, f.crank.omega == 0],
        running_cost=f.tau**2,
    )
    for _ in range(3):
        problems = together([lambda: mbd.OptimalControlProblem(f.mechanism, 0.6, **arguments)] * THREADS)
        assert len({id(problem.equations) for problem in problems}) == 1
        costs = together([lambda p=p: mbd.optimize(p, intervals=8).cost for p in problems])
        assert costs == pytest.approx([costs[0]] * THREADS, rel=1e-10)


def test_solvers_are_lent_to_one_solve_at_a_time():
    """One solver serves solves one after the other, and as many as run at a time are made."""
    problem, *_ = rest_to_rest(3.0, 2.0)
    for _ in range(3):
        solution = mbd.optimize(problem, intervals=6)
    assert solution.program.solvers.idle == 1
    together([lambda: mbd.optimize(problem, intervals=6)] * THREADS)
    assert 1 <= solution.program.solvers.idle <= THREADS


def test_one_thread_at_a_time_works_with_expressions():
    """But for the time in which it computes with numbers, however deep it stands in such work."""
    inside, most, entered = [], [], threading.Semaphore(0)

    @symbolic
    def work(wait):
        with LOCK:
            inside.append(1)
            most.append(len(inside))
            if wait:
                inside.pop()
                with numeric_work():
                    assert entered.acquire(timeout=20), "nobody else came in"
                inside.append(1)
            inside.pop()
        entered.release()

    together([lambda: work(True), lambda: work(False)])
    together([lambda: work(False)] * THREADS)
    assert max(most) == 1
    assert LOCK.acquire(blocking=False)
    LOCK.release()


def test_numeric_work_outside_of_symbolic_work():
    with numeric_work():
        pass
    with LOCK, pytest.raises(ZeroDivisionError), numeric_work():
        raise ZeroDivisionError
    assert LOCK.acquire(blocking=False)
    LOCK.release()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork processes")
def test_a_process_that_is_forked_meanwhile_can_optimise():
    """The child has only the thread that forked, and must not wait for one that holds the lock."""
    problem, *_ = rest_to_rest(3.0, 2.0)
    held, done = threading.Event(), threading.Event()

    def hold():
        with LOCK:
            held.set()
            done.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait()
    child = os.fork()
    if child == 0:
        right = abs(mbd.optimize(problem, intervals=4).cost - 13.5) < 1e-6
        os._exit(0 if right else 1)
    try:
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    finally:
        done.set()
        thread.join()
