"""What all tests share: the helpers beside this file can be imported from any test."""

import signal
import sys
from pathlib import Path

import pytest

from mbdcasadi import SimulationError
from mbdcasadi.integrators.native import build

#: Decided before any test changes the environment.
HAS_COMPILER = build.compiler() is not None

sys.path.insert(0, str(Path(__file__).parent))

# a job in the background of a shell ignores Ctrl-C, and so would the tests of what Ctrl-C does
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(config, items):
    """Leave out nightly tests, unless ``-m`` speaks of them."""
    if "nightly" not in config.option.markexpr:
        nightly = [item for item in items if item.get_closest_marker("nightly")]
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Skip what a method in C refuses on a machine without a C compiler."""
    try:
        return (yield)
    except SimulationError as error:
        if HAS_COMPILER or "runs in C alone" not in str(error):
            raise
        pytest.skip("no C compiler")
