"""What compiled code does to the terminal: remarks on standard error, and Ctrl-C."""

from __future__ import annotations

import io
import signal
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr
from typing import Any

from ..errors import MechanismWarning
from .symbolic import LOCK


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
    """Whether Ctrl-C was pressed while compiled code was running."""

    def __init__(self) -> None:
        self.requested = False


@contextmanager
def interruptible(*, raising: bool = True) -> Iterator[Interruption]:
    """Remember Ctrl-C: inside compiled code it comes back as an error that does not say so.

    Parameters
    ----------
    raising : bool, default True
        Whether Python code is interrupted too; else who runs must ask `requested`.
    """
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    previous = signal.getsignal(signal.SIGINT)

    def remember(number: int, frame: Any) -> None:
        interruption.requested = True
        if raising:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, remember)
    try:
        yield interruption
    finally:
        signal.signal(signal.SIGINT, previous)


def call(function: Any, *arguments: Any) -> Any:
    """Call compiled code quietly; Ctrl-C in it comes back as what it is, not as a failure or as nothing."""
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
