"""Values at both ends and integrals, in costs and in boundary conditions."""

import numpy as np
import pytest
from motions import crank_rocker, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.model.placeholders import placeholders_in

at_end, at_start, integral = mbd.at_end, mbd.at_start, mbd.integral


def test_the_integral_as_a_running_cost():
    """Twice the integral is twice the running cost; its root has the same minimiser."""
    problem, u, _ = rest_to_rest(3.0, 2.0)
    plain = problem.replace(running_cost=0)
    assert mbd.optimize(plain.replace(terminal_cost=2 * integral(u**2)), intervals=6).cost == pytest.approx(27.0)
    root = mbd.optimize(plain.replace(terminal_cost=mbd.sqrt(1 + integral(u**2))), intervals=6)
    assert root.cost == pytest.approx(np.sqrt(14.5), rel=1e-9)
    both = mbd.optimize(problem.replace(terminal_cost=integral(u**2) + 1), intervals=6)
    assert both.cost == pytest.approx(28.0, rel=1e-9)


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_farthest_with_a_given_effort(transcription):
    """Isoperimetric: with the integral of u² at most E the block reaches d = sqrt(E T³ / 12)."""
    problem, u, block = rest_to_rest(1.0, 2.0)
    far = problem.replace(
        final=[block.vx == 0], running_cost=0, terminal_cost=-at_end(block.x), boundary=[integral(u**2) <= 6]
    )
    solution = mbd.optimize(far, intervals=8, transcription=transcription)
    assert solution.cost == pytest.approx(-np.sqrt(6 * 8 / 12), rel=1e-6)


def test_the_mean_of_a_motion():
    """Least effort with a given mean position: the integral constraint adds a quadratic force."""
    problem, _u, block = rest_to_rest(0.0, 1.0)
    bulge = problem.replace(boundary=[integral(block.x) == 1])
    solution = mbd.optimize(bulge, intervals=8)
    # x = 30 t² (1 - t)²: its integral is 1, and x'' squared integrates to 720
    assert solution.cost == pytest.approx(720.0, rel=1e-7)
    s = np.linspace(0, 1, 21)
    assert np.allclose(solution.trajectory.at(s)[block.x], 30 * s**2 * (1 - s) ** 2, atol=1e-7)


