"""Every constraint, driver row and force against the closed formulas of Haug's catalogue, in NumPy alone.

Phi, Phi_q, nu and gamma of the constraints and M, Q of the forces are compared
term by term at random states; the formulas are written out here as in the book.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

CLOSE = dict(rtol=1e-12, atol=1e-12)
R = np.array([[0.0, -1.0], [1.0, 0.0]])
I2 = np.eye(2)


# --- notation of the book ------------------------------------------------------------------
def turn(phi: float) -> np.ndarray:
    """``A(phi)``."""
    return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])


@dataclass
class Point:
    """A point ``s'`` and a unit direction ``v'`` on a moving body (or the ground, where all is zero)."""

    s: np.ndarray
    angle: float
    q: np.ndarray
    qd: np.ndarray

    @property
    def r(self):
        return self.q[:2]

    @property
    def rd(self):
        return self.qd[:2]

    @property
    def phi(self):
        return self.q[2]

    @property
    def phid(self):
        return self.qd[2]

    @property
    def A(self):
        return turn(self.phi)

    @property
    def B(self):
        return self.A @ R

    @property
    def v(self):
        """``v'``, in the body frame."""
        return np.array([np.cos(self.angle), np.sin(self.angle)])

    @property
    def position(self):
        """``r + A s'``."""
        return self.r + self.A @ self.s

    @property
    def velocity(self):
        """``rd + B s' phid``."""
        return self.rd + self.B @ self.s * self.phid

    @property
    def jacobian(self):
        """``[I, B s']``."""
        return np.column_stack([I2, self.B @ self.s])


