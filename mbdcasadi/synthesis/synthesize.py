"""Linkages that pass through given positions."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np

from ..equations import equations
from ..errors import ModelError
from ..model.conditions import Relations
from ..model.mechanism import Mechanism
from ..model.quantities import entries, function_of, is_list, listed, refuse_twice, whole, yes_or_no
from ..model.symbols import Parameter, place_of, positive
from ..numerics.console import keyboard_interrupts
from .linkage import Linkage, Shared
from .linkages import Linkages, Search
from .positions import Positions
from .search import MOST, Found, SymmetryMap, SynthesisSearch

#: Wall-clock time of a search, if none is given, s.
SECONDS = 60.0
#: Relations that a linkage names as missed.
NAMED = 5


@keyboard_interrupts("synthesize")
def synthesize(
    mechanism: Mechanism,
    unknowns: Sequence[Parameter],
    positions: Sequence[Relations],
    conditions: Relations = (),
    *,
    exact: bool = True,
    seconds: float = SECONDS,
    executor: Executor | None = None,
    seed: int = 0,
    symmetries: Sequence[SymmetryMap] = (),
) -> Linkages:
    """Find the dimensions with which a mechanism passes through given positions: all of them, as far as they are found.

    At position k the pose ``q_k`` and the unknowns ``p`` meet ``Phi(q_k, p) = 0`` and ``f_k(q_k, p) = 0``. Many random
    starts, of sizes from a thirtieth to thirty times those of the drawing, go down by damped Gauss-Newton steps in
    which each pose is eliminated; what they find is solved to rounding by Newton's method. Linkages that differ by an
    exchange of equal chains count once, and those with two joints of a body in one point are left out.

    Parameters
    ----------
    mechanism : Mechanism
        The linkage, without drivers. If unknowns are among its joints and these meet as drawn whatever they are, as if
        points of bodies are given where they are at first, the drawn pose is that of the first position.
    unknowns : sequence of Parameter
        Dimensions to find, of the mechanism, with their limits.
    positions : sequence of relations
        For each position what holds there: ``[tracer.position == (1, 2)]``, ``[crank.phi == 0.3, rocker.phi == 0.1]``,
        the pose of a body.
    conditions : sequence of relations, optional
        On the unknowns: equalities and limits, ``[length <= 2, a / b == 0.5, bounded(0.5, b, 1.5)]``.
    exact : bool, default True
        False if relations hold as nearly as can be: then the sum of squares of what they miss, in lengths of the
        drawing and radians, is least. The linkage closes exactly in any case, and conditions hold.
    seconds : float, default 60
        Longest wall-clock time of the search, its equations not counted. It ends before if each linkage was found 20
        times, or, if relations need not be exact, with one that meets them all.
    executor : concurrent.futures.Executor, optional
        Threads or processes that search; without, this thread.
    seed : int, default 0
        Of the random starts.
    symmetries : sequence of callable, optional
        Maps ``{parameter: value} -> [{parameter: value}, …]`` of a solution to others, such as the cognates of a
        four-bar: the list is closed under them.

    Returns
    -------
    Linkages
        In the order of their residuals if these are not exact. If positions leave dimensions free, a sample; so are
        those that belong to a family, as parallelograms may.

    Raises
    ------
    ModelError
        For more equations than unknowns, conditions that contradict each other, positions that are out of reach by
        themselves, and if nothing was found: by name.

    References
    ----------
    Wampler, Morgan, Sommese, "Complete solution of the nine-point path synthesis problem for four-bar linkages",
    Journal of Mechanical Design 114 (1992) 153.
    """
    began = clock.perf_counter()
    what = "synthesize"
    eom = equations(mechanism)  # raises for what is not a mechanism
    yes_or_no(exact, what, "exact")
    seconds, seed = positive(seconds, what, "seconds"), whole(seed, what, "seed", 0)
    if executor is not None and not hasattr(executor, "submit"):
        raise ModelError(f"{what}: executor= takes a concurrent.futures executor, got {executor!r}")
    if mechanism.drivers:
        raise ModelError(
            f"{what}: the mechanism has the driver '{mechanism.drivers[0].name}'; positions take its place"
        )
    if eom.position_rows.size < eom.lam.numel():
        raise ModelError(f"{what}: the mechanism has constraints on velocities, which positions do not know")
    free = listed(unknowns, Parameter, "unknowns=")
    refuse_twice(free, "unknowns=")
    if not free:
        raise ModelError(f"{what}: unknowns= needs a parameter of the mechanism")
    for parameter in free:
        if place_of(parameter, mechanism.parameters) is None:
            raise ModelError(f"{what}: '{parameter.label}' in unknowns= is not among the parameters of the mechanism")
    positions = entries(positions, "positions=")
    if not positions or not all(is_list(one) for one in positions):
        raise ModelError(f"{what}: positions= takes a list of relations for each position, got {positions!r}")
    positions = [tuple(one) for one in positions]
    if () in positions:
        raise ModelError(f"{what}: position {positions.index(()) + 1} has no relation")
    if not is_list(symmetries):
        raise ModelError(f"{what}: symmetries= takes functions, got {symmetries!r}")
    for symmetry in symmetries:
        function_of(symmetry, what, "symmetries=", "values")
    problem = Positions(mechanism, free, positions, conditions, exact=exact)
    search = SynthesisSearch(problem, exact=exact, symmetries=symmetries, seed=seed)
    search.check()
    search.run(seconds, executor)
    if not search.found:
        raise ModelError(
            f"{what}: no linkage was found from {search.starts} starts in {seconds:g} s; each position is in reach by "
            "itself: give more seconds=, unknowns or wider limits, or say exact=False"
        )
    return _list(search, len(positions), clock.perf_counter() - began)


def _list(search: SynthesisSearch, positions: int, seconds: float) -> Linkages:
    """The linkages of a search."""
    shared, found = Shared(search.positions.mechanism, search.positions.unknowns), search.found
    if not search.exact:
        found = sorted(found, key=lambda one: one.solution.residual)[:MOST]
    linkages = [_linkage(search, shared, one) for one in found]
    free = max(search.solving.free, 0) if search.exact else 0
    return Linkages(linkages, Search(search.exact, positions, free, search.starts, seconds, search.solving.unsettled))


def _linkage(search: SynthesisSearch, shared: Shared, found: Found) -> Linkage:
    problem, solution = search.positions, found.solution
    y = np.vstack([problem.start[None], solution.y]) if problem.drawn else solution.y
    names = search.solving.names
    worst = np.argsort(-np.abs(solution.rows))[:NAMED].tolist()
    misses = {names[k]: abs(float(solution.rows[k])) for k in worst}
    return Linkage(shared, solution.p, y, misses, solution.residual, found.count, solution.family)
