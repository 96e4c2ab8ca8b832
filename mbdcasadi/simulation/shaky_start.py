"""Starts in a shaky pose, which no finite reactions hold."""

from __future__ import annotations

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import SingularityError
from ..kinematics.mobility import Joints, mobility
from ..kinematics.singular import describe_singularity
from ..numerics.tolerances import NEARLY_SINGULAR
from ..results.state import State

#: Work of the loads along an infinitesimal motion, relative to that of each of them, that is rounding.
NO_WORK = 1e-9


def refuse_shaky_start(numeric: NumericEquations, state: State) -> None:
    """Raise if loads act along an infinitesimal motion of the start that goes nowhere.

    Reactions would have to be infinite there: an integrator follows the rounding of the pose.

    Raises
    ------
    SingularityError
        Naming the rows that take part.
    """
    eom, t, q = numeric.eom, state.t, state.q
    if eom.Q_depends_on_lam or numeric.is_regular(t, q):
        return
    if numeric.rank(t, q).rank_at(NEARLY_SINGULAR) == eom.lam.numel():
        return
    if not mobility(numeric, t, q).shaky:
        return
    blocked = Joints(numeric, t).blocked(q)
    work = blocked * numeric.scale.coordinates * np.atleast_1d(state[eom.Q])
    if np.all(np.abs(np.sum(work, axis=1)) <= NO_WORK * np.sum(np.abs(work), axis=1)):
        return
    rows = ", ".join(describe_singularity(numeric, t, q, shaky=True).rows)
    raise SingularityError(
        f"simulate: at t = {t:.6g} s the pose is shaky: it cannot move, and yet no finite reactions hold the loads "
        f"along an infinitesimal motion; the rows that take part are {rows}; move a point of one of these elements, or "
        "let it yield (a stiff spring in its place)",
        time=t,
    )