def difference(i: Point, j: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``d``, its rate, and ``a_q = A_j s_j phid_j² - A_i s_i phid_i²``."""
    a_q = j.A @ j.s * j.phid**2 - i.A @ i.s * i.phid**2
    return j.position - i.position, j.velocity - i.velocity, a_q


def course(t: float) -> tuple[float, float, float]:
    """A prescribed course C(t) and its derivatives."""
    return 1.3 + 0.4 * np.sin(1.7 * t), 0.4 * 1.7 * np.cos(1.7 * t), -0.4 * 1.7**2 * np.sin(1.7 * t)


def constant(t: float) -> tuple[float, float, float]:
    """A constant C."""
    return 1.3, 0.0, 0.0


COURSE = 1.3 + 0.4 * mbd.sin(1.7 * mbd.t)


@dataclass
class Rows:
    """Phi, the columns of Phi_q of both bodies, nu and gamma."""

    Phi: np.ndarray
    on_i: np.ndarray
    on_j: np.ndarray
    nu: np.ndarray
    gamma: np.ndarray

    def __post_init__(self):
        self.Phi, self.nu, self.gamma = (np.atleast_1d(x).astype(float) for x in (self.Phi, self.nu, self.gamma))
        self.on_i, self.on_j = np.atleast_2d(self.on_i), np.atleast_2d(self.on_j)


def stacked(*parts: Rows) -> Rows:
    """Rows one above the other."""
    return Rows(
        np.concatenate([p.Phi for p in parts]),
        np.vstack([p.on_i for p in parts]),
        np.vstack([p.on_j for p in parts]),
        np.concatenate([p.nu for p in parts]),
        np.concatenate([p.gamma for p in parts]),
    )


# --- the catalogue ---------------------------------------------------------------------------
NONE = np.zeros(3)


def absolute(k: int) -> Callable:
    """Absolute x, y (k = 0, 1): ``(r^P)_k - C``."""

    def rows(i: Point, j: Point, C, t):
        gamma = (j.A @ j.s)[k] * j.phid**2 + C[2]
        return Rows(j.position[k] - C[0], NONE, j.jacobian[k], C[1], gamma)

    return rows


def absolute_angle(i: Point, j: Point, C, t):
    """``phi - C`` with the marker's angle."""
    return Rows(j.phi + j.angle - C[0], NONE, [0, 0, 1], C[1], C[2])


def squared_distance(d, dd, a_q, on_i, on_j, C) -> Rows:
    """Distance rows of the book, ``d·d - C²``."""
    return Rows(
        d @ d - C[0] ** 2,
        -2 * d @ on_i,
        2 * d @ on_j,
        2 * C[0] * C[1],
        -2 * dd @ dd + 2 * d @ a_q + 2 * (C[0] * C[2] + C[1] ** 2),
    )


def scaled_distance(d, dd, a_q, on_i, on_j, C) -> Rows:
    """``(d·d - C²) / (2 C)``, differentiated by hand with C(t)."""
    c, cd, cdd = C
    f = d @ d
    return Rows(
        (f - c**2) / (2 * c),
        -d @ on_i / c,
        d @ on_j / c,
        f * cd / (2 * c**2) + cd / 2,
        -(dd @ dd - d @ a_q) / c + 2 * d @ dd * cd / c**2 + f * cdd / (2 * c**2) - f * cd**2 / c**3 + cdd / 2,
    )


FIXED_POINT = np.array([-0.7, 0.9])


def absolute_distance(i: Point, j: Point, C, t):
    """Absolute distance, scaled."""
    d = j.position - FIXED_POINT
    return scaled_distance(d, j.velocity, j.A @ j.s * j.phid**2, np.zeros((2, 3)), j.jacobian, C)


def relative(k: int) -> Callable:
    """Relative x, y: ``(d)_k - C``."""

    def rows(i: Point, j: Point, C, t):
        d, _, a_q = difference(i, j)
        return Rows(d[k] - C[0], -i.jacobian[k], j.jacobian[k], C[1], a_q[k] + C[2])

    return rows


def relative_angle(i: Point, j: Point, C, t):
    """``phi_j - phi_i - C`` with the markers' angles."""
    return Rows(j.phi + j.angle - i.phi - i.angle - C[0], [0, 0, -1], [0, 0, 1], C[1], C[2])


def distance(i: Point, j: Point, C, t):
    """Revolute-revolute composite, scaled."""
    d, dd, a_q = difference(i, j)
    return scaled_distance(d, dd, a_q, i.jacobian, j.jacobian, C)


def revolute(i: Point, j: Point, C, t):
    """``r_i + A_i s_i - r_j - A_j s_j``."""
    d, _, a_q = difference(i, j)
    return Rows(-d, i.jacobian, -j.jacobian, [0, 0], -a_q)


def across(i: Point, j: Point) -> Rows:
    """First translational row, ``(B_i v'_i)·d``."""
    d, _, _ = difference(i, j)
    v, w = i.v, j.phid - i.phid
    A_ij, B_ij = i.A.T @ j.A, i.A.T @ j.B
    on_i = [*(-(i.B @ v)), -v @ i.A.T @ (j.r - i.r) - v @ A_ij @ j.s]
    on_j = [*(i.B @ v), v @ A_ij @ j.s]
    gamma = -v @ (B_ij @ j.s * w**2 - i.B.T @ (j.r - i.r) * i.phid**2 - 2 * i.A.T @ (j.rd - i.rd) * i.phid)
    return Rows((i.B @ v) @ d, on_i, on_j, 0.0, gamma)


def translational(i: Point, j: Point, C, t):
    """The first row, and the linear second row (whole turns at the estimates, see below)."""
    turns = 2 * np.pi * np.round((j.phi + j.angle - i.phi - i.angle) / (2 * np.pi))
    return stacked(across(i, j), relative_angle(i, j, (turns, 0, 0), t))


def weld(i: Point, j: Point, C, t):
    """Revolute and relative angle."""
    turns = 2 * np.pi * np.round((j.phi + j.angle - i.phi - i.angle) / (2 * np.pi))
    return stacked(revolute(i, j, C, t), relative_angle(i, j, (turns, 0, 0), t))


def point_on_line(i: Point, j: Point, C, t):
    """Revolute-translational composite, ``(B_i v'_i)·d - C``."""
    row = across(i, j)
    return Rows(row.Phi - C[0], row.on_i, row.on_j, C[1], row.gamma + C[2])


def along(i: Point, j: Point, C, t):
    """Translational-distance driver, ``v_i·d - C``."""
    d, dd, a_q = difference(i, j)
    v = i.A @ i.v
    on_i = [*(-v), (R @ v) @ (d + i.A @ i.s)]
    on_j = [*v, v @ j.B @ j.s]
    gamma = v @ d * i.phid**2 - 2 * i.phid * (R @ v) @ dd + v @ a_q + C[2]
    return Rows(v @ d - C[0], on_i, on_j, C[1], gamma)


RADIUS = 0.35


def rack_and_pinion(i: Point, j: Point, C, t):
    """``v_i·d + R (phi_j - phi_i) - C0``, C0 from the estimated poses."""
    row, angle = along(i, j, (0, 0, 0), t), relative_angle(i, j, (0, 0, 0), t)
    estimate_i = Point(i.s, i.angle, ESTIMATES["i"] if np.any(i.q) else np.zeros(3), np.zeros(3))
    estimate_j = Point(j.s, j.angle, ESTIMATES["j"], np.zeros(3))
    at_estimate = along(estimate_i, estimate_j, (0, 0, 0), t), relative_angle(estimate_i, estimate_j, (0, 0, 0), t)
    offset = at_estimate[0].Phi + RADIUS * at_estimate[1].Phi
    return Rows(
        row.Phi + RADIUS * angle.Phi - offset,
        row.on_i + RADIUS * angle.on_i,
        row.on_j + RADIUS * angle.on_j,
        0.0,
        row.gamma,
    )


def user_written(i: Point, j: Point, C, t):
    """``x_i y_j - t sin(phi_j)``, differentiated by hand."""
    (x, _, _), (_, y, phi) = i.q, j.q
    (xd, _, _), (_, yd, w) = i.qd, j.qd
    gamma = -2 * xd * yd - t * np.sin(phi) * w**2 + 2 * np.cos(phi) * w
    return Rows(x * y - t * np.sin(phi), [y, 0, 0], [0, x, -t * np.cos(phi)], np.sin(phi), gamma)


def distance_driver(i: Point, j: Point, C, t):
    """``|d| - C``: the square row of the book, divided by hand."""
    d, dd, a_q = difference(i, j)
    length = np.sqrt(d @ d)
    rate = d @ dd / length
    gamma = -(dd @ dd - d @ a_q - rate**2) / length + C[2]
    return Rows(length - C[0], -d @ i.jacobian / length, d @ j.jacobian / length, C[1], gamma)


def squared_distance_driver(i: Point, j: Point, C, t):
    """``d·d - C²``, as the book writes it."""
    d, dd, a_q = difference(i, j)
    return squared_distance(d, dd, a_q, i.jacobian, j.jacobian, C)


#: name: (how the element is made from markers a, b and C, its formula)
ONE_BODY = {
    "AbsoluteX": (lambda a, b, C: mbd.AbsoluteX("e", b, C), absolute(0)),
    "AbsoluteY": (lambda a, b, C: mbd.AbsoluteY("e", b, C), absolute(1)),
    "AbsoluteAngle": (lambda a, b, C: mbd.AbsoluteAngle("e", b, C), absolute_angle),
    "AbsoluteDistance": (lambda a, b, C: mbd.AbsoluteDistance("e", b, FIXED_POINT, C), absolute_distance),
    "driver of x": (lambda a, b, C: mbd.Driver("e", b.x, C), absolute(0)),
    "driver of y": (lambda a, b, C: mbd.Driver("e", b.position[1], C), absolute(1)),
    "driver of the angle": (lambda a, b, C: mbd.Driver("e", b.angle, C), absolute_angle),
}
TWO_BODIES = {
    "RelativeX": (lambda a, b, C: mbd.RelativeX("e", a, b, C), relative(0)),
    "RelativeY": (lambda a, b, C: mbd.RelativeY("e", a, b, C), relative(1)),
    "RelativeAngle": (lambda a, b, C: mbd.RelativeAngle("e", a, b, C), relative_angle),
    "Distance": (lambda a, b, C: mbd.Distance("e", a, b, C), distance),
    "PointOnLine": (lambda a, b, C: mbd.PointOnLine("e", a, b, C), point_on_line),
    "Revolute": (lambda a, b, C: mbd.Revolute("e", a, b), revolute),
    "Translational": (lambda a, b, C: mbd.Translational("e", a, b), translational),
    "Weld": (lambda a, b, C: mbd.Weld("e", a, b), weld),
    "RackAndPinion": (lambda a, b, C: mbd.RackAndPinion("e", a, b, RADIUS), rack_and_pinion),
    "driver of a revolute": (lambda a, b, C: mbd.Driver("e", mbd.Revolute("p", a, b).angle, C), relative_angle),
    "driver of a guide": (lambda a, b, C: mbd.Driver("e", mbd.Translational("p", a, b).displacement, C), along),
    "driver of PointOnLine": (lambda a, b, C: mbd.Driver("e", mbd.PointOnLine("p", a, b).displacement, C), along),
    "driver of a distance": (lambda a, b, C: mbd.Driver("e", mbd.distance(a, b), C), distance_driver),
    "Actuator": (lambda a, b, C: mbd.Actuator("e", a, b, C), distance_driver),
    "driver of a squared distance": (
        lambda a, b, C: mbd.Driver("e", mbd.sumsqr(b.position - a.position), C**2),
        squared_distance_driver,
    ),
}
USER = {
    "Constraint": (
        lambda a, b, C: mbd.Constraint("e", a.body.x * b.body.y - mbd.t * mbd.sin(b.body.phi)),
        user_written,
    )
}
ALL = ONE_BODY | TWO_BODIES | USER

ESTIMATES = {"i": np.array([0.2, -0.4, 0.5]), "j": np.array([1.1, 0.8, 0.9])}
S_I, S_J = np.array([0.31, -0.22]), np.array([-0.43, 0.17])
ANGLE_I, ANGLE_J = 0.6, -0.3


@pytest.fixture(params=range(3))
def rng(request):
    """Random states."""
    return np.random.default_rng(request.param)


def compare(make: Callable, formula: Callable, C_expression, C: Callable, rng, ground: str = "") -> None:
    """Put one element between two bodies (one of them may be the ground) and compare all its terms."""
    body_i = mbd.Body("i", mass=1.2, inertia=0.3, pose=ESTIMATES["i"])
    body_j = mbd.Body("j", mass=0.7, inertia=0.2, pose=ESTIMATES["j"])
    first, second = (mbd.ground if ground == name else body for name, body in (("i", body_i), ("j", body_j)))
    element = make(first.at(*S_I, angle=ANGLE_I), second.at(*S_J, angle=ANGLE_J), C_expression)
    lists = {"drivers": [element]} if isinstance(element, mbd.Driver) else {"joints": [element]}
    eom = mbd.equations(mbd.Mechanism(bodies=[body_i, body_j], **lists))

    t = rng.uniform(-1, 1)
    q = np.concatenate([ESTIMATES["i"], ESTIMATES["j"]]) + rng.uniform(-0.8, 0.8, 6)
    v = rng.normal(size=6)
    rest = np.zeros(3)
    i = Point(S_I, ANGLE_I, rest if ground == "i" else q[:3], rest if ground == "i" else v[:3])
    j = Point(S_J, ANGLE_J, rest if ground == "j" else q[3:], rest if ground == "j" else v[3:])
    wanted = formula(i, j, C(t), t)
    if ground == "i":
        wanted.on_i = np.zeros_like(wanted.on_i)
    if ground == "j":
        wanted.on_j = np.zeros_like(wanted.on_j)

    nothing = np.zeros(0)
    lam = np.zeros(eom.lam.numel())
    Phi, Phi_q, nu, gamma = (
        eom.function(part)(t, q, v, np.zeros(6), nothing, lam, nothing, nothing).full()
        for part in (eom.Phi, eom.Phi_q, eom.nu, eom.gamma)
    )
    np.testing.assert_allclose(Phi.ravel(), wanted.Phi, **CLOSE)
    np.testing.assert_allclose(Phi_q, np.hstack([wanted.on_i, wanted.on_j]), **CLOSE)
    np.testing.assert_allclose(nu.ravel(), wanted.nu, **CLOSE)
    np.testing.assert_allclose(gamma.ravel(), wanted.gamma, **CLOSE)


@pytest.mark.parametrize("name", ALL)
def test_constraint_rows_are_those_of_the_catalogue(name, rng):
    """Phi, Phi_q, nu and gamma between two moving bodies, constant C."""
    compare(*ALL[name], 1.3, constant, rng)


@pytest.mark.parametrize("name", ALL)
def test_rows_that_depend_on_time(name, rng):
    """The same with a prescribed course C(t): nu and gamma hold its rates."""
    compare(*ALL[name], COURSE, course, rng)


@pytest.mark.parametrize("ground", ["i", "j"])
@pytest.mark.parametrize("name", [n for n in TWO_BODIES if n != "RackAndPinion"])
def test_rows_with_the_ground_on_either_side(name, ground, rng):
    """The columns of the ground fall away, the rest stays."""
    compare(*TWO_BODIES[name], COURSE, course, rng, ground)


def test_rack_on_the_ground(rng):
    """A fixed rack."""
    compare(*TWO_BODIES["RackAndPinion"], 1.3, constant, rng, "i")


def test_pinion_that_turns_counter_clockwise_moves_the_rack_forward():
    """A fixed pinion above the rack: +1 rad moves the rack by +R along its x axis."""
    rack = mbd.Body("rack", mass=1, inertia=1)
    pinion = mbd.Body("pinion", mass=1, inertia=1, pose=(0, RADIUS, 0))
    mesh = mbd.RackAndPinion("mesh", rack.at(0, 0), pinion.at(0, 0), RADIUS)
    joints = [
        mbd.Translational("guide", mbd.ground.at(0, 0), rack.at(0, 0)),
        mbd.Revolute("pin", mbd.ground.at(0, RADIUS), pinion.at(0, 0)),
        mesh,
    ]
    state = mbd.assemble(mbd.Mechanism(bodies=[rack, pinion], joints=joints), [pinion.phi == 1.0])
    assert state[rack.x] == pytest.approx(RADIUS, abs=1e-12)


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
@pytest.mark.parametrize("kind", [mbd.Translational, mbd.Weld])
def test_whole_turns_of_the_estimates_stay(kind, turns):
    """The angle row vanishes at the whole turn that is nearest to the estimates, and only there."""
    block = mbd.Body("block", mass=1, inertia=1, pose=(0, 0, 2 * np.pi * turns + 0.4))
    joint = kind("guide", mbd.ground.at(0, 0), block.at(0, 0))
    angle = ca.Function("angle", [block.phi], [joint.rows[-1]])
    assert float(angle(2 * np.pi * turns)) == pytest.approx(0, abs=1e-14)
    assert float(angle(2 * np.pi * (turns + 1))) == pytest.approx(2 * np.pi)


@pytest.mark.parametrize("angle", [mbd.Parameter("tilt", 0.1), 0.1 + 0.2 * mbd.t], ids=["parameter", "time"])
def test_whole_turns_stay_on_a_guide_whose_angle_varies(angle):
    """The estimate counts at the parameters' own values and t = 0."""
    block = mbd.Body("block", mass=1, inertia=1, pose=(0, 0, 4 * np.pi + 0.3))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle), block.at(0, 0))
    parameters = [angle] if isinstance(angle, mbd.Parameter) else []
    state = mbd.assemble(mbd.Mechanism([block], [guide], parameters=parameters))
    assert state[block.phi] == pytest.approx(4 * np.pi + 0.1, abs=1e-12)


