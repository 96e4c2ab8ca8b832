"""Units of expressions, as far as the symbols in them tell."""

import pytest

import mbdcasadi as mbd
from mbdcasadi.model.units import unit_of

BAR, OTHER = mbd.Body("bar", mass=1, inertia=1), mbd.Body("other", mass=1, inertia=1, pose=(1, 0, 0))
PIN = mbd.Revolute("pin", BAR.at(0.5, 0), OTHER.at(-0.5, 0))
SLIDE = mbd.Translational("slide", mbd.ground.at(0, 0), BAR.at(0, 0))
TIP, TAU, FORCE = OTHER.at(0.5, 0.1), mbd.Input("tau", unit="N m"), mbd.Input("F")
LENGTH = mbd.Parameter("l", 1.0)


@pytest.mark.parametrize(
    ("expression", "unit"),
    [
        (BAR.x, "m"),
        (2 - BAR.phi, "rad"),
        (BAR.vx + 1, "m/s"),
        (BAR.alpha, "rad/s²"),
        (TIP.x - 1, "m"),
        (OTHER.at(LENGTH, 0).y, "m"),
        (mbd.norm(TIP.position - BAR.position), "m"),
        ((BAR.x - 2) ** 2 + (BAR.y + 1) ** 2 - 0.09, "m²"),
        (BAR.x / mbd.t, "m/s"),
        (mbd.atan2(TIP.y, TIP.x), "rad"),
        (mbd.fabs(OTHER.phi - BAR.phi) - 0.3, "rad"),
        (mbd.norm(PIN.reaction_on(BAR).force) - 5, "N"),
        (PIN.multipliers[0], "N"),
        (SLIDE.multipliers[1], "N m"),
        (TAU - 3, "N m"),
        (TAU.rate, "N m/s"),
        (mbd.sin(BAR.phi), ""),
        (3 * BAR.x, ""),  # the force of a spring, perhaps
        (BAR.x - LENGTH * OTHER.phi, "m"),
        (FORCE - 3, ""),
        (mbd.sqrt(BAR.x), ""),
    ],
)
def test_units(expression, unit):
    assert unit_of(expression) == unit


def test_long_expressions_are_not_looked_through():
    total = BAR.x
    for k in range(3000):
        total = total + mbd.sin(BAR.phi + k)
    assert unit_of(total) == ""
