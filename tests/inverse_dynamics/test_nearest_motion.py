"""Motions that are measured: more markers than degrees of freedom, and noise."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import mbdcasadi as mbd

TIMES = np.linspace(0, 1.5, 76)


def noise(*shape):
    return np.random.default_rng(7).standard_normal(shape)


class Leg:
    """Thigh and shank with hip and knee torques, and four markers; swings in closed form."""

    lengths, masses, inertias = (0.42, 0.44), (8.0, 3.5), (0.13, 0.06)

    def __init__(self):
        l1, l2 = self.lengths
        thigh = mbd.Body("thigh", mass=self.masses[0], inertia=self.inertias[0], pose=(0, -l1 / 2, -np.pi / 2))
        shank = mbd.Body("shank", mass=self.masses[1], inertia=self.inertias[1], pose=(0, -l1 - l2 / 2, -np.pi / 2))
        hip = mbd.Revolute("hip", mbd.ground.at(0, 0), thigh.at(-l1 / 2, 0))
        knee = mbd.Revolute("knee", thigh.at(l1 / 2, 0), shank.at(-l2 / 2, 0))
        self.thigh, self.shank = thigh, shank
        self.torques = [mbd.Input("hip torque"), mbd.Input("knee torque")]
        forces = [
            mbd.Gravity(),
            mbd.Torque("hip muscle", thigh, self.torques[0]),
            mbd.Torque("knee muscle", shank, self.torques[1], opposite=thigh),
        ]
        self.model = mbd.Mechanism([thigh, shank], [hip, knee], forces=forces, inputs=self.torques)
        self.points = [thigh.at(0.05, 0.04), thigh.at(0.2, -0.03), shank.at(-0.1, 0.03), shank.at(0.22, 0)]
        self.markers = [component for p in self.points for component in (p.x, p.y)]
        self.angles = [
            (-np.pi / 2 + 0.5 * np.sin(4 * TIMES), 2 * np.cos(4 * TIMES), -8 * np.sin(4 * TIMES)),
            (-np.pi / 2 + 0.3 * np.sin(5 * TIMES), 1.5 * np.cos(5 * TIMES), -7.5 * np.sin(5 * TIMES)),
        ]

    def samples(self):
        """Coordinates of the markers (8, n)."""
        (a, *_), (b, *_), l1, l2 = *self.angles, *self.lengths
        bases = [(0.05 + l1 / 2, 0.04, a), (0.2 + l1 / 2, -0.03, a), (-0.1 + l2 / 2, 0.03, b), (0.22 + l2 / 2, 0, b)]
        rows = []
        for k, (x, y, phi) in enumerate(bases):
            knee = (k > 1) * l1
            rows.append(knee * np.cos(a) + x * np.cos(phi) - y * np.sin(phi))
            rows.append(knee * np.sin(a) + x * np.sin(phi) + y * np.cos(phi))
        return np.array(rows)

    def torques_in_closed_form(self):
        """Lagrange's equations of the double pendulum in absolute angles; the knee's torque acts between the two."""
        (a, da, dda), (b, db, ddb) = self.angles
        (l1, l2), (m1, m2), (j1, j2), g = self.lengths, self.masses, self.inertias, 9.81
        coupling = m2 * l1 * l2 / 2
        of_a = (j1 + m1 * l1**2 / 4 + m2 * l1**2) * dda + coupling * (np.cos(a - b) * ddb + np.sin(a - b) * db**2)
        of_b = (j2 + m2 * l2**2 / 4) * ddb + coupling * (np.cos(a - b) * dda - np.sin(a - b) * da**2)
        of_a += g * np.cos(a) * l1 * (m1 / 2 + m2)
        of_b += g * np.cos(b) * l2 / 2 * m2
        return np.array([of_a + of_b, of_b])

    def run(self, courses, **options):
        motion = list(zip(self.markers, courses, strict=True))
        return mbd.inverse_dynamics(self.model, TIMES, motion=motion, efforts=self.torques, **options)


@pytest.fixture(scope="module")
def leg():
    return Leg()


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


@pytest.mark.slow
def test_markers_without_noise_give_the_motion(leg):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = leg.run(leg.samples())
    for torque, wanted in zip(leg.torques, leg.torques_in_closed_form(), strict=True):
        np.testing.assert_allclose(run[torque], wanted, atol=1e-3 * np.max(np.abs(wanted)))
    assert "the motion is the nearest one" in run.statistics.notes[0]


@pytest.mark.slow
def test_noise_is_remarked_and_smoothed_away(leg):
    """Of 1 mm the torques of samples would be many times what they are."""
    samples = leg.samples() + 1e-3 * noise(8, TIMES.size)
    wanted = leg.torques_in_closed_form()
    with pytest.warns(mbd.MechanismWarning, match=r"noise in the samples.*torque' would change by .*smoothing_spline"):
        raw = leg.run(samples)
    assert rms(raw[leg.torques[0]] - wanted[0]) > 2 * rms(wanted[0])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        smooth = leg.run([mbd.smoothing_spline(TIMES, course, cutoff=4) for course in samples])
    inner = slice(6, -6)
    for torque, course in zip(leg.torques, wanted, strict=True):
        assert rms((smooth[torque] - course)[inner]) < 0.1 * rms(course)
    note = smooth.statistics.notes[0].split("squares of ")[1].removesuffix(" (m or rad)")
    missed = [float(size) for size in note.split(", ")]
    assert len(missed) == 8 and all(0 < miss < 1e-3 for miss in missed)


def disc_on_a_motor():
    """A disc of 2 kg m² that a torque turns."""
    torque = mbd.Input("torque")
    disc = mbd.Body("disc", mass=1.0, inertia=2.0)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), disc.at(0, 0))
    model = mbd.Mechanism([disc], [hinge], forces=[mbd.Torque("motor", disc, torque)], inputs=[torque])
    return model, hinge, torque


def test_noise_of_a_tenth_is_remarked():
    """The bound of the remark: errors of some hundredths are not, of three tenths are."""
    model, hinge, torque = disc_on_a_motor()
    errors = []
    for size in (1e-5, 1.5e-4):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            samples = np.sin(4 * TIMES) + size * noise(TIMES.size)
            run = mbd.inverse_dynamics(model, TIMES, motion={hinge.angle: samples}, efforts=[torque])
        errors.append(rms(run[torque] + 32 * np.sin(4 * TIMES)) / rms(32 * np.sin(4 * TIMES)))
        assert bool(caught) == (size > 1e-4)
    assert 0.01 < errors[0] < 0.1 < errors[1] < 1


@pytest.mark.slow
def test_least_squares_of_contradicting_data_and_rates(leg):
    """The nearest pose by SciPy at one time; rates agree with differences of the poses."""
    from scipy.optimize import minimize

    offsets = 0.02 * noise(8)
    courses = [mbd.smoothing_spline(TIMES, course, cutoff=20) for course in leg.samples() + offsets[:, None]]
    run = leg.run(courses)
    h = 1e-4
    near = run.at(np.array([0.7 - h, 0.7, 0.7 + h]))
    target = np.array([course(0.7) for course in courses])

    def distance(angles):
        (a, b), (l1, _) = angles, leg.lengths
        at = [(0.05 + l1 / 2, 0.04, a, 0), (0.2 + l1 / 2, -0.03, a, 0), (0.12, 0.03, b, l1), (0.44, 0, b, l1)]
        rows = []
        for x, y, phi, knee in at:
            rows.append(knee * np.cos(a) + x * np.cos(phi) - y * np.sin(phi))
            rows.append(knee * np.sin(a) + x * np.sin(phi) + y * np.cos(phi))
        return np.sum((np.array(rows) - target) ** 2)

    best = minimize(distance, [leg.angles[0][0][35], leg.angles[1][0][35]], method="Nelder-Mead", tol=1e-12).x
    found = near[leg.shank.phi]
    np.testing.assert_allclose([near[leg.thigh.phi][1], found[1]], best, atol=1e-6)
    assert near[leg.shank.omega][1] == pytest.approx((found[2] - found[0]) / (2 * h), rel=1e-6)
    assert near[leg.shank.alpha][1] == pytest.approx((found[2] - 2 * found[1] + found[0]) / h**2, rel=1e-4)


@pytest.mark.parametrize("curve", ["CubicSpline", "make_interp_spline", "smoothing_spline", "coarse", "few"])
def test_noise_in_a_spline_is_remarked(curve):
    """A disc that swings: curves through noisy samples warn, a smooth one and few outputs of a fast motion do not."""
    from scipy import interpolate

    model, hinge, torque = disc_on_a_motor()
    samples = np.sin(4 * TIMES) + 3e-3 * noise(TIMES.size)
    course, times = {
        "CubicSpline": lambda: (interpolate.CubicSpline(TIMES, samples), TIMES),
        "make_interp_spline": lambda: (interpolate.make_interp_spline(TIMES, samples, k=5), TIMES),
        "smoothing_spline": lambda: (mbd.smoothing_spline(TIMES, samples, cutoff=3), TIMES),
        "coarse": lambda: (interpolate.CubicSpline(TIMES, np.sin(4 * TIMES)), [0.2, 0.9]),
        "few": lambda: (np.sin(4 * TIMES[::10]), TIMES[::10]),
    }[curve]()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = mbd.inverse_dynamics(model, times, motion={hinge.angle: course}, efforts=[torque])
    assert bool(caught) == (curve in ("CubicSpline", "make_interp_spline"))
    assert any("is not known: by every second sample" in note for note in run.statistics.notes) == (curve == "few")


def test_refusals_of_what_leaves_a_part_free(leg):
    motion = list(zip(leg.markers[:4], leg.samples()[:4], strict=True))
    with pytest.raises(mbd.MechanismError, match="under-determined by 1: motion= prescribes 4 quantities"):
        mbd.inverse_dynamics(leg.model, TIMES, motion=motion, efforts=leg.torques)


def test_times_outside_the_data(leg):
    """The courses are named with the first time at which they have no value."""
    curves = [mbd.smoothing_spline(TIMES, row, cutoff=4) for row in leg.samples()]
    motion = list(zip(leg.markers, curves, strict=True))
    with pytest.raises(mbd.MechanismError, match=r"motion 8 \(.*\) has no finite value at t = 2 s: a spline outside"):
        mbd.inverse_dynamics(leg.model, [0, 1, 2, 3], motion=motion, efforts=leg.torques)


def test_redundant_joints_and_weights():
    """A block in two guides and two sensors that disagree: the weighted mean; ``F = m a``."""
    push = mbd.Input("push")
    block = mbd.Body("block", mass=2.0, inertia=0.1)
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(k, 0), block.at(k, 0)) for k in range(2)]
    model = mbd.Mechanism([block], guides, forces=[mbd.Force("push", block.at(0, 0), (push, 0))], inputs=[push])
    course = mbd.sin(3 * mbd.t)
    motion = [(block.x, course), (2 * block.x, 2 * (course + 0.1))]
    run = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=[push])
    np.testing.assert_allclose(run[block.x], np.sin(3 * TIMES) + 0.08, atol=1e-12)
    np.testing.assert_allclose(run[push], -18 * np.sin(3 * TIMES), atol=1e-9)


def test_a_force_plate():
    """A force at a moving centre of pressure on a foot that turns: moments about its ankle."""
    foot = mbd.Body("foot", mass=1.2, inertia=0.01, pose=(0.1, 0.08, 0))
    ankle = mbd.Revolute("ankle", mbd.ground.at(0.05, 0.1), foot.at(-0.05, 0.02))
    torque = mbd.Input("ankle torque")
    times = np.linspace(0, 0.6, 61)
    fx, fy, centre = 80 * np.sin(9 * times), 700 + 100 * np.cos(9 * times), 0.05 + 0.2 * times
    plate_x, plate_y, place = (mbd.spline(mbd.t, times, course) for course in (fx, fy, centre))
    forces = [
        mbd.Gravity(),
        mbd.Torque("ankle muscle", foot, torque),
        mbd.Force("plate", mbd.ground.at(place, 0), (-plate_x, -plate_y), opposite=foot),
    ]
    model = mbd.Mechanism([foot], [ankle], forces=forces, inputs=[torque])
    angle = 0.2 * mbd.sin(5 * mbd.t)
    run = mbd.inverse_dynamics(model, times, motion={foot.phi: angle}, efforts=[torque])
    phi, alpha = 0.2 * np.sin(5 * times), -5 * np.sin(5 * times)
    lever = 0.05 * np.cos(phi) + 0.02 * np.sin(phi)
    of_plate = (centre - 0.05) * fy + 0.1 * fx
    wanted = (0.01 + 1.2 * (0.05**2 + 0.02**2)) * alpha + 1.2 * 9.81 * lever - of_plate
    np.testing.assert_allclose(run[torque], wanted, atol=1e-9)
    held = run[ankle.reaction_on(foot).force]
    np.testing.assert_allclose(held[:, 0], 1.2 * run[foot.ax] - fx, atol=1e-8)
    np.testing.assert_allclose(held[:, 1], 1.2 * (run[foot.ay] + 9.81) - fy, atol=1e-8)
    inputs = [mbd.Input(name) for name in ("along", "up", "centre")]
    read = mbd.Force("plate", mbd.ground.at(inputs[2], 0), (-inputs[0], -inputs[1]), opposite=foot)
    model = model.replace(forces=[*forces[:2], read], inputs=[torque, *inputs])
    samples = dict(zip(inputs, (fx, fy, centre), strict=True))
    again = mbd.inverse_dynamics(model, times, motion={foot.phi: angle}, efforts=[torque], inputs=samples)
    np.testing.assert_allclose(again[torque], wanted, atol=1e-9)
