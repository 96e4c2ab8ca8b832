"""Bodies, the ground and markers, against the closed forms of rigid-body kinematics."""

from __future__ import annotations

import copy
import math
import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.geometry.shapes import Disc, Rectangle


def turn(phi: float) -> np.ndarray:
    """Rotation matrix."""
    return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])


def evaluate(body: mbd.Body, expression, q, v, a) -> np.ndarray:
    """Value of an expression of one body."""
    return ca.Function("f", [body.q, body.v, body.a], [ca.SX(expression)])(q, v, a).full().squeeze()


@pytest.fixture
def body():
    """A body with nothing special."""
    return mbd.Body("bar", mass=1.5, inertia=0.2, pose=(0.1, 0.2, 0.3), velocity=(1, 2, 3))


@pytest.fixture
def motion():
    """Random coordinates, velocities and accelerations."""
    return np.random.default_rng(0).normal(size=(3, 3))


# --- bodies ------------------------------------------------------------------------------
def test_coordinates_are_named_after_the_body(body):
    """``bar.x … bar.alpha``, and the vectors of them."""
    names = ("x", "y", "phi", "vx", "vy", "omega", "ax", "ay", "alpha")
    assert [getattr(body, n).name() for n in names] == [f"bar.{n}" for n in names]
    for vector, parts in ((body.q, names[:3]), (body.v, names[3:6]), (body.a, names[6:])):
        assert ca.is_equal(vector, ca.vertcat(*[getattr(body, n) for n in parts]))
    assert ca.is_equal(body.position, body.q[:2])
    assert ca.is_equal(body.velocity, body.v[:2])
    assert ca.is_equal(body.acceleration, body.a[:2])


def test_estimates_are_kept(body):
    """Pose and velocity as arrays."""
    np.testing.assert_array_equal(body.pose_estimate, [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(body.velocity_estimate, [1, 2, 3])


def test_two_bodies_of_one_name_have_symbols_of_their_own():
    """Equality is identity."""
    first, second = mbd.Body("bar", 1, 1), mbd.Body("bar", 1, 1)
    assert first != second
    assert not ca.is_equal(first.x, second.x)


def test_bodies_and_markers_do_not_change(body):
    """Assignment is refused and says what to do; copies are the same object."""
    with pytest.raises(AttributeError, match=r"bar.*does not change.*mass"):
        body.mass = 3.0
    with pytest.raises(AttributeError, match="does not change"):
        body.at(0, 0).local = ca.SX(2, 1)
    assert copy.copy(body) is body
    assert copy.deepcopy([body])[0] is body


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"mass": -1.0}, ["bar", "mass", "-1"]),
        ({"mass": float("inf")}, ["bar", "mass", "finite"]),
        ({"mass": "heavy"}, ["bar", "mass", "heavy"]),
        ({"mass": "1.0"}, ["bar", "mass", "'1.0'"]),
        ({"pose": "123"}, ["bar", "pose", "three numbers", "'123'"]),
        ({"pose": ("1", 2, 3)}, ["bar", "pose", "'1'"]),
        ({"mass": None}, ["bar", "mass", "None"]),
        ({"mass": [1.0, 2.0]}, ["bar", "mass"]),
        ({"inertia": float("nan")}, ["bar", "inertia", "nan"]),
        ({"inertia": -1e-9}, ["bar", "inertia"]),
        ({"pose": (0, 1)}, ["bar", "pose", "three", "2"]),
        ({"pose": 5}, ["bar", "pose", "5"]),
        ({"pose": (0, float("nan"), 1)}, ["bar", "pose", "nan"]),
        ({"velocity": (0, 1, 2, 3)}, ["bar", "velocity", "4"]),
        ({"mass": ca.SX.sym("m", 2)}, ["bar", "mass", "scalar"]),
        ({"mass": ca.MX.sym("m")}, ["bar", "mass", "MX"]),
    ],
)
def test_wrong_numbers_are_refused(settings, words):
    """The message names the body, the quantity and the value."""
    with pytest.raises(mbd.ModelError) as error:
        mbd.Body("bar", **({"mass": 1.0, "inertia": 1.0} | settings))
    assert all(word in str(error.value) for word in words), error.value


