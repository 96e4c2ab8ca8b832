"""Flow through orifices: Bernoulli's law, the laminar slope at zero, a load that is let down."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd


def test_turbulent_and_laminar():
    """``±Cd A √(2 |Δp|/ρ)`` far from zero, ``Cd A √(2/(ρ Δp_t)) Δp`` about it; derivatives are finite."""
    full = 0.62 * 3e-6 * np.sqrt(2 * 1e6 / 860)
    for sense in (1, -1):
        assert mbd.orifice_flow(3e-6, sense * 1e6, 1e3) == pytest.approx(sense * full, rel=3e-7)
    assert mbd.orifice_flow(3e-6, 0.0, 1e3) == 0
    p = ca.SX.sym("p")
    slope, bend = (ca.Function("f", [p], [f]) for f in ca.hessian(mbd.orifice_flow(3e-6, p, 1e3), p)[::-1])
    assert float(slope(0)) == pytest.approx(0.62 * 3e-6 * np.sqrt(2 / 860 / 1e3)) and float(bend(0)) == 0


def test_a_load_is_let_down():
    """Oil leaves by one hole and enters by another: ``m g = ρ/2 v² (A³/(Cd a)² + A_r³/(Cd a_r)²)``."""
    area, rod_area, holes, mass = np.pi / 4 * 0.05**2, np.pi / 4 * (0.05**2 - 0.02**2), (2e-6, 4e-6), 200.0
    p, p_rod = mbd.StateVariable("p", 1e6), mbd.StateVariable("p_rod", 0.0)
    load = mbd.Body("load", mass, 1.0, pose=(0, 0.5, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), load.at(0, 0, np.pi / 2))
    out, back = (mbd.orifice_flow(a, drop, 1e3) for a, drop in zip(holes, (p, p_rod), strict=True))
    ram = mbd.HydraulicCylinder(
        "ram", mbd.ground.at(0, 0), load.at(0, 0), 0.05, 0.02, 0.5, 2e-4, -out, -back, pressures=(p, p_rod)
    )
    run = mbd.simulate(mbd.Mechanism([load], [guide], forces=[mbd.Gravity(), ram]), [0, 1.0])
    drag = 860 / 2 * (area**3 / (0.62 * holes[0]) ** 2 + rod_area**3 / (0.62 * holes[1]) ** 2)
    assert run.final[load.vy] == pytest.approx(-np.sqrt(mass * 9.81 / drag), rel=1e-4)


def test_out_of_limits():
    """Errors name the number."""
    for numbers, said in (((-1e-6, 1e5, 1e3), "area"), ((1e-6, 1e5, 0.0), "transition"), ((1e-6, 1e5, 1.0, 0), "dens")):
        with pytest.raises(mbd.ModelError, match=f"orifice_flow: {said}"):
            mbd.orifice_flow(*numbers)
