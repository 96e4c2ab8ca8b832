"""Tables in two variables against closed forms and SciPy's splines: values, derivatives, ends, motions."""

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, RegularGridInterpolator

import mbdcasadi as mbd

KINDS = ("cubic", "monotone", "linear")
XS, YS = np.array([-1.0, -0.4, 0.1, 0.9, 1.3, 2.0]), np.array([0.0, 0.5, 1.2, 2.0, 3.0])


def cubic(x, y):
    return (x**3 - x) * (y**2 + 1)


def surface(values, kind, outside="error", xs=XS, ys=YS, order=0):
    """Value, or all derivatives of an order, of a table as a function of places (n,)."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    parts = mbd.table(x, y, xs, ys, values, kind, outside)
    for _ in range(order):
        parts = ca.vec(ca.jacobian(parts, ca.vertcat(x, y)))
    call = ca.Function("f", [x, y], [ca.densify(parts)])
    return lambda a, b: call(*[np.atleast_2d(np.asarray(at, float)) for at in (a, b)]).full()


# --- values -----------------------------------------------------------------------------------------
def test_reproduces_a_product_of_cubics_with_its_derivatives():
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-1, 2, 40), rng.uniform(0, 3, 40)
    values = cubic(XS[:, None], YS[None, :])
    np.testing.assert_allclose(mbd.table(x, y, XS, YS, values), cubic(x, y), atol=1e-13)
    np.testing.assert_allclose(
        surface(values, "cubic", order=1)(x, y), [(3 * x**2 - 1) * (y**2 + 1), (x**3 - x) * 2 * y], atol=1e-12
    )
    second = surface(values, "cubic", order=2)(x, y)
    np.testing.assert_allclose(second[0], 6 * x * (y**2 + 1), atol=1e-11)
    np.testing.assert_allclose(second[1:3], np.tile((3 * x**2 - 1) * 2 * y, (2, 1)), atol=1e-11)
    np.testing.assert_allclose(second[3], 2 * (x**3 - x), atol=1e-11)


def test_is_the_product_of_splines():
    """Against SciPy's splines one after the other, and its bilinear interpolation."""
    rng = np.random.default_rng(1)
    values = rng.normal(size=(6, 5))
    x, y = rng.uniform(-1, 2, 40), rng.uniform(0, 3, 40)
    rows = np.array([CubicSpline(YS, row)(y) for row in values])
    by_scipy = [CubicSpline(XS, column)(at) for at, column in zip(x, rows.T, strict=True)]
    np.testing.assert_allclose(mbd.table(x, y, XS, YS, values), by_scipy, atol=1e-13)
    bilinear = RegularGridInterpolator((XS, YS), values)(np.column_stack([x, y]))
    np.testing.assert_allclose(mbd.table(x, y, XS, YS, values, "linear"), bilinear, atol=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_meets_its_data_and_is_as_smooth_as_it_says(kind):
    """Exactly at the grid; across its lines two, one or no derivatives are continuous, and not one more."""
    rng = np.random.default_rng(2)
    values = rng.normal(size=(6, 5))
    assert np.array_equal(mbd.table(XS[:, None], YS[None, :], XS, YS, values, kind), values)
    smooth = {"cubic": 2, "monotone": 1, "linear": 0}[kind]
    for order in range(smooth + 2):
        jumps = []
        for dx, dy in ((1e-9, 0.0), (0.0, 1e-9)):
            x, y = (XS[1:-1], np.full(4, 0.77)) if dx else (np.full(3, 0.33), YS[1:-1])
            at = surface(values, kind, order=order)
            jumps.append(np.max(np.abs(at(x + dx, y + dy) - at(x - dx, y - dy))))
        assert max(jumps) < 1e-6 if order <= smooth else min(jumps) > 1e-3


# --- monotone ---------------------------------------------------------------------------------------
def monotone_data(seed):
    """Steps at random that grow in both directions, with flats; and one that saturates on both sides."""
    rng = np.random.default_rng(seed)
    if seed == 0:
        return np.clip(np.add.outer(XS, -YS), -1.5, 0.5)
    steps = rng.uniform(0, 1, (6, 5)) * (rng.uniform(0, 1, (6, 5)) > 0.4)
    return np.cumsum(np.cumsum(steps, 0), 1)


@pytest.mark.parametrize("seed", range(4))
def test_monotone_data_give_a_monotone_surface(seed):
    """Also between the lines of the grid, where the product of cubics overshoots."""
    values = monotone_data(seed)
    x, y = np.linspace(-1, 2, 91)[:, None], np.linspace(0, 3, 91)[None, :]
    found = {kind: mbd.table(x, y, XS, YS, values, kind) for kind in ("monotone", "cubic")}
    sense = -1 if seed == 0 else 1
    for axis, s in ((0, 1), (1, sense)):
        assert np.min(s * np.diff(found["monotone"], axis=axis)) > -1e-9 * np.ptp(values)
        assert np.min(s * np.diff(found["cubic"], axis=axis)) < -1e-4 * np.ptp(values)
    assert np.min(found["monotone"]) > values.min() - 1e-9 and np.max(found["monotone"]) < values.max() + 1e-9


def test_monotone_where_nothing_is_in_its_way():
    """Bilinear data are reproduced; data of one variable are those of the spline in it, at any place of the other."""
    x, y = np.linspace(-1, 2, 40)[:, None], np.linspace(0, 3, 30)[None, :]
    grid = np.multiply.outer(XS + 1, YS)
    np.testing.assert_allclose(mbd.table(x, y, XS, YS, grid, "monotone"), (x + 1) * y, atol=1e-12)
    line = np.array([0, 0.1, 2.0, 2.0, 2.5])
    grid = np.tile(line, (6, 1))
    along = np.tile(mbd.spline(y, YS, line, "monotone"), (40, 1))
    np.testing.assert_allclose(mbd.table(x, y, XS, YS, grid, "monotone"), along, atol=1e-7)


# --- outside ----------------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", KINDS)
def test_outside(kind):
    """The nearest border, or its tangent plane; one choice for each variable."""
    values = cubic(XS[:, None], YS[None, :])
    edge, slope = surface(values, kind)(2, 1.0)[0, 0], surface(values, kind, order=1)(2, 1.0)[0, 0]
    held = mbd.table([2.5, 2.0], 1.0, XS, YS, values, kind, "constant")
    np.testing.assert_allclose(held, edge)
    out = surface(values, kind, "constant", order=1)([2.5, 1.3], [1.0, 3.4])
    np.testing.assert_allclose([out[0, 0], out[1, 1]], 0, atol=1e-12)
    assert mbd.table(2.5, 1.0, XS, YS, values, kind, ("linear", "error")) == pytest.approx(edge + 0.5 * slope)
    corner = surface(values, kind, "linear", order=2)([2.5], [3.4])  # a product of two tangents
    np.testing.assert_allclose(corner[[0, 3]], 0, atol=1e-9)
    for beyond in ([2.1, 1.0], [1.0, -0.1]):
        assert np.isnan(surface(values, kind)(*beyond)).all()
        assert np.isnan(surface(values, kind, order=1)(*beyond)).any()
        with pytest.raises(mbd.ModelError, match=r"table: [xy] = .* is outside the data"):
            mbd.table(*beyond, XS, YS, values, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_periodic(kind):
    """As smooth over the seam as elsewhere."""
    xs = np.linspace(0, 2 * np.pi, 25)
    values = (np.sin(xs)[:, None] + 1.3) * (YS + 1)
    outside = ("periodic", "error")
    at = [7.0, 7.0 - 2 * np.pi, 7.0 - 6 * np.pi]
    np.testing.assert_allclose(mbd.table(at, 1.0, xs, YS, values, kind, outside), (np.sin(7) + 1.3) * 2, rtol=6e-3)
    for order in range({"cubic": 2, "monotone": 1, "linear": 0}[kind] + 1):
        call = surface(values, kind, outside, xs=xs, order=order)
        np.testing.assert_allclose(call([-1e-9], [1.1]), call([1e-9], [1.1]), atol=1e-7)


# --- in a mechanism ---------------------------------------------------------------------------------
@pytest.mark.parametrize("kind", KINDS)
def test_a_map_of_a_motor_in_a_motion(kind):
    """A torque that falls linearly with speed, in a table of speed and throttle: omega = omega_0 u (1 - exp(-t/T))."""
    rotor = mbd.Body("rotor", mass=1.0, inertia=0.2)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))
    throttle = mbd.Input("throttle", lower=0, upper=1)
    speeds, shares = np.linspace(-1, 12, 6), np.linspace(0, 1, 5)
    values = 5.0 * np.outer(np.ones(6), shares) - 0.5 * speeds[:, None]
    torque = mbd.Torque("motor", rotor, mbd.table(rotor.omega, throttle, speeds, shares, values, kind))
    model = mbd.Mechanism([rotor], joints=[pin], forces=[torque], inputs=[throttle])
    run = mbd.simulate(model, np.linspace(0, 1, 21), inputs={throttle: 0.8}, reltol=1e-10, abstol=1e-10)
    np.testing.assert_allclose(run[rotor.omega], 8 * (1 - np.exp(-2.5 * run.t)), atol=1e-7)
    best = mbd.optimize(
        mbd.OptimalControlProblem(
            model,
            duration=1.0,
            initial=[pin.angle == 0, rotor.omega == 0],
            final=[pin.angle == 1.0, rotor.omega == 0.5],
            running_cost=throttle**2,
        ),
        intervals=20,
    )
    assert best.verify().final_error < 1e-4


