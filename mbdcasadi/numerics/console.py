"""Calls of compiled code: quiet on the terminal, open to Ctrl-C, and safe if a linear system in it is singular."""

from __future__ import annotations

import io
import signal
import threading
import warnings
from _signal import signal as set_handler  # type: ignore[import-not-found]
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr
from typing import Any

import casadi as ca
import numpy as np

from ..errors import Interrupted, MechanismWarning
from .symbolic import LOCK

#: Parts of the messages with which CasADi's linear solvers and root finders refuse a singular matrix.
_SINGULAR = (
    "factorization failed",
    "singular",
    "failed to solve",
    "solve failed",
    "nfact",
    "rootfinder process failed",
)


@contextmanager
def quiet() -> Iterator[None]:
    """Keep CasADi's remarks on a failing integrator off standard error: the error that is raised says more."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    with redirect_stderr(io.StringIO()):
        yield


@contextmanager
def without_warnings(message: str = "") -> Iterator[None]:
    """Ignore the package's warnings that match a pattern: those of a step whose result is only tried."""
    # filters belong to the process: two threads must not change them in turn
    with LOCK, warnings.catch_warnings():
        warnings.filterwarnings("ignore", message, MechanismWarning)
        yield


class Interruption:
    """Ctrl-C during a call of compiled code: `requested` reports it."""

    def __init__(self) -> None:
        self.requested = False


class interruptible:
    """Context that remembers Ctrl-C: inside compiled code it comes back as an error that does not say so.

    Parameters
    ----------
    raising : bool, default True
        True if Python code is interrupted too; else who runs must ask `requested`.
    """

    def __init__(self, *, raising: bool = True):
        self._raising, self._interruption = raising, Interruption()
        self._previous: Any = None

    def __enter__(self) -> Interruption:
        self._is_main = threading.current_thread() is threading.main_thread()
        if self._is_main:  # not by signal.signal, which looks for a handler among constants, at ten microseconds a call
            self._previous = set_handler(signal.SIGINT, self._remember)
        return self._interruption

    def _remember(self, number: int, frame: Any) -> None:
        self._interruption.requested = True
        if self._raising:
            raise KeyboardInterrupt

    def __exit__(self, *_: Any) -> None:
        if self._is_main:
            set_handler(signal.SIGINT, self._previous)


@contextmanager
def keyboard_interrupts(analysis: str, partial: Callable[[], Any] | None = None) -> Iterator[Interruption]:
    """Raise Interrupted on Ctrl-C, also for the error that compiled code raises then.

    Inside CasADi's conversions Ctrl-C comes back as nothing, on which the next line fails.

    Parameters
    ----------
    partial : callable, optional
        Returns the results so far; None if there are none.
    """
    with interruptible() as interruption:
        try:
            yield interruption
            if not interruption.requested:
                return
        except Interrupted:
            raise
        except (KeyboardInterrupt, Exception) as error:
            if not interruption.requested and not isinstance(error, KeyboardInterrupt):
                raise
    result = None if partial is None else partial()
    remark = "" if result is None else "; .partial holds what was computed"
    raise Interrupted(f"{analysis}: stopped by the user{remark}", partial=result)


def call(function: Any, *arguments: Any) -> Any:
    """Call compiled code quietly; Ctrl-C in it is raised as such, not as a failure or as nothing."""
    with quiet(), interruptible() as interruption:
        try:
            result = function(*arguments)
        except Exception:
            if interruption.requested:
                raise KeyboardInterrupt from None
            raise
        if interruption.requested:
            raise KeyboardInterrupt
        return result


def is_singular(error: BaseException) -> bool:
    """Return True for the error that a linear solver in compiled code raises at a singular matrix."""
    text = str(error).lower()
    return isinstance(error, RuntimeError) and any(part in text for part in _SINGULAR)


def call_each(function: ca.Function, *arguments: Any) -> list[np.ndarray]:
    """Call a compiled function for many points by column; results are NaN at points with a singular matrix.

    One such point would else take all others with it: the batch is divided until that point is alone.

    Parameters
    ----------
    function : casadi.Function
        Of columns.
    *arguments : array_like
        Each (rows, k), or (rows,) for the same at all points.

    Returns
    -------
    list of numpy.ndarray
        Results (rows, k), a column for each point.
    """
    columns = [ca.DM(argument) for argument in arguments]
    count = max((column.size2() for column in columns if column.size1()), default=1)

    def results(first: int, last: int) -> list[np.ndarray]:
        part = [c if c.size2() != count else c[:, first:last] for c in columns]
        try:
            outputs = call(function, *part)
        except RuntimeError as error:
            if not is_singular(error):
                raise
            if last - first == 1:
                return [np.full((function.size1_out(k), 1), np.nan) for k in range(function.n_out())]
            middle = (first + last) // 2
            halves = results(first, middle), results(middle, last)
            return [np.hstack(pair) for pair in zip(*halves, strict=True)]
        outputs = outputs if isinstance(outputs, tuple | list) else (outputs,)
        return [np.broadcast_to(x.full(), (x.size1(), last - first)) for x in outputs]

    return results(0, count)
