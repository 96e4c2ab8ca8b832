"""Ctrl-C at some instant of an analysis."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any

import pytest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.solve.solvers.ipopt import SolverCallback


def interrupted(
    analysis: Callable[[], Any],
    delays: Sequence[float] = (1.0, 4.0, 16.0, 64.0),
    enough: Callable[[mbd.Interrupted], bool] = lambda _: True,
) -> mbd.Interrupted:
    """Return the exception of an analysis that takes long and is stopped by Ctrl-C.

    A busy machine may not have begun within the first delay: then it is stopped again, later.
    """
    if os.name != "posix":  # os.kill ends the process there
        pytest.skip("signals as on POSIX")
    for delay in delays:
        timer = threading.Timer(delay, os.kill, (os.getpid(), signal.SIGINT))
        try:
            timer.start()
            analysis()
        except mbd.Interrupted as caught:
            if enough(caught):
                return caught
        except KeyboardInterrupt:  # before the analysis
            continue
        else:
            raise AssertionError("the analysis ended before Ctrl-C")
        finally:
            timer.cancel()
    raise AssertionError("nothing was computed before Ctrl-C")


def interrupted_in(
    monkeypatch: pytest.MonkeyPatch, number: int, call: Callable[[], Any], owner: type, method: str = "solve"
) -> mbd.Interrupted:
    """Return the exception of a search with Ctrl-C in the second iteration of its n-th solve, counted from zero.

    A solve is what a method of the owner does once.
    """
    solves: list[int] = []
    original, solve = SolverCallback.eval_buffer, getattr(owner, method)

    def counting(self: Any, *arguments: Any, **named: Any) -> Any:
        solves.append(0)
        return solve(self, *arguments, **named)

    def pressing(self: Any, *arguments: Any) -> Any:
        solves[-1] += 1
        if len(solves) == number + 1 and solves[-1] == 2:
            signal.raise_signal(signal.SIGINT)
        return original(self, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(owner, method, counting)
        patched.setattr(SolverCallback, "eval_buffer", pressing)
        with pytest.raises(mbd.Interrupted) as caught:
            call()
    assert len(solves) == number + 1, "nothing is solved after Ctrl-C"
    return caught.value
