"""Homotopy with step control, roots in brackets, projections, line searches."""

import numpy as np
import pytest

from mbdcasadi.numerics.homotopy import Step, StepControl, follow
from mbdcasadi.numerics.least_squares import least_norm, project_velocity
from mbdcasadi.numerics.newton import backtrack, newton, solve
from mbdcasadi.numerics.roots import bracketed_root


def circle(longest):
    """Advance on a unit circle by its angle; no step is longer than allowed."""

    def advance(point, at, to):
        if to - at > longest:
            return None
        return Step(np.array([np.cos(to), np.sin(to)]), easily=to - at < longest / 3)

    return advance


def test_homotopy_reaches_the_end_in_steps_that_are_short_enough():
    visited = []

    def advance(point, at, to):
        found = circle(0.1)(point, at, to)
        visited.append((at, to, found is not None))
        return found

    path = follow(np.array([1.0, 0]), advance, end=2.0, step=2.0)
    assert path.complete and path.at == 2.0
    np.testing.assert_allclose(path.point, [np.cos(2), np.sin(2)])
    good = [(at, to) for at, to, ok in visited if ok]
    assert all(to - at <= 0.1 for at, to in good)
    assert [at for at, _ in good[1:]] == [to for _, to in good[:-1]]


def test_homotopy_stops_at_the_last_good_point():
    path = follow(0.0, lambda point, at, to: Step(to) if to < 0.7 else None, smallest=1e-9)
    assert not path.complete
    assert path.point == path.at == pytest.approx(0.7, abs=1e-8)
    assert 0.7 <= path.failed <= path.at + 1e-8


def test_step_control_grows_no_further_than_allowed():
    control = StepControl(1.0, 0.2, 3.0)
    control.accept()
    control.accept()
    assert control.step == 3.0
    control.accept(easily=False)
    assert control.step == 3.0
    assert [control.refuse() for _ in range(4)] == [True, True, True, False]


@pytest.mark.parametrize(
    "function, root",
    [
        (lambda x: np.sin(x) - 0.5, np.arcsin(0.5)),
        (lambda x: (x - 0.3) ** 5, 0.3),
        (lambda x: np.sign(x - 0.3), 0.3),
        (lambda x: 1e9 * (x - 0.3) if x > 0.3 else x - 0.3, 0.3),
        (lambda x: np.exp(30 * x) - np.exp(9), 0.3),
    ],
)
def test_bracketed_roots_are_found_from_the_right(function, root):
    for course in (function, lambda x: -function(x)):
        found = bracketed_root(course, 0, 1, course(0), course(1), 1e-13)
        assert root - 1e-15 <= found <= root + 1.1e-13
        assert course(found) * course(1) >= 0


def test_a_line_search_takes_the_first_share_that_is_accepted():
    tried = []

    def attempt(share):
        tried.append(share)
        return "found" if share < 0.3 else None

    assert backtrack(attempt) == "found" and tried == [1.0, 0.5, 0.25]
    assert backtrack(lambda share: None, smallest=0.2) is None


def test_projected_velocity_is_the_one_after_an_impulse():
    generator = np.random.default_rng(1)
    jacobian, mass = generator.normal(size=(3, 6)), 10 ** generator.uniform(-3, 3, 6)
    jacobian = np.vstack([jacobian, jacobian[0] + jacobian[1]])  # a row that others imply
    v, right = generator.normal(size=6), jacobian @ generator.normal(size=6)
    found = project_velocity(jacobian, right, v, mass)
    np.testing.assert_allclose(jacobian @ found, right, atol=1e-12)
    impulse = np.linalg.lstsq(jacobian.T, mass * (v - found), rcond=None)[0]
    np.testing.assert_allclose(mass * (found - v) + jacobian.T @ impulse, 0, atol=1e-9)
    np.testing.assert_array_equal(project_velocity(jacobian, jacobian @ v, v), v)


def test_least_norm_of_several_right_sides():
    matrix = np.array([[1.0, 1.0], [2.0, 2.0]])
    found = least_norm(matrix, np.array([[1.0, 3], [2, 6]]), weights=np.array([1.0, 3.0]))
    np.testing.assert_allclose(found, [[0.75, 2.25], [0.25, 0.75]])


@pytest.mark.parametrize("size", [1e-9, 1e-3, 1e6])
def test_accuracy_is_relative_to_the_size_of_the_unknowns(size):
    """A point on a circle of nanometres, or of a thousand kilometres."""

    def equations(x):
        return np.array([np.hypot(*x) - size]), (x / np.hypot(*x))[None, :]

    def bent(x):
        return np.array([(x @ x / size - size)]), 2 * x[None, :] / size

    for rows in (equations, bent):
        outcome = solve(rows, size * np.array([0.3, 1.4]), np.ones(2), sizes=np.full(2, size))
        assert outcome.converged
        assert abs(np.hypot(*outcome.x) / size - 1) < 1e-12


def test_newton_sees_directions_that_differ_by_ten_orders():
    stiff = np.diag([1.0, 1e-10])
    found = newton(lambda x: (stiff @ (x - [1, 2]), stiff), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(found, [1, 2], rtol=1e-4)
    assert newton(lambda x: (x**2 + 1, np.diag(2 * x)), np.ones(1), np.ones(1)) is None
