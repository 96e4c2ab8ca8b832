"""Check of models: counts, redundancy, contradictions, singular poses, unused and massless bodies."""

from __future__ import annotations

import numpy as np
import pytest
from linkages import four_bar, pendulum, slider_crank
from random_mechanisms import random_case
from seeds import seeds

import mbdcasadi as mbd


def box(name="box", mass=1.0, inertia=1.0, pose=(0.0, 0.0, 0.0)):
    """A body."""
    return mbd.Body(name, mass=mass, inertia=inertia, pose=pose)


def parallelogram(angle=1.0, height=0.0):
    """Three parallel cranks of 1 m on one coupler; the third foot may be too high."""
    c, s = np.cos(angle), np.sin(angle)
    cranks = [box(f"crank {k}", pose=(k + c / 2, s / 2, angle)) for k in range(3)]
    coupler = box("coupler", pose=(1 + c, s, 0))
    joints = [
        mbd.Revolute(f"foot {k}", mbd.ground.at(k, height * (k == 2)), b.at(-0.5, 0)) for k, b in enumerate(cranks)
    ]
    joints += [mbd.Revolute(f"head {k}", b.at(0.5, 0), coupler.at(k - 1, 0)) for k, b in enumerate(cranks)]
    return mbd.Mechanism(bodies=[*cranks, coupler], joints=joints)


def quick_return():
    """Crank, die block and slotted arm."""
    crank, block, arm = box("crank"), box("block", pose=(0.1, 0, 1.2)), box("arm", pose=(0, -0.25, 1.2))
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0)),
        mbd.Revolute("die pin", crank.at(0.1, 0), block.at(0, 0)),
        mbd.Translational("slide", arm.at(0, 0), block.at(0, 0)),
        mbd.Revolute("pivot", mbd.ground.at(0, -0.25), arm.at(0, 0)),
    ]
    return mbd.Mechanism(bodies=[crank, block, arm], joints=joints)


def watt():
    """Watt's six-bar: two loops, seven joints."""
    f = four_bar(0.5)
    link, last = box("link", pose=(0.4, 0.6, 0.3)), box("last", pose=(0.9, 0.4, 1.2))
    joints = [
        *f.mechanism.joints,
        mbd.Revolute("E", f.coupler.at(0.1, 0.15), link.at(-0.2, 0)),
        mbd.Revolute("F", link.at(0.3, 0), last.at(0.3, 0)),
        mbd.Revolute("G", mbd.ground.at(0.9, 0), last.at(-0.3, 0)),
    ]
    return mbd.Mechanism(bodies=[*f.mechanism.bodies, link, last], joints=joints)


def rack_and_pinion():
    """A rack in its guide, a pinion on its hub."""
    rack, pinion = box("rack"), box("pinion", pose=(0, 0.06, 0))
    joints = [
        mbd.Translational("guide", mbd.ground.at(0, 0), rack.at(0, 0)),
        mbd.Revolute("hub", mbd.ground.at(0, 0.06), pinion.at(0, 0)),
        mbd.RackAndPinion("mesh", rack.at(0, 0), pinion.at(0, 0), radius=0.06),
    ]
    return mbd.Mechanism(bodies=[rack, pinion], joints=joints)


def link_instead_of_a_body():
    """Two cranks joined by a distance: a four-bar with a massless coupler."""
    crank, rocker = box("crank", pose=(0.5, 0.5, 1.0)), box("rocker", pose=(2.5, 0.5, 1.2))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.5, 0)),
        mbd.Revolute("D", mbd.ground.at(2, 0), rocker.at(-0.5, 0)),
        mbd.Distance("coupler", crank.at(0.5, 0), rocker.at(0.5, 0), 2.1),
    ]
    return mbd.Mechanism(bodies=[crank, rocker], joints=joints)


def truss():
    """A triangle of rods: no freedom."""
    bars = [box("base", pose=(0.5, 0, 0)), box("left", pose=(0.25, 0.4, 1.0)), box("right", pose=(0.75, 0.4, -1.0))]
    base, left, right = bars
    joints = [
        mbd.Weld("floor", mbd.ground.at(0.5, 0), base.at(0, 0)),
        mbd.Revolute("A", base.at(-0.5, 0), left.at(-0.5, 0)),
        mbd.Revolute("B", base.at(0.5, 0), right.at(0.5, 0)),
        mbd.Revolute("C", left.at(0.5, 0), right.at(-0.5, 0)),
    ]
    return mbd.Mechanism(bodies=bars, joints=joints)