@pytest.mark.parametrize(
    "joint",
    [
        mbd.Revolute,
        mbd.Translational,
        lambda name, a, b: mbd.Gear(name, a, b, 0.1, 0.2),
        lambda name, a, b: mbd.PointOnCurve(name, a, b, mbd.Curve(lambda s: (s, 0), -1, 1)),
    ],
    ids=["Revolute", "Translational", "Gear", "PointOnCurve"],
)
@pytest.mark.parametrize("symbol", [mbd.Input("u"), mbd.StateVariable("z")], ids=["input", "state"])
def test_places_of_joints_depend_on_coordinates_and_time_only(joint, symbol):
    wheel = mbd.Body("wheel", mass=1, inertia=1, pose=(0.3, 0, 0))
    with pytest.raises(mbd.ExpressionError, match=rf"joint 'j' depends on the \w+ '{symbol.label}'"):
        joint("j", mbd.ground.at(symbol, 0, 0.1 * symbol), wheel.at(0, 0))


# --- inertia and forces -----------------------------------------------------------------------
MASSES = np.array([1.2, 0.7])
INERTIAS = np.array([0.3, 0.2])


def force_terms(forces, rng, **lists) -> tuple[np.ndarray, np.ndarray, Point, Point, float]:
    """Q and M of two bodies i, j under forces made from their markers, and the state."""
    body_i, body_j = (mbd.Body(n, mass=m, inertia=J) for n, m, J in zip("ij", MASSES, INERTIAS, strict=True))
    a, b = body_i.at(*S_I, angle=ANGLE_I), body_j.at(*S_J, angle=ANGLE_J)
    eom = mbd.equations(mbd.Mechanism(bodies=[body_i, body_j], forces=forces(a, b), **lists))
    t, q, v = rng.uniform(-1, 1), rng.uniform(-1, 1, 6), rng.normal(size=6)
    z, u = rng.normal(size=eom.z.numel()), rng.normal(size=eom.u.numel())
    arguments = (t, q, v, np.zeros(6), z, np.zeros(0), u, eom.parameter_values)
    i, j = Point(S_I, ANGLE_I, q[:3], v[:3]), Point(S_J, ANGLE_J, q[3:], v[3:])
    values = [eom.function(part)(*arguments).full() for part in (eom.Q, eom.M)]
    return values[0].ravel(), values[1], i, j, t


