"""A disk that is full, for the tests of what is written."""

import signal
import sys
from contextlib import contextmanager

import pytest


@contextmanager
def full_disk(size=2048):
    """No file grows beyond a size; writing more fails as on a full disk."""
    resource = pytest.importorskip("resource", reason="limits of files as on POSIX")

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    # Python would keep the compiled modules that it imports meanwhile, cut short, and fail on them ever after
    keeps_none, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = keeps_none
        signal.signal(signal.SIGXFSZ, handler)