# --- counts ------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("mechanism", "freedom"),
    [
        (lambda: mbd.Mechanism(bodies=[box()]), 3),
        (lambda: pendulum().mechanism, 1),
        (lambda: four_bar(0.5).mechanism, 1),
        (lambda: slider_crank(0.5).mechanism, 1),
        (quick_return, 1),
        (watt, 1),
        (rack_and_pinion, 1),
        (link_instead_of_a_body, 1),
        (truss, 0),
        (lambda: four_bar(0.5, drivers=lambda f: [mbd.Driver("drive", f.A.angle, 0.5 + mbd.t)]).mechanism, 0),
    ],
)
def test_textbook_mechanisms(mechanism, freedom):
    """Grübler's count is right for them, and nothing is found amiss."""
    report = mbd.check(mechanism())
    assert report.degrees_of_freedom == report.gruebler == freedom == report.coordinates - report.rows
    assert report.redundant_rows == 0 and report.redundant == report.not_unique == ()
    assert report.ok and report.singular == "" and report.contradictory == ()


@pytest.mark.parametrize("seed", seeds(60))
def test_random_mechanisms(seed):
    """The freedom and the redundancy of mechanisms for which both are known."""
    case = random_case(seed)
    report = mbd.check(case.mechanism)
    assert report.degrees_of_freedom == case.degrees_of_freedom
    assert report.redundant_rows == case.redundant == len(report.redundant)
    assert report.ok


# --- redundancy -----------------------------------------------------------------------------------------
def test_redundant_parallelogram():
    """One row too many, though it moves: which may go, which reactions are not unique."""
    report = mbd.check(parallelogram())
    assert report.degrees_of_freedom == 1 and report.gruebler == 0
    assert report.redundant_rows == 1 and len(report.redundant) == 1
    assert set(report.redundant) <= set(report.dependent)
    assert set(report.not_unique) <= {f"{end} {k}" for end in ("foot", "head") for k in range(3)}
    assert len(report.not_unique) >= 3
    assert report.ok
    # without the row that is named the count is right
    text = str(report)
    assert report.redundant[0] in text and "not unique" in text


def test_two_guides_in_line():
    """A block in two guides: two rows too many, both guides named."""
    block = box()
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(k, 0), block.at(k, 0)) for k in range(2)]
    report = mbd.check(mbd.Mechanism(bodies=[block], joints=guides))
    assert report.degrees_of_freedom == 1 and report.redundant_rows == 2
    assert set(report.not_unique) == {"guide 0", "guide 1"}
    assert all(name.startswith("guide") for name in report.redundant)


def test_redundant_rows_of_a_part():
    """Only the joints that take part in it are named, not those of a linkage beside."""
    f = four_bar(0.5)
    block = box("block", pose=(5, 5, 0))
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(5 + k, 5), block.at(k, 0)) for k in range(2)]
    mechanism = mbd.Mechanism(bodies=[*f.mechanism.bodies, block], joints=[*f.mechanism.joints, *guides])
    assert set(mbd.check(mechanism).not_unique) == {"guide 0", "guide 1"}


def test_two_drivers_of_one_angle():
    """A driver too many is redundant where they agree."""
    f = four_bar(0.5, drivers=lambda f: [mbd.Driver("one", f.A.angle, 0.5), mbd.Driver("two", f.crank.phi, 0.5)])
    report = mbd.check(f.mechanism)
    assert report.degrees_of_freedom == 0 and report.redundant_rows == 1
    assert {"one", "two"} <= set(report.not_unique)


def test_redundant_in_the_small_and_in_the_large():
    """Lengths of millimetres or kilometres do not change the counts."""
    for scale in (1e-3, 1e3):
        cranks = [box(f"crank {k}", pose=(scale * (k + 0.3), scale * 0.4, 0.9)) for k in range(3)]
        coupler = box("coupler", pose=(scale * 1.6, scale * 0.8, 0.0))
        joints = [
            mbd.Revolute(f"foot {k}", mbd.ground.at(scale * k, 0), b.at(-scale / 2, 0)) for k, b in enumerate(cranks)
        ]
        joints += [
            mbd.Revolute(f"head {k}", b.at(scale / 2, 0), coupler.at(scale * (k - 1), 0)) for k, b in enumerate(cranks)
        ]
        report = mbd.check(mbd.Mechanism(bodies=[*cranks, coupler], joints=joints))
        assert (report.degrees_of_freedom, report.redundant_rows) == (1, 1)
        f = four_bar(0.5, [scale * x for x in (0.2, 0.5, 0.4, 0.55)])
        assert mbd.check(f.mechanism).degrees_of_freedom == 1


