"""Consistent starts of many cases at once."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from ..assembly.consistent_start import consistent_start
from ..assembly.pose import LARGEST_TURN
from ..equations.numeric import NumericEquations
from ..errors import MechanismError, MechanismWarning, SimulationError, warn
from ..numerics.console import call_each
from ..numerics.packed import Packed
from ..sensitivity.compiled_run import MotionSetup
from ..sensitivity.differentiable_start import FOUND

#: Steps from the start of the first case to those of the others, one try after the other.
STEPS = (1, 8, 32)


class StartPath:
    """The path from one start to those at other parameters: a compiled function and arrays, nothing of the model.

    The parameters are changed in steps, so that every case stays on the branch
    of the first; a start that is not reached in small turns is given up. All cases
    take the same even steps, since one call of compiled code moves them all.

    Parameters
    ----------
    setup : MotionSetup
        The mechanism at the parameters at its beginning.
    """

    def __init__(self, setup: MotionSetup):
        start = setup.differentiable_start
        self._function = Packed(start.function)
        self._p, self._guess = setup.p, start.guess
        self._others = start.right, start.z_estimate
        self._state = np.r_[start.state.q, start.state.v, start.state.z]
        self._angles = np.flatnonzero(setup.eom.angles)

    def starts(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the starts of some cases.

        Parameters
        ----------
        parameters : numpy.ndarray
            (k, n_p).

        Returns
        -------
        starts : numpy.ndarray
            (k, n_x).
        reached : numpy.ndarray of bool
            True for those that were found (k,).
        """
        function = self._function.unpacked()
        starts = np.full((len(parameters), self._state.size), np.nan)
        reached = np.zeros(len(parameters), bool)
        for steps in STEPS:
            left = np.flatnonzero(~reached)
            if left.size:
                starts[left], reached[left] = self._in_steps(function, parameters[left], steps)
        return starts, reached

    def _in_steps(self, function: ca.Function, parameters: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Starts that are reached in so many steps (k, n_x), and which of them are good."""
        count = len(parameters)
        guess, before = np.tile(self._guess[:, None], (1, count)), np.tile(self._state[:, None], (1, count))
        good = np.ones(count, bool)
        for step in range(1, steps + 1):
            p = self._p[:, None] + step / steps * (parameters.T - self._p[:, None])
            chosen = np.flatnonzero(good)
            if not chosen.size:
                break
            states, solution, residual = self._solved(function, p[:, chosen], guess[:, chosen])
            turned = np.max(np.abs(states - before[:, chosen])[self._angles], axis=0, initial=0.0)
            good[chosen] = (residual <= FOUND) & (turned <= LARGEST_TURN)
            guess[:, chosen], before[:, chosen] = solution, states
        return before.T, good

    def _solved(
        self, function: ca.Function, p: np.ndarray, guess: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """States and solutions by column, and residuals; infinite where the search meets a singular matrix."""
        x, solution, residual = call_each(function, p, *self._others, guess)
        solution = np.where(np.isfinite(solution), solution, self._guess[:, None])
        return x, solution, np.where(np.isfinite(residual), residual, np.inf).ravel()


def assembled_start(setup: MotionSetup, parameters: np.ndarray, case: int) -> np.ndarray:
    """Assemble the start of one case (n_x,).

    Raises
    ------
    MechanismError
        If there is none.

    Warns
    -----
    MechanismWarning
        With the case, if the pose may lie on another branch.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            numeric = NumericEquations(setup.eom, parameters)
            state = consistent_start(numeric, setup.initial, float(setup.grid[0]), setup.signals)
        except RuntimeError as error:
            raise SimulationError(f"no start was found: {error}") from None
    repeat_for_case(caught, case)
    return np.r_[state.q, state.v, state.z]


def repeat_for_case(caught: list[warnings.WarningMessage], case: int) -> None:
    """Warn of what was caught while a case was prepared, with the case."""
    for warning in caught:
        if issubclass(warning.category, MechanismWarning):
            warn(f"sweep, case {case}: {warning.message}")
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


def out_of_limits(setup: MotionSetup, parameters: np.ndarray, cases: np.ndarray) -> dict[int, str]:
    """Message by case for values that the model does not allow.

    Parameters
    ----------
    parameters : numpy.ndarray
        Of all cases (k, n_p).
    cases : numpy.ndarray of int
        Cases that are looked at.
    """
    failures = {}
    for k in cases if setup.mechanism.limits else ():
        try:
            setup.mechanism.check_values(parameters[k])
        except MechanismError as error:
            failures[int(k)] = str(error)
    return failures
