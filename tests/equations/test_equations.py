"""Equations of motion: by virtual work, consistent with their own derivatives, printed, cached and open to all."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_arguments, random_case
from seeds import seeds

import mbdcasadi as mbd


def slider_crank():
    """Crank, rod and slider with a motor."""
    crank = mbd.Body("crank", mass=0.12, inertia=1e-4, pose=(0.05, 0, 0))
    rod = mbd.Body("rod", mass=0.5, inertia=4e-3, pose=(0.25, 0, 0))
    slider = mbd.Body("slider", mass=2.0, inertia=1e-3, pose=(0.4, 0, 0))
    tau = mbd.Input("tau")
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("pin", crank.at(0.05, 0), rod.at(-0.15, 0)),
        mbd.Revolute("wrist", rod.at(0.15, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Torque("motor", crank, tau)]
    return mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=forces, inputs=[tau])


# --- sizes, names, printing --------------------------------------------------------------
def test_sizes_and_names():
    """Nine coordinates by body, eight rows by joint."""
    eom = mbd.equations(slider_crank())
    assert eom.q.shape == eom.v.shape == eom.a.shape == eom.Q.shape == (9, 1)
    assert eom.M.shape == (9, 9) and eom.Phi_q.shape == (8, 9)
    assert eom.Phi.shape == eom.nu.shape == eom.gamma.shape == eom.lam.shape == (8, 1)
    assert eom.u.shape == (1, 1) and eom.z.shape == (0, 1) and eom.p.shape == (0, 1)
    assert eom.coordinate_names[:4] == ("crank.x", "crank.y", "crank.phi", "rod.x")
    assert eom.row_names == (
        "main.x", "main.y", "pin.x", "pin.y", "wrist.x", "wrist.y", "guide.normal", "guide.angle"
    )  # fmt: skip
    np.testing.assert_array_equal(eom.position_rows, np.arange(8))
    assert "9" in repr(eom) and "8" in repr(eom)


def test_a_free_body_has_no_rows():
    """Empty but of the right shape: m a = Q."""
    body = mbd.Body("body", mass=2, inertia=0.5)
    eom = mbd.equations(mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()]))
    assert eom.Phi.shape == (0, 1) and eom.Phi_q.shape == (0, 3) and eom.gamma.shape == (0, 1)
    a, lam = eom.forward_dynamics(0, [0, 0, 0], [1, 1, 1], [], [], [])
    np.testing.assert_allclose(a.full().ravel(), [0, -9.81, 0])
    assert lam.shape == (0, 1)


def test_a_body_without_forces():
    """Q is zero, not empty."""
    eom = mbd.equations(mbd.Mechanism(bodies=[mbd.Body("body", 1, 1)]))
    assert eom.Q.shape == (3, 1) and eom.Q.is_zero()


def test_it_prints_as_in_the_textbook():
    """The general form, the names and the terms."""
    text = str(mbd.equations(slider_crank()))
    assert "M a + Phi_q^T lam = Q" in text
    assert "Phi_q v = nu" in text and "Phi_q a = gamma" in text
    for word in ("crank.phi", "main.x", "guide.angle", "cos(crank.phi)", "tau", "n = 9", "m = 8", "-1.1772"):
        assert word in text, word


def test_it_prints_in_a_notebook():
    """LaTeX in display math, with balanced braces."""
    latex = mbd.equations(slider_crank())._repr_latex_()
    assert latex.startswith("$$") and latex.endswith("$$")
    for word in (r"\boldsymbol{\Phi}_q", r"\boldsymbol{\lambda}", r"\mathbf{Q}", r"\boldsymbol{\gamma}", r"\varphi"):
        assert word in latex or (word == r"\varphi" and r"\phi" in latex), word
    assert latex.count("{") == latex.count("}")


def test_velocity_level_rows_are_printed():
    """Each with its name, apart from the position rows; no empty block where there are none of these."""
    body = mbd.Body("b", 1, 1)
    drift = mbd.NonholonomicConstraint("drift", body.vy - body.x * body.omega)
    alone = mbd.equations(mbd.Mechanism([body], [drift]))
    assert "m = 1 constraint rows, 1 of them at velocity level" in str(alone)
    assert "velocity-level rows, zero\n  drift  b.vy - b.x*b.omega\n" in str(alone)
    assert "\nPhi\n" not in str(alone)
    both = mbd.equations(mbd.Mechanism([body], [drift, mbd.AbsoluteX("rail", body.at(0, 0), 0.5)]))
    text = str(both)
    assert "m = 2 constraint rows, 1 of them at velocity level" in text
    assert "\nPhi\n  rail  b.x - 0.5\n" in text and "\n  drift  b.vy - b.x*b.omega\n" in text
    assert r"= \mathbf{0}$$" in both._repr_latex_()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 9])
def test_any_mechanism_prints(seed):
    """Also states, parameters and drivers."""
    case = random_case(seed, driven=True)
    eom = mbd.equations(case.mechanism)
    text = str(eom)
    for name in (*eom.coordinate_names, *eom.row_names):
        assert name in text
    assert "$$" in eom._repr_latex_()


# --- M and Q ---------------------------------------------------------------------------------
def test_equations_of_a_pendulum_reduce_to_the_textbook():
    """``(J' + m L²/4) alpha = -m g (L/2) cos(phi) + tau``, from M, Q, Phi_q and gamma."""
    mass, length, inertia, phi, omega, effort = 1.2, 0.8, 0.07, 0.6, 2.0, 0.9
    rod = mbd.Body("rod", mass=mass, inertia=inertia)
    tau = mbd.Input("tau")
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    forces = [mbd.Gravity(), mbd.Torque("motor", rod, tau)]
    eom = mbd.equations(mbd.Mechanism(bodies=[rod], joints=[pin], forces=forces, inputs=[tau]))
    c, s = np.cos(phi), np.sin(phi)
    q = length / 2 * np.array([c, s, 0]) + [0, 0, phi]
    v = length / 2 * omega * np.array([-s, c, 0]) + [0, 0, omega]
    a, lam = (x.full().ravel() for x in eom.forward_dynamics(0, q, v, [], effort, []))
    alpha = (-mass * 9.81 * length / 2 * c + effort) / (inertia + mass * length**2 / 4)
    wanted = length / 2 * np.array([-s * alpha - c * omega**2, c * alpha - s * omega**2])
    np.testing.assert_allclose(a, [*wanted, alpha], rtol=1e-12)
    np.testing.assert_allclose(lam, mass * np.add(wanted, [0, 9.81]), rtol=1e-12)


@pytest.mark.parametrize("seed", seeds(40))
def test_forces_are_the_derivative_of_their_virtual_work(seed):
    """``Q·δq = Σ force · δdisplacement`` along a random direction, by central differences of the displacements."""
    case = random_case(seed)
    mechanism, eom = case.mechanism, mbd.equations(case.mechanism)
    rng = np.random.default_rng(seed)
    t, q, *rest = random_arguments(mechanism, case.pose, rng)
    direction = rng.normal(size=q.size)
    pairs = [(ca.vec(ca.SX(d)), ca.vec(ca.SX(f))) for e in mechanism.elements for d, f in e.virtual_work]
    if not pairs:
        assert eom.Q.is_zero()
        return
    displacement, force = (eom.function(ca.vertcat(*part)) for part in zip(*pairs, strict=True))
    h = 1e-4
    ahead, behind = (displacement(t, q + sign * h * direction, *rest).full().ravel() for sign in (1, -1))
    work = force(t, q, *rest).full().ravel() @ (ahead - behind) / (2 * h)
    Q = eom.function(eom.Q)(t, q, *rest).full().ravel()
    assert Q @ direction == pytest.approx(work, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("seed", seeds(40))
def test_mass_matrix_is_diagonal_and_gives_the_kinetic_energy(seed):
    """``T = v·M v / 2`` is the sum over the bodies."""
    case = random_case(seed)
    eom = mbd.equations(case.mechanism)
    arguments = random_arguments(case.mechanism, case.pose, np.random.default_rng(seed))
    M, v = eom.value(eom.M, arguments), arguments[2]
    bodies = case.mechanism.bodies
    np.testing.assert_array_equal(M, np.diag([x for b in bodies for x in (b.mass, b.mass, b.inertia)]))
    kinetic = sum(
        0.5 * b.mass * (v[3 * k] ** 2 + v[3 * k + 1] ** 2) + 0.5 * b.inertia * v[3 * k + 2] ** 2
        for k, b in enumerate(bodies)
    )
    assert eom.value(eom.kinetic, arguments).item() == pytest.approx(kinetic, rel=1e-13)
    assert kinetic == pytest.approx(0.5 * v @ M @ v, rel=1e-13)


# --- Phi_q, nu and gamma against differences -----------------------------------------------------
def central(f, h: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative of f at 0, of fourth order."""
    m2, m1, o, p1, p2 = (f(k * h) for k in (-2, -1, 0, 1, 2))
    return (m2 - 8 * m1 + 8 * p1 - p2) / (12 * h), (-m2 + 16 * m1 - 30 * o + 16 * p1 - p2) / (12 * h**2)


@pytest.mark.parametrize("seed", seeds(200, quick=10))
def test_jacobian_nu_and_gamma_are_derivatives_of_the_constraints(seed):
    """Along ``q(t) = q0 + v t + a t²/2``: ``dPhi/dt = Phi_q v - nu`` and ``d²Phi/dt² = Phi_q a - gamma``."""
    case = random_case(seed, driven=seed % 2 == 1)
    eom = mbd.equations(case.mechanism)
    t, q, v, a, *rest = random_arguments(case.mechanism, case.pose, np.random.default_rng(seed))
    Phi = eom.function(eom.Phi)
    values = [eom.function(part)(t, q, v, a, *rest).full() for part in (eom.Phi_q, eom.nu, eom.gamma)]
    Phi_q, nu, gamma = values[0], values[1].ravel(), values[2].ravel()

    rate, second = central(lambda s: Phi(t + s, q + s * v + s**2 / 2 * a, v, a, *rest).full().ravel(), 2e-3)
    scale = 1 + np.max(np.abs(gamma))
    np.testing.assert_allclose(Phi_q @ v - nu, rate, atol=1e-8 * scale)
    np.testing.assert_allclose(Phi_q @ a - gamma, second, atol=1e-6 * scale)

    for k in range(q.size):
        column, _ = central(lambda s, k=k: Phi(t, q + s * np.eye(q.size)[k], v, a, *rest).full().ravel(), 2e-3)
        np.testing.assert_allclose(Phi_q[:, k], column, atol=1e-9)


@pytest.mark.parametrize("seed", seeds(200, quick=10, without=range(9, 200, 10)))
def test_forward_dynamics_solves_the_equations_of_motion(seed):
    """``M a + Phi_q^T lam = Q`` and ``Phi_q a = gamma`` hold to rounding at the true pose, with independent rows."""
    case = random_case(seed)
    eom = mbd.equations(case.mechanism)
    _, _, v, _, z, _, u, p = random_arguments(case.mechanism, case.pose, np.random.default_rng(seed))
    a, lam = eom.forward_dynamics(0.0, case.pose, v, z, u, p)
    parts = (eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q, eom.Phi_q @ eom.a - eom.gamma)
    for residual in parts:
        left = eom.function(residual)(0.0, case.pose, v, a, z, lam, u, p).full()
        size = 1 + np.max(np.abs(np.r_[a.full().ravel(), lam.full().ravel()]))
        assert np.max(np.abs(left), initial=0) <= 1e-11 * size


@pytest.mark.slow
def test_random_mechanisms_are_what_they_say():
    """They close at their pose, with the rank that is claimed, and every kind of element occurs."""
    kinds: set[str] = set()
    for seed in range(40):
        for driven in (False, True) if seed < 10 else (False,):
            case = random_case(seed, driven)
            eom = mbd.equations(case.mechanism)
            rest = random_arguments(case.mechanism, case.pose, np.random.default_rng(0))[2:]
            assert np.max(np.abs(eom.value(eom.Phi, (0.0, case.pose, *rest)))) < 1e-12
            rank = np.linalg.matrix_rank(eom.value(eom.Phi_q, (0.0, case.pose, *rest)))
            assert rank == eom.q.numel() - case.degrees_of_freedom == eom.lam.numel() - case.redundant
            assert (case.degrees_of_freedom == 0) == driven
            kinds |= {type(e).__name__ for e in (*case.mechanism.joints, *case.mechanism.forces)}
    assert kinds == {
        "Revolute", "Translational", "Weld", "Distance", "PointOnLine", "RackAndPinion", "AbsoluteX", "AbsoluteY",
        "AbsoluteAngle", "AbsoluteDistance", "RelativeX", "RelativeY", "RelativeAngle", "Constraint",
        "Gravity", "Force", "Torque", "TSDA", "RSDA", "GeneralizedForce",
    }  # fmt: skip


# --- caching and strangers ---------------------------------------------------------------------------
def test_equations_and_compiled_expressions_are_made_once():
    """The same mechanism gives the same equations, the same expression the same function."""
    engine = slider_crank()
    eom = mbd.equations(engine)
    assert mbd.equations(engine) is eom
    crank = engine.body("crank")
    speed = crank.at(0.05, 0).vx
    assert eom.function(speed) is eom.function(speed)
    assert eom.function(ca.vertcat(crank.x, speed)) is eom.function(ca.vertcat(crank.x, speed))
    assert eom.function(ca.horzcat(crank.x, speed)) is not eom.function(ca.vertcat(crank.x, speed))
    assert mbd.equations(engine.replace(forces=[mbd.Gravity()], inputs=[])) is not eom


@pytest.mark.slow
def test_cached_functions_do_not_mix_up_expressions_that_come_and_go():
    """A thousand short-lived expressions each give their own value."""
    body = mbd.Body("body", 1, 1)
    eom = mbd.equations(mbd.Mechanism(bodies=[body]))
    arguments = (0, [2.0, 3, 4], [0] * 3, [0] * 3, [], [], [], [])
    for k in range(1000):
        assert eom.value(body.x * k + 1, arguments).item() == 2.0 * k + 1


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (mbd.Body("stranger", 1, 1).phi, "stranger"),
        (mbd.Input("other input"), "input 'other input'"),
        (mbd.Parameter("other", 1.0) * 2, "other"),
        (ca.SX.sym("loose"), "symbol 'loose'"),
    ],
)
def test_an_expression_with_a_foreign_symbol_is_refused(expression, words):
    """The message names the symbol."""
    eom = mbd.equations(slider_crank())
    with pytest.raises(mbd.ExpressionError, match="does not have") as error:
        eom.function(expression)
    assert words in str(error.value)


def test_only_a_mechanism_has_equations():
    """Anything else is refused."""
    with pytest.raises(mbd.MechanismError, match="Mechanism"):
        mbd.equations([mbd.Body("body", 1, 1)])


def test_forward_dynamics_exports_to_c(tmp_path, monkeypatch):
    """The function is C code on demand, with the arguments of the textbook."""
    monkeypatch.chdir(tmp_path)
    function = mbd.equations(slider_crank()).forward_dynamics
    assert function.name_in() == ["t", "q", "v", "z", "u", "p"] and function.name_out() == ["a", "lam"]
    function.generate("dynamics.c")
    assert "forward_dynamics" in (tmp_path / "dynamics.c").read_text()


def test_expressions_keep_their_shape():
    """A state gives floats, vectors and matrices; Phi_q is (m, n)."""
    engine = slider_crank()
    state, eom = mbd.assemble(engine), mbd.equations(engine)
    crank = engine.body("crank")
    assert isinstance(state[crank.phi], float)
    assert state[crank.position].shape == (2,)
    assert state[eom.Phi_q].shape == (8, 9)
    assert state[crank.at(0, 0).axes].shape == (2, 2)


# --- elements of the user's own -----------------------------------------------------------------------
class OnParabola:
    """A constraint from outside the package, a plain class: a point stays on ``y = c x²``, a weak spring pulls it."""

    def __init__(self, name, marker, curvature):
        self.name = name
        self.description = f"parabola '{name}'"
        self.markers = (marker,)
        self.bodies = (marker.body, mbd.ground)
        self.rows = ca.SX(marker.y - curvature * marker.x**2)
        self.velocity_rows = ca.SX(0, 1)
        self.row_labels = ()
        self.row_names = (name,)
        self.multipliers = ca.SX.sym(f"{name}.lam")
        self.coordinates = ()
        self.virtual_work = ((marker.x, -3.0 * marker.x),)
        self.rates = {}
        self.potential = 1.5 * marker.x**2

    def expressions(self):
        """What enters the equations."""
        return [self.rows, *(ca.SX(part) for pair in self.virtual_work for part in pair)]


def test_a_plain_class_with_the_attributes_of_an_element_is_a_full_citizen():
    """A bead on a parabola: rows, multiplier, force and potential are taken up, and the acceleration is right."""
    mass, c, x, vx = 2.0, 0.7, 0.4, 1.5
    bead = mbd.Body("bead", mass=mass, inertia=0.1, pose=(x, 0.1, 0), velocity=(vx, 0, 0))
    wire = OnParabola("wire", bead.at(0, 0), c)
    model = mbd.Mechanism(bodies=[bead], joints=[wire], forces=[mbd.Gravity()])
    eom = mbd.equations(model)
    assert eom.row_names == ("wire",)
    state = mbd.assemble(model, [bead.x == x, bead.vx == vx])
    assert state[bead.y] == pytest.approx(c * x**2, abs=1e-14)
    slope = 2 * c * x
    wanted = (-3 * x - mass * slope * (2 * c * vx**2 + 9.81)) / (mass * (1 + slope**2))
    assert state[bead.ax] == pytest.approx(wanted, rel=1e-12)
    assert state[wire.multipliers] == pytest.approx(-mass * (state[bead.ay] + 9.81), rel=1e-12)
    assert state[eom.potential] == pytest.approx(1.5 * x**2 + mass * 9.81 * c * x**2)


class Drag:
    """A force from outside the package, with nothing but what a force has to say."""

    def __init__(self, name, body):
        self.name = name
        self.description = f"drag '{name}'"
        self.bodies = (body,)
        self.markers = ()
        self.rows = self.velocity_rows = self.multipliers = ca.SX(0, 1)
        self.coordinates = ()
        self.virtual_work = ((body.position, -0.5 * mbd.norm(body.velocity) * body.velocity),)
        self.rates = {}
        self.potential = 0

    def expressions(self):
        """What enters the equations."""
        return [part for pair in self.virtual_work for part in pair]


def test_a_plain_class_may_be_a_force():
    """Quadratic drag."""
    ball = mbd.Body("ball", mass=2.0, inertia=0.1, velocity=(3, 4, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[ball], forces=[Drag("air", ball)]))
    np.testing.assert_allclose(state[ball.acceleration], [-3.75, -5.0], rtol=1e-12)


class Skate(mbd.model.element.ConstraintElement):
    """A knife edge: no velocity across the blade (a velocity-level row, from outside the package)."""

    def __init__(self, name, marker):
        across = mbd.dot(marker.y_axis, marker.velocity)
        super().__init__(name, ca.SX(0, 1), (), (marker,), velocity_rows=across)


def test_a_velocity_level_row_holds_at_velocity_and_acceleration():
    """A skate: ``Phi_q v = 0`` across the blade, ``Phi_q a = gamma`` its rate; it slides freely along."""
    board = mbd.Body("board", mass=2.0, inertia=0.3, pose=(0.1, 0.2, 0.5), velocity=(1.0, -1.0, 2.0))
    blade = board.at(0.2, 0, angle=0.1)
    skate = Skate("skate", blade)
    model = mbd.Mechanism(bodies=[board], joints=[skate], forces=[mbd.Gravity((1.0, -2.0))])
    eom = mbd.equations(model)
    assert eom.Phi.shape == (0, 1) and eom.Phi_q.shape == (1, 3) and eom.row_names == ("skate",)
    assert eom.position_rows.size == 0
    state = mbd.assemble(model)
    across = mbd.dot(blade.y_axis, blade.velocity)
    assert state[across] == pytest.approx(0, abs=1e-12)
    assert state[mbd.time_derivative(across)] == pytest.approx(0, abs=1e-12)
    along, force = state[blade.x_axis], state[skate.reaction_on(board).force]
    assert along @ force == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(2.0 * (state[board.acceleration] - [1, -2]), force, atol=1e-12)


def test_rows_of_both_levels_stand_in_the_order_of_the_elements():
    """Position rows and velocity rows interleaved: names, Phi_q and gamma agree with each element."""
    board = mbd.Body("board", mass=2.0, inertia=0.3, pose=(0.1, 0.2, 0.5))
    other = mbd.Body("other", mass=1.0, inertia=0.1, pose=(0.5, 0.2, 0.0))
    skate = Skate("skate", board.at(0.2, 0))
    pin = mbd.Revolute("pin", board.at(0.4, 0), other.at(-0.3, 0))
    held = mbd.AbsoluteAngle("held", other.at(0, 0), 0.1 * mbd.t)
    eom = mbd.equations(mbd.Mechanism(bodies=[board, other], joints=[skate, pin, held]))
    assert eom.row_names == ("skate", "pin.x", "pin.y", "held")
    np.testing.assert_array_equal(eom.position_rows, [1, 2, 3])
    rng = np.random.default_rng(0)
    t, q, v, a, *rest = 0.3, rng.normal(size=6), rng.normal(size=6), rng.normal(size=6), [], [0] * 4, [], []
    rows = ca.vertcat(skate.velocity_rows, mbd.time_derivative(ca.vertcat(pin.rows, held.rows)))
    level = eom.function(rows)
    value, (rate, _) = (
        level(t, q, v, a, *rest).full().ravel(),
        central(lambda s: level(t + s, q + s * v + s**2 / 2 * a, v + s * a, a, *rest).full().ravel(), 2e-3),
    )
    Phi_q, nu, gamma = (eom.function(x)(t, q, v, a, *rest).full() for x in (eom.Phi_q, eom.nu, eom.gamma))
    np.testing.assert_allclose(Phi_q @ v - nu.ravel(), value, atol=1e-13)
    np.testing.assert_allclose(Phi_q @ a - gamma.ravel(), rate, atol=1e-8)


class CamPin(mbd.model.element.ConstraintElement):
    """A pin on a curve of another body with the curve's parameter as a coordinate of its own."""

    def __init__(self, name, cam, pin, value):
        self.parameter = mbd.Coordinate(f"{name}.parameter", value)
        s = self.parameter
        point = cam.position + cam.axes @ mbd.vertcat(s, 0.5 * s**2)
        super().__init__(name, point - pin.position, ("x", "y"), (cam, pin))
        self.coordinates = (s,)


@pytest.mark.slow
def test_coordinates_without_inertia_follow_the_bodies():
    """``q`` ends with them, their mass is zero, and the pin follows ``y = x²/2``."""
    bead = mbd.Body("bead", mass=1.5, inertia=0.2, pose=(0.3, 0, 0), velocity=(1, 0, 0))
    slot = CamPin("slot", mbd.ground.at(0, 0), bead.at(0, 0), 0.2)
    model = mbd.Mechanism(bodies=[bead], joints=[slot], forces=[mbd.Gravity()])
    eom = mbd.equations(model)
    assert eom.coordinate_names == ("bead.x", "bead.y", "bead.phi", "slot.parameter")
    assert eom.masses(np.zeros(0)).tolist() == [1.5, 1.5, 0.2, 0.0]
    state = mbd.assemble(model, [bead.x == 0.4, bead.vx == 1.0])
    assert state[slot.parameter] == pytest.approx(0.4, abs=1e-13)
    assert state[slot.parameter.velocity] == pytest.approx(1.0, abs=1e-12)
    assert state[bead.y] == pytest.approx(0.08, abs=1e-13)
    wanted = -0.4 * (1.0 + 9.81) / (1 + 0.16)
    assert state[bead.ax] == pytest.approx(wanted, rel=1e-12)


class Motor:
    """An element that owns a first-order state."""

    def __init__(self, name, body, voltage):
        self.name = name
        self.description = f"motor '{name}'"
        self.current = mbd.StateVariable(f"{name}.current", value=0.5)
        self.bodies = (body,)
        self.markers = ()
        self.rows = self.velocity_rows = self.multipliers = ca.SX(0, 1)
        self.coordinates = ()
        self.virtual_work = ((body.phi, 2.0 * self.current),)
        self.rates = {self.current: (voltage - 2.0 * body.omega - self.current) / 0.1}
        self.potential = 0

    def expressions(self):
        """What enters the equations."""
        return [*(ca.SX(p) for pair in self.virtual_work for p in pair), *self.rates.values()]


def test_an_element_may_own_states():
    """They join those of the mechanism, with their rates."""
    rotor = mbd.Body("rotor", mass=1.0, inertia=0.25, velocity=(0, 0, 3.0))
    voltage = mbd.Input("voltage", value=12.0)
    motor = Motor("motor", rotor, voltage)
    model = mbd.Mechanism(bodies=[rotor], forces=[motor], inputs=[voltage])
    assert model.states == (motor.current,)
    state = mbd.assemble(model)
    assert state[rotor.alpha] == pytest.approx(2.0 * 0.5 / 0.25)
    assert state[mbd.time_derivative(motor.current, model)] == pytest.approx((12 - 6 - 0.5) / 0.1)


def test_equations_without_constraints():
    """A free body has no rows, and none are printed."""
    body = mbd.Body("stone", mass=2.0, inertia=0.5)
    eom = mbd.equations(mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()]))
    lines = str(eom).splitlines()
    assert lines[:2] == ["Equations of motion, without constraints", "  M a = Q        n = 3 coordinates"]
    assert "  stone.y    -19.62" in lines and not {"Phi", "Phi_q", "nu", "gamma"} & set(lines)
    assert "-19.62" in eom._repr_latex_() and "Phi" not in eom._repr_latex_()


def test_forward_dynamics_refuses_friction_that_switches_exactly():
    """It would leave the friction out."""
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3))
    eom = mbd.equations(mbd.Mechanism([block], joints=[guide], forces=[mbd.Gravity(), rub]))
    with pytest.raises(mbd.ModelError, match="'rub' switches exactly"):
        _ = eom.forward_dynamics
