"""Long use: many threads and processes over all analyses, thousands of runs of sweeps, Ctrl-C at random times.

    python benchmarks/soak.py                 # all three; about half an hour
    python benchmarks/soak.py sweeps threads --runs 2000
    python benchmarks/soak.py interrupts --times 200

Results of threads and processes are compared with those of one call after the other, memory after 2000 runs with
that after 200, and every analysis that is interrupted with what it says: ``Interrupted``, or its result.
"""

from __future__ import annotations

import argparse
import os
import random
import resource
import signal
import sys
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from typing import Any

from machine import one_thread

one_thread()

import numpy as np  # noqa: E402  (after the threads are set)

import mbdcasadi as mbd  # noqa: E402

#: Folder of the package.
PACKAGE = os.path.dirname(mbd.__file__)
#: Seed of the random times.
SEED = 5


class Models:
    """A driven pendulum, its problem of optimal control, and balls on a floor."""

    def __init__(self) -> None:
        self.damping, self.torque = mbd.Parameter("damping", 0.2), mbd.Input("torque", lower=-20, upper=20)
        self.arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
        self.hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), self.arm.at(-0.5, 0))
        motor = mbd.Torque("motor", self.arm, self.torque - self.damping * self.arm.omega)
        self.pendulum = mbd.Mechanism(
            [self.arm],
            joints=[self.hinge],
            forces=[mbd.Gravity(), motor],
            inputs=[self.torque],
            parameters=[self.damping],
        )
        law = mbd.HuntCrossley(1e4, damping=0.3)
        self.balls = [mbd.Body(f"b{k}", mass=0.2, inertia=2e-4, pose=(0.01 * k, 0.1 + 0.11 * k, 0)) for k in range(3)]
        discs = [mbd.Circle(ball.at(0, 0), 0.05) for ball in self.balls]
        floor = mbd.HalfPlane(mbd.ground.at(0, 0))
        contacts = [mbd.Contact(f"f{k}", disc, floor, law) for k, disc in enumerate(discs)]
        contacts += [mbd.Contact(f"c{k}", discs[k], discs[k + 1], law) for k in range(2)]
        self.pile = mbd.Mechanism(self.balls, forces=[mbd.Gravity(), *contacts])
        self.times = np.linspace(0, 1, 41)
        phi = self.arm.phi
        self.start = [phi == 0.3, self.arm.omega == 0]
        self.turn = mbd.OptimalControlProblem(
            self.pendulum, initial=[phi == 0, self.arm.omega == 0], final=[phi == 1, self.arm.omega == 0],
            duration=1.0, running_cost=self.torque**2,
        )  # fmt: skip

    def run(self, method: str = "idas", **more: Any) -> Any:
        """Motion of the pendulum."""
        return mbd.simulate(self.pendulum, self.times, initial=self.start, method=method, **more)

    def sweep(self, count: int = 16, **more: Any) -> Any:
        """Angles at the end for some dampings."""
        cases = {self.damping: np.linspace(0.1, 1.0, count)}
        return mbd.sweep(self.pendulum, self.times, cases, [self.arm.phi], self.start, **more)

    def fitted(self) -> float:
        """Damping from a motion with another one."""
        data = self.run(parameters={self.damping: 0.5})[self.arm.phi]
        found = mbd.identify(self.pendulum, self.times, {self.arm.phi: data}, [self.damping], self.start)
        return float(found.values[0])

    def analyses(self) -> dict[str, Callable[[], Any]]:
        """All analyses, each returning numbers."""
        phi = self.arm.phi
        motion = {phi: 0.3 * mbd.sin(mbd.t)}
        return {
            "simulate by idas": lambda: self.run().q[-1],
            "simulate by dop853": lambda: self.run("dop853").q[-1],
            "simulate by rosenbrock": lambda: self.run("rosenbrock").q[-1],
            "simulate by bdf": lambda: mbd.simulate(self.pile, duration=0.2, method="bdf").q[-1],
            "sweep": lambda: self.sweep()[phi][:, -1],
            "sweep by dop853": lambda: self.sweep(method="dop853")[phi][:, -1],
            "assemble": lambda: mbd.assemble(self.pendulum, [phi == 0.4]).q,
            "equilibrium": lambda: mbd.equilibrium(self.pendulum).q,
            "linearize": lambda: mbd.linearize(self.pendulum, mbd.equilibrium(self.pendulum)).A,
            "sensitivities": lambda: mbd.sensitivities(self.pendulum, self.times, [phi], [self.damping], self.start)[
                phi, self.damping
            ][-1],
            "identify": self.fitted,
            "inverse_dynamics": lambda: mbd.inverse_dynamics(
                self.pendulum, self.times, motion=motion, efforts=[self.torque]
            ).inputs[-1],
            "optimize": lambda: mbd.optimize(self.turn, intervals=20).cost,
        }


