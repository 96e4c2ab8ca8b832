"""Units of tests are compiled quickly rather than well."""

import pytest

from mbdcasadi.fmu import sources


@pytest.fixture(scope="session", autouse=True)
def quick_compiler():
    """Compile without optimisation."""
    before = dict(sources.OPTIMISATION)
    sources.OPTIMISATION.update({name: "-O0" for name in before})
    yield
    sources.OPTIMISATION.update(before)
