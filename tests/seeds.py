"""Seeds of random cases: the first 25 in every whole run, the others with ``-m nightly``."""

import pytest

EACH_RUN = 25


def seeds(count, quick=EACH_RUN, without=()):
    """Seeds below a count, for ``parametrize``: those from ``quick`` on are slow, those from 25 on nightly."""
    marks = [()] * quick + [pytest.mark.slow] * (EACH_RUN - quick) + [pytest.mark.nightly] * (count - EACH_RUN)
    return [pytest.param(seed, marks=mark) for seed, mark in enumerate(marks) if seed not in without]