def at_point(p: Point, F: np.ndarray) -> np.ndarray:
    """``[F; (B s')^T F]``."""
    return np.array([*F, (p.B @ p.s) @ F])


def test_mass_matrix(rng):
    """``M = diag(m, m, J')`` by body."""
    _, M, *_ = force_terms(lambda a, b: [], rng)
    np.testing.assert_array_equal(M, np.diag([1.2, 1.2, 0.3, 0.7, 0.7, 0.2]))


def test_gravity(rng):
    """``[m g; 0]`` on every body, in any direction."""
    Q, *_ = force_terms(lambda a, b: [mbd.Gravity((1.5, -3.0))], rng)
    np.testing.assert_allclose(Q, [1.8, -3.6, 0, 1.05, -2.1, 0], **CLOSE)


def test_point_force_in_global_axes(rng):
    """``[F; (B s')^T F]`` with a force that depends on time and velocity."""
    Q, _, i, _, t = force_terms(lambda a, b: [mbd.Force("f", a, (3.0, mbd.t - 0.2 * a.body.vx))], rng)
    np.testing.assert_allclose(Q, [*at_point(i, np.array([3.0, t - 0.2 * i.rd[0]])), 0, 0, 0], **CLOSE)


def test_point_force_in_body_axes(rng):
    """``F = A C F''``: the axes of the marker turn with the body."""
    Q, _, i, _, _ = force_terms(lambda a, b: [mbd.Force("f", a, (3.0, -1.0), frame="body")], rng)
    F = turn(i.phi + ANGLE_I) @ [3.0, -1.0]
    np.testing.assert_allclose(Q, [*at_point(i, F), 0, 0, 0], **CLOSE)


