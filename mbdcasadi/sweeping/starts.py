"""Consistent starts of many cases at once."""

from __future__ import annotations

import numpy as np

from ..assembly.consistent_start import consistent_start
from ..assembly.pose import LARGEST_TURN
from ..equations.numeric import NumericEquations
from ..errors import MechanismError
from ..sensitivity.compiled_run import MotionSetup
from ..sensitivity.differentiable_start import FOUND

#: Steps from the start of the first case to those of the others, one try after the other.
STEPS = (1, 8, 32)


def starts_of(setup: MotionSetup, parameters: np.ndarray) -> tuple[np.ndarray, dict[int, str]]:
    """Starts of all cases, and why some have none.

    From the start of the setup the parameters are changed in steps, all
    cases together, so that every case stays on the branch of the first; what
    does not arrive in small turns is assembled by itself.

    Parameters
    ----------
    setup : MotionSetup
        The mechanism at the parameters of one case.
    parameters : numpy.ndarray
        (k, n_p).

    Returns
    -------
    starts : numpy.ndarray
        (k, n_x).
    failures : dict of int to str
        Message by case.
    """
    count, size = len(parameters), setup.differentiable_start.function.size1_out(0)
    starts, failures = np.full((count, size), np.nan), _out_of_limits(setup, parameters)
    left = np.array([k for k in range(count) if k not in failures], int)
    for steps in STEPS:
        if left.size:
            found, good = _in_steps(setup, parameters[left], steps)
            starts[left[good]] = found[good]
            left = left[~good]
    for k in left:
        try:
            numeric = NumericEquations(setup.eom, parameters[k])
            state = consistent_start(numeric, setup.initial, float(setup.grid[0]), setup.signals)
            starts[k] = np.r_[state.q, state.v, state.z]
        except MechanismError as error:
            failures[int(k)] = str(error)
    return starts, failures


def _out_of_limits(setup: MotionSetup, parameters: np.ndarray) -> dict[int, str]:
    failures = {}
    for k, p in enumerate(parameters):
        try:
            setup.mechanism.check_values(p)
        except MechanismError as error:
            failures[k] = str(error)
    return failures


def _in_steps(setup: MotionSetup, parameters: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts that are reached in so many steps (k, n_x), and which of them are good."""
    start, base = setup.differentiable_start, setup.numeric.p
    angles = np.flatnonzero(setup.numeric.eom.angles)
    guess = np.tile(start.guess[:, None], (1, len(parameters)))
    before = np.tile(np.r_[start.state.q, start.state.v, start.state.z][:, None], (1, len(parameters)))
    good = np.ones(len(parameters), bool)
    for step in range(1, steps + 1):
        p = base[:, None] + step / steps * (parameters.T - base[:, None])
        states, guess, residual = start.solve(p, guess)
        turned = np.max(np.abs(states - before)[angles], axis=0, initial=0.0)
        good &= (residual <= FOUND) & (turned <= LARGEST_TURN)
        guess = np.where(np.isfinite(guess), guess, start.guess[:, None])
        before = states
    return before.T, good
