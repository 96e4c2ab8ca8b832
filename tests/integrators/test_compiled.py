"""Pieces that fail as a whole and are repeated in parts."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.integrators.compiled import CompiledIntegrator

LENGTHS = 0.5, 0.4, 0.4, 1.0


def locking_linkage() -> mbd.Mechanism:
    """A four-bar whose driven crank moves away until coupler and rocker are in line."""
    poses = (0.25, 0, 0), (0.65, 0.2, 0.5), (1.0, 0.2, 1.5)
    crank, coupler, rocker = (
        mbd.Body(name, 1.0, 0.01, pose=pose) for name, pose in zip(("crank", "coupler", "rocker"), poses, strict=True)
    )
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.25, 0)),
        mbd.Revolute("B", crank.at(0.25, 0), coupler.at(-0.2, 0)),
        mbd.Revolute("C", coupler.at(0.2, 0), rocker.at(0.2, 0)),
        mbd.Revolute("D", mbd.ground.at(1.0, 0), rocker.at(-0.2, 0)),
    ]
    turn = mbd.Driver("turn", joints[0].angle, 0.3 + 4 * mbd.t)
    return mbd.Mechanism([crank, coupler, rocker], joints=joints, drivers=[turn], forces=[mbd.Gravity()])


@pytest.mark.parametrize("outputs", [11, 401])
def test_lock_up_is_found_in_few_steps(outputs, monkeypatch):
    allowed, attempt = [], CompiledIntegrator._attempt

    def counted(self, problem, steps):
        allowed.append(steps)
        return attempt(self, problem, steps)

    monkeypatch.setattr(CompiledIntegrator, "_attempt", counted)
    with pytest.raises(mbd.SimulationError, match="lock-up") as caught:
        mbd.simulate(locking_linkage(), np.linspace(0, 1, outputs))
    crank, coupler, rocker, base = LENGTHS
    locked = np.arccos((crank**2 + base**2 - (coupler + rocker) ** 2) / (2 * crank * base))
    assert caught.value.time == pytest.approx((locked - 0.3) / 4, abs=1e-5)
    assert sum(allowed) < 60_000


@pytest.mark.slow
def test_many_steps_between_two_outputs_are_taken():
    """Some 40 000 steps, and no failure: x = cos ω t."""
    body, omega = mbd.Body("body", 1.0, 1.0, pose=(1, 0, 0)), 100.0
    spring = mbd.GeneralizedForce("spring", [(body.x, -(omega**2) * body.x)])
    motion = mbd.simulate(mbd.Mechanism([body], forces=[spring]), [0.0, 30.0], method="idas")
    assert motion.statistics.steps > 20_000
    assert motion.final[body.x] == pytest.approx(np.cos(omega * 30.0), abs=2e-4)