@pytest.mark.parametrize("name", ["", "  ", None, 3])
def test_a_body_needs_a_name(name):
    """A text that is not empty."""
    with pytest.raises(mbd.ModelError, match="name"):
        mbd.Body(name, 1, 1)


def test_the_name_of_the_ground_is_taken():
    """Two things called ground could not be distinguished in tables and messages."""
    with pytest.raises(mbd.ModelError, match=r"'ground'.*another"):
        mbd.Body("ground", 1, 1)


def test_numbers_of_numpy_and_casadi_are_numbers():
    """Scalars of other libraries, also in arrays of one."""
    body = mbd.Body("bar", np.float64(2), ca.DM(3), pose=np.array([1, 2, 3]))
    assert (body.mass, body.inertia) == (2.0, 3.0)
    assert isinstance(body.inertia, float)


def test_mass_may_be_zero_or_a_parameter():
    """Zero where joints hold the motion; a parameter keeps its limits."""
    mass = mbd.Parameter("mass", 2.0)
    assert mbd.Body("bar", mass, 0).mass is mass
    with pytest.raises(mbd.ModelError, match="mass"):
        mbd.Body("bar", mbd.Parameter("mass", -2.0), 0)


# --- the ground ----------------------------------------------------------------------------
def test_the_ground_does_not_move():
    """Its coordinates are zero; its markers are constants in the global frame."""
    assert mbd.ground.is_ground
    assert mbd.ground.q.is_zero() and mbd.ground.v.is_zero() and mbd.ground.a.is_zero()
    marker = mbd.ground.at(1.0, -2.0, angle=0.4)
    np.testing.assert_allclose(ca.DM(marker.position).full().ravel(), [1, -2])
    assert marker.velocity.is_zero() and marker.acceleration.is_zero()
    assert float(marker.angle) == 0.4 and marker.angular_velocity.is_zero()
    np.testing.assert_allclose(ca.DM(marker.x_axis).full().ravel(), [np.cos(0.4), np.sin(0.4)])


# --- markers --------------------------------------------------------------------------------
def test_position_velocity_and_acceleration_of_a_marker(body, motion):
    """``r + A s'``, ``rd + B s' omega``, ``rdd + B s' alpha - A s' omega²``."""
    q, v, a = motion
    s = np.array([0.4, -0.7])
    A = turn(q[2])
    B = A @ [[0, -1], [1, 0]]
    marker = body.at(*s)
    np.testing.assert_allclose(evaluate(body, marker.position, *motion), q[:2] + A @ s, rtol=1e-14)
    np.testing.assert_allclose(evaluate(body, marker.velocity, *motion), v[:2] + B @ s * v[2], rtol=1e-14)
    wanted = a[:2] + B @ s * a[2] - A @ s * v[2] ** 2
    np.testing.assert_allclose(evaluate(body, marker.acceleration, *motion), wanted, rtol=1e-13)


def test_components_of_a_marker_are_those_of_its_vectors(body):
    """``.x .y .vx .vy .ax .ay``."""
    marker = body.at(0.4, -0.7)
    pairs = [("x", "y", "position"), ("vx", "vy", "velocity"), ("ax", "ay", "acceleration")]
    for first, second, vector in pairs:
        assert ca.is_equal(ca.vertcat(getattr(marker, first), getattr(marker, second)), getattr(marker, vector), 9)


def test_axes_of_a_marker(body, motion):
    """The x axis at ``phi + angle``, the y axis a quarter turn ahead; its rate is omega."""
    marker = body.at(0.1, 0.2, angle=0.6)
    angle = motion[0][2] + 0.6
    assert evaluate(body, marker.angle, *motion) == pytest.approx(angle)
    assert evaluate(body, marker.angular_velocity, *motion) == pytest.approx(motion[1][2])
    np.testing.assert_allclose(evaluate(body, marker.x_axis, *motion), [np.cos(angle), np.sin(angle)], rtol=1e-14)
    np.testing.assert_allclose(evaluate(body, marker.y_axis, *motion), [-np.sin(angle), np.cos(angle)], rtol=1e-14)
    np.testing.assert_allclose(evaluate(body, marker.axes, *motion), turn(angle), rtol=1e-14)