def results_of(rounds: int) -> list[dict[str, Any]]:
    """Results of all analyses, some times over, in an order of its own; for one process."""
    analyses = list(Models().analyses().items())
    found = []
    for _ in range(rounds):
        random.shuffle(analyses)
        found.append({name: np.array(analysis()) for name, analysis in analyses})
    return found


def compared(found: list[dict[str, Any]], expected: dict[str, Any]) -> int:
    """Number of results that differ, which are printed."""
    wrong = 0
    for results in found:
        for name, value in results.items():
            if not np.allclose(value, expected[name], rtol=1e-6, atol=1e-8):
                wrong += 1
                print(f"  {name}: {value}, expected {expected[name]}")
    return wrong


def many_at_once(count: int, rounds: int) -> int:
    """Number of wrong results of threads that share models, and of processes with their own."""
    models = Models()
    expected = {name: np.array(analysis()) for name, analysis in models.analyses().items()}

    def work(k: int) -> list[dict[str, Any]]:
        analyses = list(models.analyses().items())
        random.Random(SEED + k).shuffle(analyses)
        return [{name: np.array(analysis()) for name, analysis in analyses} for _ in range(rounds)]

    wrong = 0
    with ThreadPoolExecutor(count) as threads:
        for found in threads.map(work, range(count)):
            wrong += compared(found, expected)
    print(f"{count} threads, {rounds} rounds: {wrong} wrong", flush=True)
    with ProcessPoolExecutor(count) as processes:
        for found in processes.map(results_of, [rounds] * count):
            wrong += compared(found, expected)
    print(f"{count} processes, {rounds} rounds: {wrong} wrong with them", flush=True)
    return wrong


def megabytes() -> float:
    """Present memory of this process; the largest so far if the system does not report it."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3


def many_sweeps(runs: int) -> int:
    """1 if memory grows from a tenth of the sweeps of a case each to all of them."""
    models, early = Models(), 0.0
    for k in range(runs):
        models.sweep(2, method="dop853" if k % 2 else "idas")
        if k == runs // 10:
            early = megabytes()
    late = megabytes()
    print(f"{runs} sweeps: {early:.1f} MB after a tenth, {late:.1f} MB at the end", flush=True)
    return int(late > early + 10)


def interrupted(name: str, analysis: Callable[[], Any], expected: Any, duration: float, times: int) -> Counter[str]:
    """Outcomes of an analysis under Ctrl-C at random times, and wrong results after it."""
    outcome: Counter[str] = Counter()
    for _ in range(times):
        timer = threading.Timer(random.uniform(0, 1.1 * duration), os.kill, (os.getpid(), signal.SIGINT))
        try:
            timer.start()
            analysis()
            timer.join()  # a signal that comes later is not of this analysis
            outcome["before or after"] += 1
        except mbd.Interrupted:
            outcome["Interrupted"] += 1
        except KeyboardInterrupt as stopped:
            inside = any(PACKAGE in frame.filename for frame in traceback.extract_tb(stopped.__traceback__))
            outcome["KeyboardInterrupt inside" if inside else "before or after"] += 1
        except Exception as error:
            outcome["wrong"] += 1
            print(f"  {name}: {type(error).__name__}: {error}")
        while timer.is_alive():
            try:
                timer.join()
            except KeyboardInterrupt:
                pass
    if not np.allclose(np.array(analysis()), expected, rtol=1e-6, atol=1e-8):
        outcome["wrong"] += 1
        print(f"  {name}: the result after the interruptions is another one")
    return outcome


def many_interruptions(times: int) -> int:
    """Number of analyses that ended otherwise than they should under Ctrl-C."""
    wrong = 0
    for name, analysis in Models().analyses().items():
        expected = np.array(analysis())
        began = time.perf_counter()
        analysis()
        found = interrupted(name, analysis, expected, time.perf_counter() - began, times)
        wrong += found["wrong"]
        print(f"{name}: {dict(found)}", flush=True)
    return wrong


def main() -> None:
    """Run the soaks that are named; return an exit code that is not zero if something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", help="of threads, sweeps, interrupts; all if left out")
    parser.add_argument("--count", type=int, default=8, help="threads, and processes")
    parser.add_argument("--rounds", type=int, default=5, help="of each of these")
    parser.add_argument("--runs", type=int, default=2000, help="sweeps")
    parser.add_argument("--times", type=int, default=200, help="interruptions of each analysis")
    given = parser.parse_args()
    warnings.simplefilter("ignore", mbd.MechanismWarning)
    random.seed(SEED)
    parts: dict[str, Callable[[], int]] = {
        "threads": lambda: many_at_once(given.count, given.rounds),
        "sweeps": lambda: many_sweeps(given.runs),
        "interrupts": lambda: many_interruptions(given.times),
    }
    wrong = sum(parts[name]() for name in given.parts or parts)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