@pytest.mark.parametrize("frame", ["global", "body"])
def test_force_with_an_opposite_body(frame, rng):
    """The other body takes -F at the same point of space."""
    Q, _, i, j, _ = force_terms(lambda a, b: [mbd.Force("f", a, (3.0, -1.0), frame, opposite=b.body)], rng)
    F = turn(i.phi + ANGLE_I) @ [3.0, -1.0] if frame == "body" else np.array([3.0, -1.0])
    arm = i.position - j.r
    couple = -(arm[0] * F[1] - arm[1] * F[0])
    np.testing.assert_allclose(Q, [*at_point(i, F), *-F, couple], **CLOSE)


def test_force_with_the_ground_opposite_is_the_force_alone(rng):
    """What the ground takes does no work."""
    Q, _, i, _, _ = force_terms(lambda a, b: [mbd.Force("f", a, (3.0, -1.0), opposite=mbd.ground)], rng)
    np.testing.assert_allclose(Q, [*at_point(i, np.array([3.0, -1.0])), 0, 0, 0], **CLOSE)


def test_couples(rng):
    """``[0; 0; n]``, and -n on the opposite body where there is one."""
    alone, *_ = force_terms(lambda a, b: [mbd.Torque("n", a.body, 2.5)], rng)
    between, *_ = force_terms(lambda a, b: [mbd.Torque("n", a.body, 2.5, opposite=b.body)], rng)
    np.testing.assert_array_equal(alone, [0, 0, 2.5, 0, 0, 0])
    np.testing.assert_array_equal(between, [0, 0, 2.5, 0, 0, -2.5])