def test_a_point_may_hold_parameters_and_time(body, motion):
    """A point that moves on the body: its own rate is part of the velocity."""
    q, v, _ = motion
    marker = body.at(0.5 * mbd.t, 0)
    function = ca.Function("f", [mbd.t, body.q, body.v], [marker.velocity])
    A = turn(q[2])
    wanted = v[:2] + A @ [0, 1] * 0.5 * 0.8 * v[2] + A @ [0.5, 0]
    np.testing.assert_allclose(function(0.8, q, v).full().ravel(), wanted, rtol=1e-14)


@pytest.mark.parametrize("point", [(float("nan"), 0), (0, float("inf")), ("left", 0), (0, 0, float("nan"))])
def test_wrong_points_are_refused(body, point):
    """The message names the body."""
    with pytest.raises(mbd.ModelError, match=r"bar.*marker"):
        body.at(*point)


# --- bodies from shapes ------------------------------------------------------------------------
def test_mass_and_inertia_come_from_the_shape():
    """A rectangle and a disc: ``rho A``, ``m (a² + b²)/12``, ``m R²/2``."""
    plate = mbd.Body.from_shape("plate", Rectangle(0.4, 0.3), density=10)
    assert plate.mass == pytest.approx(1.2)
    assert plate.inertia == pytest.approx(1.2 * 0.25 / 12)
    wheel = mbd.Body.from_shape("wheel", Disc(0.5), mass=4)
    assert wheel.mass == pytest.approx(4)
    assert wheel.inertia == pytest.approx(0.5)


def test_points_and_pose_of_a_body_from_a_shape_are_in_the_frame_of_the_shape():
    """With the centroid off the shape's origin, the point (0, 0) is that origin."""
    shape = Rectangle(1.0, 0.2, center=(0.5, 0.1))
    pose, velocity = (0.3, -0.4, 0.7), (1.0, 2.0, 3.0)
    body = mbd.Body.from_shape("link", shape, mass=2, pose=pose, velocity=velocity)
    centroid = np.array([0.3, -0.4]) + turn(0.7) @ [0.5, 0.1]
    np.testing.assert_allclose(body.pose_estimate, [*centroid, 0.7], rtol=1e-14)
    q, v = body.pose_estimate, body.velocity_estimate
    origin, other = body.at(0, 0), body.at(1.0, 0.2, angle=0.2)
    np.testing.assert_allclose(evaluate(body, origin.position, q, v, np.zeros(3)), pose[:2], atol=1e-15)
    np.testing.assert_allclose(evaluate(body, origin.velocity, q, v, np.zeros(3)), velocity[:2], atol=1e-14)
    wanted = np.array(pose[:2]) + turn(0.7) @ [1.0, 0.2]
    np.testing.assert_allclose(evaluate(body, other.position, q, v, np.zeros(3)), wanted, rtol=1e-14)
    assert evaluate(body, other.angle, q, v, np.zeros(3)) == pytest.approx(0.9)
    np.testing.assert_allclose(body.shape_frame, [-0.5, -0.1])


def test_a_shape_with_a_hole_swings_like_its_closed_form():
    """Inertia about the pivot of a plate with a hole, by the parallel-axis theorem."""
    shape = Rectangle(0.6, 0.4) - Disc(0.1, center=(0.2, 0.0))
    body = mbd.Body.from_shape("plate", shape, density=5.0)
    plate, hole = 5 * 0.24, 5 * np.pi * 0.01
    about_origin = plate * (0.36 + 0.16) / 12 - hole * (0.005 + 0.04)
    centroid = -hole * 0.2 / (plate - hole)
    assert body.mass == pytest.approx(plate - hole)
    np.testing.assert_allclose(body.shape_frame, [-centroid, 0], atol=1e-15)
    assert body.inertia == pytest.approx(about_origin - body.mass * centroid**2)


