"""What each strategy of the search is worth: families of problems with each one left out in turn.

``python ablation.py [COUNT [SEED]]`` solves COUNT instances of each family with all strategies, and again without each
of those that took part; without one that did not take part the search is the same. The table has the share of the
problems that are solved, the median and the 90 % quantile of the costs as ratios to the lowest cost that any run found,
and the time of the processor.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import known_feasibility
import least_times
import numpy as np
import random_families
import random_phases
import random_swing_ups
import random_swings
import random_tasks

import mbdcasadi as mbd

#: Cost of which a ratio is taken, below which costs of problems count as zero.
SMALL = 1e-9
#: Where the results are kept.
RESULTS = Path(__file__).parent / "results" / "ablation.json"


@dataclass(frozen=True)
class Run:
    """One solve: its cost, nan if it failed; seconds of the processor; strategies that took part."""

    cost: float
    seconds: float
    strategies: tuple[str, ...]


def problems(count: int, seed: int) -> Iterator[tuple[str, Callable[[], mbd.OptimalControlProblem]]]:
    """Names of instances, and functions that state them."""
    families = {
        **{name: partial(make, limits=None) for name, make in random_families.FAMILIES.items()},
        **{name: partial(random_swing_ups.swing_up, limits=None, kind=name) for name in random_swing_ups.KINDS},
        **random_tasks.FAMILIES,
        **random_phases.FAMILIES,
        **{f"least time, {name}": partial(_problem_of, make) for name, make in least_times.FAMILIES.items()},
        **random_swings.FAMILIES,
    }
    for name, make in families.items():
        for k in range(count):
            yield f"{name} {k}", partial(_instance, make, seed, k)
    for name in random_families.FAMILIES:
        for k in range(count):
            yield f"tight {name} {k}", partial(known_feasibility.simulated, name, seed, k)
    yield from known_feasibility.impossible()


def _instance(make: Callable[[np.random.Generator], mbd.OptimalControlProblem], seed: int, k: int):
    return make(np.random.default_rng([seed, k]))


def _problem_of(make: Callable, random: np.random.Generator) -> mbd.OptimalControlProblem:
    return make(random).problem


def run(problem: mbd.OptimalControlProblem, strategies: list[mbd.Strategy]) -> Run:
    """Solve a problem by some strategies."""
    began = time.process_time()
    seen: list[str] = []
    recording = [_Recorded(strategy, seen) for strategy in strategies]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            cost = mbd.optimize(problem, search=recording).cost
        except mbd.MechanismError:
            cost = np.nan
    return Run(cost, time.process_time() - began, tuple(dict.fromkeys(seen)))


class _Recorded(mbd.Strategy):
    """A strategy that notes when it proposes something."""

    def __init__(self, strategy: mbd.Strategy, seen: list[str]):
        self._strategy, self._seen = strategy, seen
        self.name, self.goes_on, self.ends_at_solution = strategy.name, strategy.goes_on, strategy.ends_at_solution

    def applies(self, trials) -> bool:
        return self._strategy.applies(trials)

    def proposals(self, trials):
        proposals = self._strategy.proposals(trials)
        try:
            proposal = next(proposals)
            self._seen.append(self.name)
            while True:
                proposal = proposals.send((yield proposal))
        except StopIteration:
            return


def main(count: int = 3, seed: int = 0) -> None:
    """Solve all families with all strategies and without each, and print the table."""
    names = [strategy.name for strategy in mbd.STRATEGIES]
    runs: dict[str, dict[str, Run]] = {}
    for name, make in problems(count, seed):
        try:
            problem = make()
        except mbd.MechanismError as error:  # a free solution, from which the task is made, is not found
            print(f"  {name}: {error}", file=sys.stderr)
            continue
        whole = run(problem, list(mbd.STRATEGIES))
        runs[name] = {"": whole}
        for left_out in names[1:]:
            part = [strategy for strategy in mbd.STRATEGIES if strategy.name != left_out]
            runs[name][left_out] = run(problem, part) if left_out in whole.strategies else whole
        took = ", ".join(whole.strategies)
        print(f"  {name}: {whole.cost:.6g}, {whole.seconds:.1f} s ({took})", file=sys.stderr, flush=True)
        RESULTS.write_text(json.dumps({n: {k: vars(r) for k, r in of.items()} for n, of in runs.items()}, indent=1))
    print(
        "| left out | took part | solved | median ratio | 90 % ratio | worst | s |\n|---|---:|---:|---:|---:|---:|---:|"
    )
    for left_out in ["", *names[1:]]:
        print(row(left_out, runs), flush=True)


def row(left_out: str, runs: dict[str, dict[str, Run]]) -> str:
    """Row of the table."""
    ratios, seconds, parts = [], 0.0, 0
    for of in runs.values():
        costs = [each.cost for each in of.values() if np.isfinite(each.cost)]
        one = of[left_out]
        seconds += one.seconds
        parts += left_out in of[""].strategies
        if costs:
            least = min(costs)
            ratios.append((one.cost - least) / max(abs(least), SMALL) + 1)
    found = np.array([ratio for ratio in ratios if np.isfinite(ratio)])
    shares = (
        f"{found.size} of {len(ratios)} | {np.median(found):.4f} | {np.quantile(found, 0.9):.4f} | {found.max():.3g}"
    )
    return f"| {left_out or '(none)'} | {parts or ''} | {shares} | {seconds:.0f} |"


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