def spring_force(i: Point, j: Point, tension: Callable) -> np.ndarray:
    """``Q_i = (f/l) [d; (B_i s_i)^T d]``, ``Q_j = -(f/l) [d; (B_j s_j)^T d]``."""
    d, dd, _ = difference(i, j)
    length = np.sqrt(d @ d)
    f = tension(length, d @ dd / length)
    return np.r_[at_point(i, f / length * d), -at_point(j, f / length * d)]


def test_translational_spring_damper_actuator(rng):
    """``f = k (l - l0) + c l̇ + F`` between offset points, tension positive."""
    k, l0, c = 12.0, 0.45, 0.8
    Q, _, i, j, t = force_terms(
        lambda a, b: [mbd.TSDA("s", a, b, stiffness=k, free_length=l0, damping=c, actuator=2 * mbd.t)], rng
    )
    wanted = spring_force(i, j, lambda length, rate: k * (length - l0) + c * rate + 2 * t)
    np.testing.assert_allclose(Q, wanted, **CLOSE)


def test_translational_spring_with_a_law_of_its_own(rng):
    """``law(l, l̇)`` in place of the linear one."""

    def hardening(length, rate):
        return 5 * length**3 + rate * abs(rate)

    def law(length, rate):
        return 5 * length**3 + rate * mbd.fabs(rate)

    Q, _, i, j, _ = force_terms(lambda a, b: [mbd.TSDA("s", a, b, law=law, actuator=1.0)], rng)
    np.testing.assert_allclose(Q, spring_force(i, j, lambda *x: hardening(*x) + 1.0), **CLOSE)