def test_a_driver_follows_a_table():
    lift = mbd.Parameter("lift", 0.5)
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), body.at(0, 0))
    course = mbd.table(mbd.t, lift, XS + 1, YS, cubic(XS[:, None], YS[None, :]))
    drive = mbd.Driver("drive", guide.displacement, course)
    motion = mbd.kinematics(mbd.Mechanism([body], joints=[guide], drivers=[drive], parameters=[lift]), [0, 1.2, 2.0])
    x = motion.t - 1
    np.testing.assert_allclose(motion[body.x], cubic(x, 0.5), atol=1e-12)
    np.testing.assert_allclose(motion[body.ax], 6 * x * 1.25, atol=1e-10)


@pytest.mark.parametrize("speed", [0.4, 2.99])
def test_a_motion_that_leaves_it_stops_with_an_error(speed):
    """By its place after 2.5 s, or at once by a speed that grows."""
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    force = mbd.table(body.x, body.vx, XS, YS, np.full((6, 5), 1e-9 if speed < 1 else 5.0))
    model = mbd.Mechanism([body], forces=[mbd.Force("pull", body.at(0, 0), (force, 0))])
    start = [body.x == 1.0, body.vx == speed]
    with pytest.raises(mbd.SimulationError, match="force 'pull' is not finite there: .*table") as stopped:
        mbd.simulate(model, np.linspace(0, 5, 51), initial=start)
    assert stopped.value.partial is not None
    assert stopped.value.time == pytest.approx(2.5 if speed < 1 else 0.002, rel=2e-2)


