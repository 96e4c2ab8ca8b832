"""Quantities of a motion that nothing decides: the cost does not change with them to second order.

They are looked for among the first state, the free times and the free parameters, on which all the rest follows if the
inputs react as they cost least.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...errors import warn
from ..motion.solved_motion import SolvedMotion
from .saddle import Curvature

#: Curvatures of the scaled cost, below those by which a small cost added for smoothness decides (1e-7), with which what
#: is flat gives way; and factor by which it does so, that of both if limits far away, by their multipliers, are softer.
SOFT, YIELD = (1e-8, 1e-9), 3.0
#: Share of a direction from which a quantity is named.
NAMED = 0.1
#: Number of quantities that are named.
NAMES = 4


def warn_of_undecided(solution: SolvedMotion) -> None:
    """Warn of quantities of the start, free times and free parameters that no condition and no cost decides."""
    count, names = undecided(solution)
    if not count:
        return
    problem = solution.problem
    phases = ", ".join(f"'{phase.name}'" for phase in problem.phases)
    through = f" through the phases {phases}" if len(problem.phases) > 1 else ""
    what = f"1 quantity of the motion{through} is" if count == 1 else f"{count} quantities of the motion{through} are"
    warn(
        f"{what} decided by no condition and no cost ({', '.join(names)}): the solution is one of many; state the "
        "start in initial=, or boundary conditions for what is to repeat"
    )


def undecided(solution: SolvedMotion) -> tuple[int, list[str]]:
    """Return the number of quantities that nothing decides, and the names of those that change with them.

    A force of one that pulls at a quantity moves it by the inverse of the curvature of the cost; where there is none,
    by as much more as the curvature is smaller that is added for all variables.
    """
    places = _free_places(solution)
    if not places:
        return 0, []
    program = solution.program
    times = [part.segment_times for part in solution.phases]
    bounds = program.bounds(solution.phases[0].trajectory.initial, solution.meshes, times)
    places = {k: name for k, name in places.items() if bounds.lower[k] < bounds.upper[k]}
    if not places:
        return 0, []
    x = solution.variables / program.scale
    data = program.data([part.numeric.p for part in solution.phases], solution.meshes, times, solution.settings.known)
    curvature = Curvature(program, x, data, bounds, solution.answer.lam_x, solution.answer.lam_g)
    hard, soft = (curvature.compliance(list(places), least) for least in SOFT)
    _, directions = np.linalg.eigh(soft)
    # below one a change by the typical size costs as much as is typical, and what is left is rounding
    gives_way = [d @ soft @ d > max(YIELD * (d @ hard @ d), 1.0) for d in directions.T]
    flat = directions[:, gives_way]
    sizes = np.max(np.abs(flat), axis=1, initial=0.0)
    names = [name for name, size in zip(places.values(), sizes, strict=True) if size > NAMED]
    return flat.shape[1], names[:NAMES] + ["…"] * (len(names) > NAMES)


def _free_places(solution: SolvedMotion) -> dict[int, str]:
    """Places of the first state, of times and of free parameters among the variables, and their names."""
    program, first = solution.program, solution.phases[0].program
    places: dict[int, str] = {}
    if first.initial is not None:
        eom = first.scheme.eom
        names = [symbol.name() for group in (eom.q, eom.v, eom.z) for symbol in ca.vertsplit(group)]
        places |= {int(k): f"{name} at the start" for k, name in zip(first.point_index(0), names, strict=False)}
    for part in solution.phases:
        phase, several = part.phase, len(solution.phases) > 1
        of = f" of phase '{phase.name}'" if several else ""
        stated = [f"the time of waypoint {k}{of}" for k in range(1, len(phase.waypoints) + 1)]
        places |= dict(zip(part.program.stated_time_index[1:].tolist(), [*stated, f"the duration{of}"], strict=False))
    labels = [p.label for p in solution.problem.free_parameters]
    return places | dict(zip(program.parameter_index.tolist(), labels, strict=True))
