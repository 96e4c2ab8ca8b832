"""Ctrl-C at some instant of an analysis."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Sequence
from typing import Any

import mbdcasadi as mbd


def interrupted(
    analysis: Callable[[], Any],
    delays: Sequence[float] = (1.0, 4.0, 16.0, 64.0),
    enough: Callable[[mbd.Interrupted], bool] = lambda _: True,
) -> mbd.Interrupted:
    """Return the exception of an analysis that takes long and is stopped by Ctrl-C.

    A busy machine may not have begun within the first delay: then it is stopped again, later.
    """
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