# --- said by name -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "quintic"}, "kind must be one of cubic, monotone, linear"),
        ({"outside": "zero"}, "outside must be one of error, constant"),
        ({"outside": ("error",) * 3}, "one choice, or one for x and one for y"),
        ({"xs": [0, 1, 2, 3]}, r"one row for each of xs and one column for each of ys, \(4, 5\), got \(6, 5\)"),
        ({"ys": [0, 1, 1, 2, 3]}, r"ys must increase strictly, got ys\[1\] = 1.0 and ys\[2\] = 1.0"),
        ({"xs": XS[:3], "values": np.ones((3, 5))}, "kind 'cubic' takes at least 4 points, got 3 in xs"),
        ({"values": np.where(np.eye(6, 5) > 0, np.nan, 0)}, r"values must be finite, got values\[0, 0\] = nan"),
        ({"values": [1, 2, 3]}, r"values must be a table of numbers, got shape \(3,\)"),
        ({"values": "data"}, "values must be a table of numbers"),
        ({"outside": "periodic"}, "periodic data must end with the values they start with"),
        ({"x": ca.MX.sym("x")}, "casadi.MX"),
        ({"x": ca.SX.sym("x", 2), "y": ca.SX.sym("y", 3)}, r"same shape, got \(2, 1\) and \(3, 1\)"),
        ({"x": "now"}, "x and y must be expressions or numbers of one shape"),
        ({"x": ca.SX.sym("x"), "y": None}, "numbers of one shape, got y = None"),
        ({"x": ca.SX.sym("x"), "y": 5.0}, "y = 5.0 is outside the data"),
        ({"x": ca.vertcat(ca.SX.sym("x"), -3), "y": 0.2}, "x = -3.0 is outside the data"),
    ],
)
def test_what_is_wrong_is_named(change, message):
    given = {"x": 0.1, "y": 0.2, "xs": XS, "ys": YS, "values": np.add.outer(XS, YS)} | change
    with pytest.raises(mbd.ModelError, match=message):
        mbd.table(**given)
