"""Descents from random starts."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.synthesis.descent import nearness, searched
from mbdcasadi.synthesis.positions import Positions
from mbdcasadi.synthesis.search import SynthesisSearch


def test_a_third_of_the_starts_meet_three_pairs_of_angles():
    """114 of 300; with sizes over 30 decades 72, with ten times the first damping 90, with ten times as many
    iterations on poses alone 101, and with a damping that rises after each step none."""
    model = mbd.library.four_bar(0.5, 1.0, 0.9, 1.1, point=(0.1, 0.3), free=True)
    u = model.unknowns
    held = [u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == 1.1, u["Dy"] == 0]
    held += [mbd.atan2(u["By"], u["Bx"]) == 1.2, mbd.atan2(u["Cy"], u["Cx"] - 1.1) == 1.9]
    pairs = np.radians([(0, 0), (20, 25), (50, 45)])
    positions = [[model.crank.phi == i, model.rocker.phi == o] for i, o in pairs]
    pins = [u[name + axis] for name in "ADBC" for axis in "xy"]
    search = SynthesisSearch(
        Positions(model.mechanism, pins, positions, held, exact=True), exact=True, symmetries=[], seed=0
    )
    met = searched(search.residuals, search.range, 300, (0, 0), None, np.inf)[1]
    assert len(met) > 106 and np.allclose(met, met[0], rtol=1e-6)


@pytest.mark.slow
def test_linkages_of_which_a_bar_vanishes_are_not_the_nearest():
    """The sums of squares of their open joints are 1e-10, and 0.5 once these close; an ordinary one misses 7e-4."""
    model = mbd.library.four_bar(0.3, 1.0, 0.8, 1.0, point=(0.0, 0.3), free=True)
    turn = np.linspace(0, 2 * np.pi, 13)[:-1]
    oval = np.column_stack([0.6 + 0.3 * np.cos(turn), 0.9 + 0.15 * np.sin(turn) + 0.03 * np.sin(3 * turn)])
    positions = [[model.point.position == place] for place in oval]
    problem = Positions(model.mechanism, list(model.unknowns.values()), positions, [], exact=False)
    search = SynthesisSearch(problem, exact=False, symmetries=[], seed=0)
    y, p, value = searched(search.residuals, search.range, 400, (0, 0), search._coarse(), np.inf)
    order = np.argsort(nearness(search.residuals, p, value))[:10]
    assert np.median(search.residuals.shortest(p[order])) > 0.1
    found = [search.solving.nearest(y[k], p[k]) for k in order]
    assert min(np.sum((one.rows / search.solving.row_sizes) ** 2) for one in found if one is not None) < 2e-3