def test_start_and_end_in_the_terminal_cost():
    """Symbols outside placeholders are those at the end; at_start looks back."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    free = problem.replace(
        initial=[block.vx == 0],
        final=[block.vx == 0],
        terminal_cost=3 * (at_start(block.x) - 1) ** 2 + 6 * (block.x - 4) ** 2,
    )
    solution = mbd.optimize(free, intervals=4)
    # 12 (b - a)² + 3 (a - 1)² + 6 (b - 4)²
    a, b = np.linalg.solve([[30, -24], [-24, 36]], [6, 48])
    ends = solution.trajectory.at([0, 1])[block.x]
    assert ends == pytest.approx([a, b], rel=1e-8)
    assert solution.cost == pytest.approx(12 * (b - a) ** 2 + 3 * (a - 1) ** 2 + 6 * (b - 4) ** 2, rel=1e-9)


def test_accelerations_inputs_and_reactions_at_the_ends():
    """Boundary conditions may hold whatever an interval knows at its ends."""
    problem, u, block = rest_to_rest(3.0, 2.0)
    guide = problem.mechanism.joints[0]
    tied = problem.replace(boundary=[at_end(u) == -2 * at_start(u), at_end(block.ax) + at_start(u) == -1])
    solution = mbd.optimize(tied, intervals=8, degree=4)
    force = solution.trajectory.at([0, 2])[u]
    assert force[0] == pytest.approx(1.0, abs=1e-7) and force[1] == pytest.approx(-2.0, abs=1e-7)
    assert at_end(guide.reaction_on(block).torque) is not None


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_a_crank_that_turns_for_ever(transcription):
    """Periodic motion of a linkage: all rates return, the crank is one turn on, and a second turn follows the first."""
    f = crank_rocker()
    problem = mbd.OptimalControlProblem(
        f.mechanism,
        duration=0.8,
        initial=[f.crank.phi == 0.5],
        boundary=[
            at_end(f.crank.phi) == at_start(f.crank.phi) + 2 * np.pi,
            at_end(f.crank.omega) == at_start(f.crank.omega),
        ],
        running_cost=f.tau**2,
    )
    solution = mbd.optimize(problem, intervals=40, transcription=transcription)
    first, last = solution.state(0), solution.state(-1)
    assert last[f.crank.phi] - first[f.crank.phi] == pytest.approx(2 * np.pi, abs=1e-9)
    for e in (f.rocker.omega, f.coupler.vx, f.rocker.phi, f.coupler.phi):
        assert last[e] == pytest.approx(first[e], abs=1e-7)
    energy = 0.5 * sum(b.mass * (b.vx**2 + b.vy**2) + b.inertia * b.omega**2 for b in f.mechanism.bodies)
    assert last[energy] == pytest.approx(first[energy], rel=1e-7)
    # nothing is lost: without any torque it comes round again in the same time
    assert solution.cost < 1e-6
    free = mbd.simulate(f.mechanism, np.array([0.0, 0.8]), initial=first)
    assert free.final[f.crank.phi] == pytest.approx(
        0.5 + 2 * np.pi, abs=2e-3 if transcription == "gauss-legendre" else 0.1
    )


@pytest.mark.slow
def test_a_crank_that_turns_against_friction():
    """Over a period the motor does the work that the damper takes."""
    f = crank_rocker()
    damper = mbd.Torque("damper", f.rocker, -0.02 * f.rocker.omega)
    problem = mbd.OptimalControlProblem(
        f.mechanism.replace(forces=[*f.mechanism.forces, damper]),
        duration=0.8,
        initial=[f.crank.phi == 0.5],
        boundary=[
            at_end(f.crank.phi) == at_start(f.crank.phi) + 2 * np.pi,
            at_end(f.crank.omega) == at_start(f.crank.omega),
        ],
        running_cost=f.tau**2,
    )
    solution = mbd.optimize(problem, intervals=80)
    times = np.linspace(0, 0.8, 4001)
    motion = solution.trajectory.at(times)
    work = np.trapezoid(motion[f.tau * f.crank.omega], times)
    lost = np.trapezoid(motion[0.02 * f.rocker.omega**2], times)
    assert work == pytest.approx(lost, rel=1e-5) and lost > 0.01
    steady = mbd.simulate(problem.mechanism, np.array([0.0, 0.8]), initial=solution.state(0), inputs=solution.inputs)
    assert steady.final[f.crank.omega] == pytest.approx(solution.state(0)[f.crank.omega], rel=1e-4)


def test_a_placeholder_names_what_it_stands_for():
    """Labels in words; what is no scalar is refused."""
    block = mbd.Body("block", mass=1, inertia=1)
    for make, name in ((at_end, "at_end"), (at_start, "at_start"), (integral, "integral")):
        placeholder = make(block.x**2)
        assert str(placeholder) == f"{name}(block.x**2)"
        found = placeholders_in(3 * placeholder + block.y)
        assert [p.kind for p in found] == [name]
        for wrong in (None, "x", [1, 2], mbd.vertcat(block.x, block.y), float("nan")):
            with pytest.raises(mbd.MechanismError, match=name):
                make(wrong)


def test_other_analyses_refuse_placeholders():
    """They have a value in optimal control alone, and are never evaluated as the expression inside."""
    problem, u, block = rest_to_rest()
    solution = mbd.optimize(problem, intervals=4)
    state = mbd.assemble(problem.mechanism)
    for placeholder in (at_end(block.x), 2 * at_start(block.x) + 1, integral(u**2)):
        for result in (solution.trajectory, state):
            with pytest.raises(mbd.ExpressionError, match="placeholder"):
                result[placeholder]


def test_placeholders_do_not_nest():
    problem, _u, block = rest_to_rest()
    with pytest.raises(mbd.ExpressionError, match=r"contains at_start\(block.x\), which belongs in"):
        problem.replace(terminal_cost=at_end(at_start(block.x) + block.x))


def test_labels_of_boundary_conditions():
    """As the user wrote them, two-sided ones too."""
    problem, _u, block = rest_to_rest()
    rows = problem.replace(boundary=[mbd.bounded(-1, at_end(block.x) - at_start(block.x), 3)]).boundary
    assert [row.label for row in rows] == [
        "-1 <= at_end(block.x) - at_start(block.x)",
        "at_end(block.x) - at_start(block.x) <= 3",
    ]
    assert rows[1].opposite is rows[0]


def test_compiled_functions_of_placeholders():
    """Of several operands and outputs, which CasADi does not expand; inside the brackets and around them."""
    import casadi as ca

    problem, u, block = rest_to_rest(3.0, 2.0)
    x, y = ca.SX.sym("x", 2), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [x[0] ** 2 - y, ca.vertcat(3 * x[1], x[0] * y)], {"never_inline": True})
    ends = mbd.vertcat(at_end(block.x), integral(u**2))
    first, others = function(ends, at_start(block.x) + 1)
    around = problem.replace(terminal_cost=first + others[0] + others[1])
    # 9 - 1, 3 times 13.5, 3
    assert mbd.optimize(around, intervals=6).cost == pytest.approx(13.5 + 8 + 40.5 + 3, rel=1e-8)
    inside = problem.replace(terminal_cost=at_end(function(mbd.vertcat(block.x, 0), 1)[0]))
    assert mbd.optimize(inside, intervals=6).cost == pytest.approx(13.5 + 8, rel=1e-8)
