"""Functions of positions, compiled or not."""

from __future__ import annotations

import pickle

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.integrators.native import build
from mbdcasadi.synthesis.points import PointFunction


@pytest.mark.parametrize("compiled", [True, False])
def test_results_are_summed_over_the_positions_of_a_start(compiled, monkeypatch):
    """Arguments for each start, each position, or both; sums come first."""
    if not compiled:
        monkeypatch.setattr(build, "compiler", lambda: None)
    elif build.compiler() is None:
        pytest.skip("there is no C compiler")
    x, p, c = ca.SX.sym("x", 2), ca.SX.sym("p"), ca.SX.sym("c")
    function = PointFunction(ca.Function("f", [x, p, c], [ca.vertcat(x[0] * p, ca.sin(c), x[1] + p)]), summed=2)
    random = np.random.default_rng(0)
    xs, ps, cs = random.normal(size=(4, 3, 2)), random.normal(size=(4, 1, 1)), random.normal(size=(1, 3, 1))
    for one in (function, pickle.loads(pickle.dumps(function))):
        sums, rest = one(xs, ps, cs)
        assert np.allclose(sums[:, 0], np.sum(xs[..., 0], axis=1) * ps[:, 0, 0], rtol=1e-14)
        assert np.allclose(sums[:, 1], np.sum(np.sin(cs)), rtol=1e-14)
        assert np.allclose(rest, xs[..., 1:] + ps, rtol=1e-14)
