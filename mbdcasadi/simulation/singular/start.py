"""Starts in a singular pose: one that no finite reactions hold, or from which several motions go."""

from __future__ import annotations

import numpy as np

from ...equations.numeric import NumericEquations
from ...errors import SingularityError
from ...kinematics.mobility import Joints, mobility
from ...kinematics.singular import describe_singularity
from ...numerics.least_squares import largest
from ...numerics.rank import analyse_rank
from ...numerics.tolerances import MET, NEARLY_SINGULAR, NEGLIGIBLE
from ...results.state import State


def refuse_singular_start(numeric: NumericEquations, state: State) -> None:
    """Raise at a start in a singular pose from which the equations of motion determine no motion.

    In a shaky pose loads may act along an infinitesimal motion that cannot go on: reactions would have to be
    infinite, and an integrator follows the rounding of the pose. At rest in a pose from which several motions go, the
    accelerations of least norm may lie along none of them.

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
    near = mobility(numeric, t, q)
    if near.shaky and _loads_act_along_blocked_motions(numeric, state):
        reason = (
            "shaky: it cannot move, and yet no finite reactions hold the loads along an infinitesimal motion",
            "move a point of one of these elements, or let it yield (a stiff spring in its place)",
        )
    elif near.singular and not near.shaky and not _begins_along_a_motion(numeric, state):
        reason = (
            "singular, a bifurcation: several motions go from it, and at rest the loads do not decide between them",
            "start from a pose near it, or with velocities along one of the motions",
        )
    else:
        return
    rows = ", ".join(describe_singularity(numeric, t, q, state.z, near).rows)
    pose, remedy = reason
    raise SingularityError(
        f"simulate: at t = {t:.6g} s the pose is {pose}; the rows that take part are {rows}; {remedy}", time=t
    )


def _loads_act_along_blocked_motions(numeric: NumericEquations, state: State) -> bool:
    """True if loads do work along an infinitesimal motion that cannot go on."""
    blocked = Joints(numeric, state.t).blocked(state.q)
    work = blocked * numeric.scale.coordinates * np.atleast_1d(state[numeric.eom.Q])
    return not np.all(np.abs(np.sum(work, axis=1)) <= NEGLIGIBLE * np.sum(np.abs(work), axis=1))


def _begins_along_a_motion(numeric: NumericEquations, state: State) -> bool:
    """True if the accelerations of a start at rest go on to second order; a start that moves has been tested before.

    With ``q = q_0 + a t²/2`` the constraints are met to the fourth order in t if ``w^T (Phi_q a)_q a = 0`` for each
    combination w of rows that vanishes in the pose.
    """
    t, q, size = state.t, state.q, numeric.scale.coordinates
    if largest(state.v / size) > 0:
        return True
    direction = state.a / max(largest(state.a / size), 1e-300)
    jacobian = numeric.jacobian(t, q)
    bent, back, still = (
        numeric.acceleration(t, q, v, state.z, state.inputs)[1] for v in (direction, -direction, 0 * direction)
    )
    combinations = analyse_rank(numeric.scale.scaled(jacobian), NEARLY_SINGULAR).null_rows
    missed = combinations @ (((bent + back) / 2 - still) / numeric.scale.row_size(jacobian))
    return largest(missed) <= MET
