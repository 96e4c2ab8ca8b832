"""States that are brought onto the constraints, far beyond what a shift of singular values lets pass at once."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.equations.recovery import Recovery


def chain(links, root, *, pinned):
    """Links of 1 m and 1 kg, each welded, and pinned once more, to the last."""
    bodies = [mbd.Body(f"link {k}", mass=1.0, inertia=1 / 12, pose=(k + 0.5, 0, 0)) for k in range(links)]
    joints = []
    for k, body in enumerate(bodies):
        last, x = (bodies[k - 1], 0.5) if k else (root, 0)
        joints.append(mbd.Weld(f"weld {k}", last.at(x, 0), body.at(-0.5, 0)))
        if pinned:
            joints.append(mbd.Revolute(f"pin {k}", last.at(x, 0.2), body.at(-0.5, 0.2)))
    return bodies, joints


@pytest.mark.slow
@pytest.mark.parametrize(("links", "pinned"), [(60, False), (60, True), (100, False)])
def test_a_cantilever_that_is_turned_comes_back(links, pinned):
    """No pose but the straight one at rest meets the constraints: a step on the way there bends it smoothly."""
    bodies, joints = chain(links, mbd.ground, pinned=pinned)
    numeric = NumericEquations(mbd.equations(mbd.Mechanism(bodies, joints)), np.zeros(0))
    straight, turn = np.concatenate([(k + 0.5, 0, 0) for k in range(links)]), 1e-5
    turned = np.concatenate([((k + 0.5) * np.cos(turn), (k + 0.5) * np.sin(turn), turn) for k in range(links)])
    recovery, rates = Recovery(numeric, redundant=pinned), np.concatenate([(0, k + 0.5, 1) for k in range(links)])
    q = recovery.positions(np.zeros(2), np.array([turned, straight]), np.zeros((2, 0)))
    v = recovery.velocities(np.zeros(2), np.array([straight, straight]), np.array([rates, 0 * rates]), np.zeros((2, 0)))
    assert q == pytest.approx(np.array([straight, straight]), abs=1e-9)
    assert v == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("links", [40, 100])
def test_between_outputs_a_long_chain_turns_with_its_wheel(links):
    """A driven wheel on a cart that bounces carries welded links: all turn by the angle of the driver."""
    cart, wheel = mbd.Body("cart", mass=5.0, inertia=1.0), mbd.Body("wheel", mass=5.0, inertia=5e4)
    bodies, welds = chain(links, wheel, pinned=False)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), cart.at(0, 0, np.pi / 2))
    joints = [guide, mbd.Revolute("axle", cart.at(0, 0), wheel.at(0, 0)), *welds]
    driver = mbd.Driver("driver", wheel.phi, 0.3 * mbd.sin(3 * mbd.t))
    forces = [mbd.Gravity(), mbd.Force("spring", cart.at(0, 0), (0, -1e3 * cart.y))]
    model = mbd.Mechanism([cart, wheel, *bodies], joints, drivers=[driver], forces=forces)
    motion, between = mbd.simulate(model, np.linspace(0, 2, 5), method="dop853"), np.linspace(0.01, 1.99, 23)
    found, tip = motion.at(between), bodies[-1]
    assert found[tip.phi] == pytest.approx(0.3 * np.sin(3 * between), abs=1e-9)
    assert found[tip.omega] == pytest.approx(0.9 * np.cos(3 * between), abs=1e-9)
    assert found[tip.x] == pytest.approx((links - 0.5) * np.cos(found[tip.phi]), abs=1e-7)
