"""Elements of users: names of their attributes, and attributes that do not exist."""

import inspect

import numpy as np
import pytest

import mbdcasadi as mbd


class Beam(mbd.Element):
    """A spring whose class uses words that mean something else elsewhere."""

    kind = "beam"

    def __init__(self, name, a, b):
        super().__init__(name)
        self.markers, self.modes, self.gap, self.gaps, self.apart = (a, b), 3, 0.1, [0.1], "far"
        self.likeness, self.velocity_tolerance, self.deflection_tolerance = "steel", 1e-12, 1e-15
        self.is_lower_pair, self.least_stiffness = True, None
        length = mbd.distance(a, b)
        self.virtual_work = ((length, -100.0 * (length - 1.0)),)


def test_attributes_of_a_users_element_mean_nothing_to_a_run():
    body = mbd.Body("b", mass=1, inertia=0.1, pose=(1.2, 0, 0))
    twin = mbd.Body("c", mass=1, inertia=0.1, pose=(1.1, 1, 0))
    beams = [Beam("k", mbd.ground.at(0, 0), body.at(0, 0)), Beam("l", mbd.ground.at(0, 1), twin.at(0, 0))]
    motion = mbd.simulate(mbd.Mechanism([body, twin], forces=beams), duration=1.0)
    assert motion.final[body.x] == pytest.approx(1 + 0.2 * np.cos(10.0), abs=1e-5)
    assert motion.final[twin.x] == pytest.approx(1 + 0.1 * np.cos(10.0), abs=1e-5)
    assert not motion.statistics.notes


@pytest.mark.parametrize("law", [mbd.Coulomb(0.1, 1e-3), mbd.DryFriction(0.1)], ids=["smoothed", "dry"])
def test_what_friction_does_not_have_is_an_attribute_that_is_missing(law):
    body = mbd.Body("b", 1, 1)
    pin, guide = (joint("j", mbd.ground.at(0, 0), body.at(0, 0)) for joint in (mbd.Revolute, mbd.Translational))
    turning, sliding = mbd.JointFriction("f", pin, law, radius=0.01), mbd.JointFriction("g", guide, law)
    assert not hasattr(turning, "force") and hasattr(turning, "torque")
    assert not hasattr(sliding, "torque") and hasattr(sliding, "force")
    assert "power" in dict(inspect.getmembers(turning))
    with pytest.raises(mbd.ModelError, match="friction 'f' acts by a couple: use .torque"):
        _ = turning.force