def test_rotational_spring_damper_actuator(rng):
    """``n = k (theta - theta0) + c thetȧ + N``: +n on a, -n on b."""
    k, free, c = 3.0, 0.25, 0.6
    Q, _, i, j, t = force_terms(
        lambda a, b: [mbd.RSDA("s", a, b, stiffness=k, free_angle=free, damping=c, actuator=mbd.cos(mbd.t))], rng
    )
    theta = j.phi + ANGLE_J - i.phi - ANGLE_I
    n = k * (theta - free) + c * (j.phid - i.phid) + np.cos(t)
    np.testing.assert_allclose(Q, [0, 0, n, 0, 0, -n], **CLOSE)


def test_rotational_spring_with_a_law_of_its_own(rng):
    """``law(theta, rate)`` in place of the linear one."""
    Q, _, i, j, _ = force_terms(lambda a, b: [mbd.RSDA("s", a, b, law=lambda x, r: x**3 + 0.1 * r)], rng)
    n = (j.phi + ANGLE_J - i.phi - ANGLE_I) ** 3 + 0.1 * (j.phid - i.phid)
    np.testing.assert_allclose(Q, [0, 0, n, 0, 0, -n], **CLOSE)


def test_generalized_force(rng):
    """``Q = (e_q)^T f`` summed over the pairs, vector pairs included."""
    Q, _, i, *_ = force_terms(
        lambda a, b: [mbd.GeneralizedForce("g", [(b.body.phi - 2 * a.body.phi, 1.5), (a.position, (0.3, 0.4))])], rng
    )
    np.testing.assert_allclose(Q, np.r_[at_point(i, np.array([0.3, 0.4])), 0, 0, 1.5] - [0, 0, 3, 0, 0, 0], **CLOSE)


