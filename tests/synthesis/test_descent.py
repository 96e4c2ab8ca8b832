"""Descents from random starts."""

from __future__ import annotations

import numpy as np

import mbdcasadi as mbd
from mbdcasadi.synthesis.descent import searched
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