@pytest.mark.parametrize("given", [{}, {"density": 1.0, "mass": 1.0}, {"mass": -1.0}, {"density": -1.0}])
def test_density_or_mass_is_given(given):
    """Exactly one of the two, and not negative."""
    with pytest.raises(mbd.ModelError, match=r"mass|density"):
        mbd.Body.from_shape("plate", Rectangle(1, 1), **given)


@pytest.mark.parametrize(
    "make",
    [
        lambda: mbd.Body("arm", 1, 1, pose=(0, 0, 90)),
        lambda: mbd.Body("arm", 1, 1, pose=(0, 0, -22.5)),
        lambda: mbd.Body("arm", 1, 1).at(0, 0, 180.0),
        lambda: mbd.AbsoluteAngle("held", mbd.Body("arm", 1, 1).at(0, 0), 45),
        lambda: mbd.RelativeAngle("held", mbd.ground.at(0, 0), mbd.Body("arm", 1, 1).at(0, 0), 45),
        lambda: mbd.Body.from_shape("arm", mbd.Rectangle(1, 1), mass=1, pose=(0, 0, 90)),
    ],
)
def test_angles_in_degrees_are_reported(make):
    """With the remedy, at the line of the call."""
    with pytest.warns(
        mbd.MechanismWarning, match=r"rad is more than a turn; angles are in radians: np\.deg2rad"
    ) as said:
        make()
    assert len(said) == 1


def test_angles_in_radians_are_not():
    """Some turns, as they follow from a motion, and limits between."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for angle in (0, -3, 6, np.pi / 2, 2 * np.pi, 35.123, -20 * np.pi, mbd.Parameter("angle", 1.0)):
            body = mbd.Body("arm", 1, 1, pose=(0, 0, 0 if isinstance(angle, mbd.Parameter) else angle))
            body.at(0, 0, angle)
            mbd.AbsoluteAngle("held", body.at(0, 0), angle)


def test_the_warning_is_that_of_the_users_line():
    with pytest.warns(mbd.MechanismWarning) as said:
        mbd.Body("arm", 1, 1, pose=(0, 0, 90))
        mbd.ground.at(0, 0, 90)
        mbd.AbsoluteAngle("held", mbd.Body("arm", 1, 1).at(0, 0), 45)
    assert [w.filename for w in said] == [__file__] * 3


def test_a_nan_made_of_an_expression_leads_to_the_functions_of_the_package():
    """``math.sin`` of a symbol is NaN without an error."""
    body = mbd.Body("arm", 1, 1)
    with pytest.raises(mbd.ModelError, match=r"force 'f': vector x must be finite, got nan .*use mbd\.sin"):
        mbd.Force("f", body.at(0, 0), (math.sin(body.phi), 0))


@pytest.mark.parametrize("call", [np.sin, lambda phi: np.hypot(2 * phi, 1.0), lambda phi: np.where(phi > 0, phi, 0)])
def test_functions_of_numpy_lead_to_those_of_the_package(call):
    """For a symbol as for an expression, by the notice that CasADi gives."""
    body = mbd.Body("bar", mass=1, inertia=1)
    with pytest.warns(FutureWarning, match=r"^in expressions of mbdcasadi write mbd\.sin for np\.sin"):
        result = call(body.phi)
    assert isinstance(result, ca.SX)


def test_numpys_own_expressions_are_refused_with_the_remedy():
    """With ``setNumpyMode(1)`` of CasADi, ``np.sin`` of an expression has a type of its own."""
    body = mbd.Body("bar", mass=1, inertia=1)
    mode = ca.GlobalOptions.getNumpyMode()
    ca.GlobalOptions.setNumpyMode(1)
    try:
        sine = np.sin(body.phi)
        relation = sine <= 0.3
    finally:
        ca.GlobalOptions.setNumpyMode(mode)
    with pytest.raises(mbd.ModelError, match=r"torque 'motor': value is .*sin\(bar\.phi\).*use mbd\.sin"):
        mbd.Torque("motor", body, sine)
    with pytest.raises(mbd.ConditionError, match=r"condition 1 is .*use mbd\.sin"):
        mbd.assemble(mbd.Mechanism(bodies=[body]), [relation])
