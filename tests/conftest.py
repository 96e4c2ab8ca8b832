"""What all tests share: the helpers beside this file can be imported from any test."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


def pytest_configure(config):
    """Make the marker of long tests known, so that ``-m "not slow"`` leaves them out."""
    config.addinivalue_line("markers", "slow: takes more than a second or so")