# --- contradictions ----------------------------------------------------------------------------------------
def test_contradictory_rows():
    """Two drivers that want different angles: both rows, and what stays open."""
    f = four_bar(0.5, drivers=lambda f: [mbd.Driver("one", f.A.angle, 0.5), mbd.Driver("two", f.A.angle, 0.7)])
    report = mbd.check(f.mechanism)
    assert not report.ok
    assert {"one", "two"} <= {row.split(".")[0] for row in report.contradictory}
    assert report.residuals and max(report.residuals.values()) <= 0.2
    assert "contradictory" in str(report)


def test_velocities_that_contradict():
    """Positions that agree at the start with velocities that do not, of drivers and of velocity-level rows."""
    block = box()
    turn = mbd.Driver("one", block.phi, mbd.t), mbd.Driver("two", 3 * block.phi, 2 * mbd.t)
    assert mbd.check(mbd.Mechanism([block], drivers=turn)).contradictory == ("one", "two")
    slow = mbd.NonholonomicConstraint("slow", [block.vx, block.vy, block.vx - 1])
    report = mbd.check(mbd.Mechanism([block], [slow]))
    assert report.contradictory == ("slow.0", "slow.2") and not report.ok
    guided = mbd.AbsoluteX("rail", block.at(0, 0), 0.0)
    assert mbd.check(mbd.Mechanism([block], [guided, slow])).contradictory == ("rail", "slow.0", "slow.2")


def test_velocities_that_agree_are_redundant():
    """The same rows with sides of other sizes."""
    block = box()
    turn = mbd.Driver("one", block.phi, mbd.t), mbd.Driver("two", 300 * block.phi, 300 * mbd.t)
    slow = mbd.NonholonomicConstraint("slow", [block.vx - 1, 1e-3 * block.vx - 1e-3])
    report = mbd.check(mbd.Mechanism([block], [slow], turn))
    assert report.ok and report.contradictory == () and report.redundant_rows == 2


def test_a_linkage_that_does_not_close():
    """Bars too short: the open joints with their gaps, no exception."""
    f = four_bar(0.5)
    joints = [f.A, f.B, f.C, mbd.Revolute("far", mbd.ground.at(3, 0), f.rocker.at(-0.2, 0))]
    report = mbd.check(mbd.Mechanism(bodies=f.mechanism.bodies, joints=joints))
    assert not report.ok and report.residuals
    assert set(report.residuals) <= {"A", "B", "C", "far"}
    assert "left open" in str(report)


# --- singular poses ------------------------------------------------------------------------------------------
def equal_slider_crank(angle):
    """Crank and rod of one length: at 90 degrees the slider may part from the crank."""
    f = slider_crank(angle, 0.3, 0.3, rod=(1.0, 0.02, 0.15))
    return f


def test_bifurcation():
    """Rank is lost in this pose alone: one freedom, one more in the pose, and nothing redundant."""
    f = equal_slider_crank(np.pi / 2)
    state = mbd.assemble(f.mechanism, [f.A.angle == np.pi / 2])
    report = mbd.check(f.mechanism, state)
    assert report.degrees_of_freedom == 1 and report.redundant_rows == 0 and report.redundant == ()
    assert report.singular == "bifurcation" and not report.ok
    assert report.singular_rows and "bifurcation" in str(report)
    elsewhere = mbd.check(f.mechanism, mbd.assemble(f.mechanism, [f.A.angle == 1.0]))
    assert elsewhere.singular == "" and elsewhere.ok


def test_lock_up():
    """A slider driven in its dead point: the driver is among the rows."""
    f = slider_crank(0.0, drivers=lambda f: [mbd.Driver("push", f.slider.x, 0.6 - 0.2 * mbd.t)])
    report = mbd.check(f.mechanism)
    assert report.singular == "lock-up" and not report.ok
    assert any(row.startswith("push") for row in report.singular_rows)
    assert report.degrees_of_freedom == 0 and report.redundant_rows == 0


