"""Where an expression changes from piece to piece stands in its graph, for an integrator to read.

At each joint a comparison that is affine in the argument changes its truth, or a ``floor`` of something affine its
value; between them nothing does.
"""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

KNOTS = np.array([0.0, 0.3, 0.4, 1.1, 1.7, 2.0])
VALUES = np.array([0.0, 1.0, -0.5, 0.3, 0.6, 0.0])
COMPARISONS = (ca.OP_LT, ca.OP_LE)


def switches(expression):
    """Comparisons and floors of an expression in time: nodes that change by steps, each once."""
    found, seen, open_ = [], set(), [expression]
    while open_:
        node = open_.pop()
        if node.element_hash() in seen:
            continue
        seen.add(node.element_hash())
        if node.is_constant() or node.is_symbolic():
            continue
        if node.op() in COMPARISONS or node.op() == ca.OP_FLOOR:
            found.append(node)
        open_ += [node.dep(k) for k in range(node.n_dep())]
    return found


def breakpoints(expression, low, high):
    """Times in a range at which a switch changes; each must be one of something affine in the time, floors apart."""
    nodes = switches(expression)
    for node in nodes:
        inside = node.dep(0) - node.dep(1) if node.op() in COMPARISONS else node.dep(0)
        slope = ca.jacobian(inside, mbd.t)
        assert ca.jacobian(slope, mbd.t).nnz() == 0 and not ca.depends_on(slope, mbd.t), f"not affine: {node}"
    states = ca.Function("switches", [mbd.t], [ca.vertcat(*nodes)])

    def between(start, at_start, end, at_end):
        if np.array_equal(at_start, at_end):
            return []
        if end - start < 1e-11:
            return [(start + end) / 2]
        middle = (start + end) / 2
        here = states(middle).full()
        return between(start, at_start, middle, here) + between(middle, here, end, at_end)

    grid = np.linspace(low, high, 1013)
    values = states(grid[None, :]).full().T
    pieces = zip(grid[:-1], values[:-1, :, None], grid[1:], values[1:, :, None], strict=True)
    return np.array([time for piece in pieces for time in between(*piece)])


def assert_breaks(expression, low, high, wanted):
    found = breakpoints(expression, low, high)
    assert len(found) == len(wanted), f"{found} for {wanted}"
    np.testing.assert_allclose(found, wanted, atol=1e-9)


@pytest.mark.parametrize("outside", ["constant", "linear"])
@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
def test_knots_of_a_spline(kind, outside):
    assert_breaks(mbd.spline(mbd.t, KNOTS, VALUES, kind, outside), -0.5, 2.5, KNOTS)


@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
def test_knots_of_a_spline_that_ends_with_its_data(kind):
    """The end of the data is a break too, 1e-9 of their width further on."""
    found = breakpoints(mbd.spline(mbd.t, KNOTS, VALUES, kind), 0.1, 2.5)
    np.testing.assert_allclose(found, [0.3, 0.4, 1.1, 1.7, 2.0, 2.0 + 2e-9], atol=1e-10)


@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
def test_knots_of_periodic_data(kind):
    expression = mbd.spline(mbd.t - 0.1, KNOTS, VALUES, kind, "periodic")
    wanted = sorted(k + 2 * turn + 0.1 for turn in (0, 1, 2) for k in KNOTS[:-1])
    assert_breaks(expression, 0.05, 6.05, wanted)


def test_a_scaled_and_shifted_time():
    assert_breaks(mbd.spline(3 * (mbd.t - 1), KNOTS, VALUES, outside="constant") ** 2, 0.5, 2, 1 + KNOTS / 3)


def test_step_and_if_else():
    assert_breaks(5 * mbd.step(mbd.t, 0.7, 0, 0.9, 3), 0, 2, [0.7, 0.9])
    assert_breaks(mbd.if_else(mbd.t < 1.25, mbd.sin(mbd.t), 2.0), 0, 2, [1.25])


@pytest.mark.parametrize("law", ["cycloidal", "modified trapezoidal", "3-4-5", "harmonic"])
def test_joints_of_a_motion_program(law):
    """Segments and, of the trapezoidal law, its five pieces; over two periods."""
    program = mbd.MotionProgram(mbd.dwell(0.5), mbd.rise(0.8, 0.02, law), mbd.dwell(0.2), mbd.fall(1.5, law))
    joints = [0.0, 0.5, 1.3, 1.5]
    found = breakpoints(program(mbd.t), 0.01, 5.99)
    wanted = [j + turn for turn in (0, 3) for j in joints if j + turn > 0.01]
    for joint in wanted:
        assert np.min(np.abs(found - joint)) < 1e-9
    inner = [x for x in found if np.min(np.abs(np.array(wanted) - x)) > 1e-9]
    if law != "modified trapezoidal":
        assert inner == []
    else:
        shares = np.array([1, 3, 4, 5, 7]) / 8
        inside = np.sort([*(0.5 + 0.8 * shares), *(1.5 + 1.5 * shares), *(3.5 + 0.8 * shares), *(4.5 + 1.5 * shares)])
        for joint in inside:
            assert np.min(np.abs(np.array(inner) - joint)) < 1e-9


def test_a_gap_in_the_force_of_a_driven_machine_is_seen_through_the_model():
    """The graph of the equations holds the breaks of every expression of time in it."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (mbd.if_else(mbd.t > 0.6, 1.0, 0.0), 0))
    pull = mbd.TSDA("pull", mbd.ground.at(-1, 0), block.at(0, 0), actuator=mbd.spline(mbd.t, [0, 1], [0, 3], "linear"))
    eom = mbd.equations(mbd.Mechanism([block], [rail], forces=[push, pull]))
    nodes = [node for entry in ca.vertsplit(ca.densify(eom.Q)) for node in switches(entry)]
    nodes = [node for node in nodes if not ca.depends_on(node, eom.q)]
    at = ca.Function("at", [mbd.t], [ca.vertcat(*nodes)])
    times = np.array([0.59, 0.61, 0.99, 1.01])
    before_push, after_push, before_end, after_end = at(times[None, :]).full().T
    assert np.any(before_push != after_push) and np.any(before_end != after_end)