def test_forces_add_up_and_take_inputs_states_and_parameters(rng):
    """Q of several forces is their sum; numbers may be symbols of the model."""
    u, z, k = mbd.Input("u"), mbd.StateVariable("z"), mbd.Parameter("k", 4.0)
    body = mbd.Body("body", mass=k, inertia=k / 2)
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), body.at(0, 0), stiffness=k)
    forces = [mbd.Gravity((0, -10)), mbd.Torque("motor", body, u * z), spring]
    mechanism = mbd.Mechanism(bodies=[body], forces=forces, inputs=[u], parameters=[k], states={z: -z})
    eom = mbd.equations(mechanism)
    phi = 0.3
    Q = eom.function(eom.Q)(0, [0, 0, phi], [0, 0, 0], [0, 0, 0], 2.0, [], 3.0, 5.0).full().ravel()
    M = eom.function(eom.M)(0, [0, 0, phi], [0, 0, 0], [0, 0, 0], 2.0, [], 3.0, 5.0).full()
    np.testing.assert_allclose(Q, [0, -50, 6 - 5 * phi], **CLOSE)
    np.testing.assert_allclose(M, np.diag([5, 5, 2.5]), **CLOSE)


def test_power_of_the_forces_balances_the_energy(rng):
    """``Q·v`` of springs without damping and of gravity is ``-dV/dt``."""
    bodies = [mbd.Body(n, mass=1.5, inertia=0.2) for n in "ab"]
    a, b = (body.at(*s) for body, s in zip(bodies, (S_I, S_J), strict=True))
    forces = [
        mbd.Gravity(),
        mbd.TSDA("t", a, b, stiffness=7, free_length=0.3),
        mbd.RSDA("r", a, b, stiffness=2, free_angle=0.1),
    ]
    eom = mbd.equations(mbd.Mechanism(bodies=bodies, forces=forces))
    power = ca.Function("power", [eom.q, eom.v], [ca.dot(eom.Q, eom.v) + mbd.time_derivative(eom.potential)])
    assert float(power(rng.uniform(-1, 1, 6), rng.normal(size=6))) == pytest.approx(0, abs=1e-12)


# --- reactions by the formula of the catalogue ----------------------------------------------------
@pytest.mark.parametrize("name", [n for n in TWO_BODIES if not n.startswith("driver")])
def test_reactions_are_those_of_the_catalogue(name, rng):
    """``F'' = -C^T A^T Phi_r^T lam`` and ``T = -(Phi_phi^T - s'^T B^T Phi_r^T) lam`` on both bodies."""
    make, formula = TWO_BODIES[name]
    bodies = [mbd.Body(n, mass=1, inertia=1, pose=ESTIMATES[n]) for n in "ij"]
    a, b = bodies[0].at(*S_I, angle=ANGLE_I), bodies[1].at(*S_J, angle=ANGLE_J)
    element = make(a, b, 1.3)
    q = np.concatenate([ESTIMATES["i"], ESTIMATES["j"]]) + rng.uniform(-0.3, 0.3, 6)
    points = Point(S_I, ANGLE_I, q[:3], np.zeros(3)), Point(S_J, ANGLE_J, q[3:], np.zeros(3))
    rows = formula(*points, (1.3, 0, 0), 0.0)
    lam = rng.normal(size=rows.Phi.size)
    for body, point, jacobian in zip(bodies, points, (rows.on_i, rows.on_j), strict=True):
        F = -jacobian[:, :2].T @ lam
        T = -(jacobian[:, 2] - (point.B @ point.s) @ jacobian[:, :2].T) @ lam
        reaction = element.reaction_on(body)
        values = ca.Function(
            "r",
            [*(body.q for body in bodies), element.multipliers],
            [reaction.force, reaction.torque, reaction.force_in_joint],
        )(q[:3], q[3:], lam)
        np.testing.assert_allclose(values[0].full().ravel(), F, **CLOSE)
        np.testing.assert_allclose(float(values[1]), T, **CLOSE)
        C = turn(point.angle)
        np.testing.assert_allclose(values[2].full().ravel(), C.T @ point.A.T @ F, **CLOSE)