def test_flat_parallelogram():
    """Flat, with the crank driven: a bifurcation, where several motions go on."""
    bodies = [box("left", pose=(0.5, 0, 0)), box("top", pose=(1.5, 0, 0)), box("right", pose=(1.5, 0, 0))]
    left, top, right = bodies
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), left.at(-0.5, 0)),
        mbd.Revolute("B", left.at(0.5, 0), top.at(-0.5, 0)),
        mbd.Revolute("C", top.at(0.5, 0), right.at(0.5, 0)),
        mbd.Revolute("D", mbd.ground.at(1, 0), right.at(-0.5, 0)),
    ]
    report = mbd.check(
        mbd.Mechanism(bodies=bodies, joints=joints, drivers=[mbd.Driver("drive", left.phi, 0.5 * mbd.t)])
    )
    assert report.singular == "bifurcation"
    assert report.degrees_of_freedom == 0 and report.redundant_rows == 0


def test_at_a_state():
    """The pose of a simulation may be looked at."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    final = mbd.simulate(f.mechanism, duration=0.2).final
    assert mbd.check(f.mechanism, final).ok


def test_parameters():
    """A length given in the call decides whether the linkage closes."""
    base = mbd.Parameter("base", 0.55)
    f = four_bar(0.5)
    joints = [f.A, f.B, f.C, mbd.Revolute("far", mbd.ground.at(base, 0), f.rocker.at(-0.2, 0))]
    mechanism = mbd.Mechanism(bodies=f.mechanism.bodies, joints=joints, parameters=[base])
    assert mbd.check(mechanism).ok
    assert not mbd.check(mechanism, parameters={base: 3.0}).ok


# --- bodies -----------------------------------------------------------------------------------------------------
def test_unused_body():
    """What no joint holds and no force but gravity acts on is named; what a spring holds is in use."""
    f = four_bar(0.5)
    idle, held = box("idle", pose=(3, 3, 0)), box("held", pose=(4, 4, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(4, 5), held.at(0, 0), stiffness=10)
    mechanism = mbd.Mechanism(
        bodies=[*f.mechanism.bodies, idle, held], joints=f.mechanism.joints, forces=[mbd.Gravity(), spring]
    )
    report = mbd.check(mechanism)
    assert report.unused_bodies == ("idle",)
    assert "idle" in str(report)
    assert mbd.check(f.mechanism).unused_bodies == ()


def test_unused_body_among_two():
    """Also where the forces reach every body of the mechanism."""
    first, idle = box("first"), box("idle", pose=(1, 0, 0))
    push = mbd.Force("push", first.at(0, 0), (1, 0))
    report = mbd.check(mbd.Mechanism(bodies=[first, idle], forces=[mbd.Gravity(), push]))
    assert report.unused_bodies == ("idle",)


def test_massless_bodies():
    """A point mass held by its joint is in order; a link without inertia that turns freely is not."""
    bob = mbd.Body("bob", mass=1.0, inertia=0.0, pose=(1, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-1, 0))
    assert mbd.check(mbd.Mechanism(bodies=[bob], joints=[pin])).ok
    centred = mbd.Revolute("pin", mbd.ground.at(1, 0), bob.at(0, 0))
    report = mbd.check(mbd.Mechanism(bodies=[bob], joints=[centred]))
    assert report.without_mass == ("bob.phi",) and not report.ok
    ghost = mbd.Body("ghost", mass=0.0, inertia=0.0)
    report = mbd.check(mbd.Mechanism(bodies=[ghost]))
    assert set(report.without_mass) == {"ghost.x", "ghost.y", "ghost.phi"}
    assert "ghost.phi" in str(report)


# --- printing -------------------------------------------------------------------------------------------------------
def test_prints_a_table():
    """One line for each finding, aligned; only what was found."""
    lines = str(mbd.check(four_bar(0.5).mechanism)).splitlines()
    assert len(lines) == 3
    assert "9 coordinates - 8 rows = 1" in lines[1]
    columns = [line.index("  ") for line in lines]
    values = [len(line) - len(line[k:].lstrip()) for line, k in zip(lines, columns, strict=True)]
    assert len(set(values)) == 1
    assert "redundant rows" in lines[2] and lines[2].rstrip().endswith("0")
    report = mbd.check(parallelogram())
    assert len(str(report).splitlines()) == 5


def test_refuses_what_is_no_mechanism():
    """Said so."""
    with pytest.raises(mbd.MechanismError, match="Mechanism"):
        mbd.check("four-bar")
