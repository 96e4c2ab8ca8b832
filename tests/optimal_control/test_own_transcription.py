"""A transcription of the user's own: implicit midpoint, written in full, beside the scheme of one Gauss point."""

import casadi as ca
import numpy as np
import pytest
from motions import crank_rocker, half_turn

import mbdcasadi as mbd
from mbdcasadi.optimal_control.transcription.base import Transcription
from mbdcasadi.optimal_control.transcription.gauss_legendre import GaussLegendre
from mbdcasadi.optimal_control.transcription.points import Point


class Midpoint(Transcription):
    """Accelerations constant in each interval; the equations of motion hold in its middle."""

    name = "midpoint"
    order = 2
    stages = np.array([0.5])
    quadrature = np.array([1.0])

    def __init__(self, constraints, weights, inputs, degree):
        super().__init__(constraints, weights, inputs, degree)
        eom, nowhere = self.eom, np.array([np.nan])
        self.block_parts = {
            "a": (eom.q.numel(), self.stages),
            "lam": (len(self.rows), self.stages),
            "u": (eom.u.numel(), np.array(inputs.inner)),
            "rate": (eom.z.numel(), self.stages),
            "mu_1": (constraints.position_count, nowhere),
            "mu_2": (constraints.velocity_count, nowhere),
        }

    @staticmethod
    def input_points(degree):
        return (0.5,), False

    def point(self, interval, share):
        parts, node, h = self.block(interval.block), self.node(interval.node), interval.length
        u, u_rate = self._inputs(interval, share)
        return Point(
            interval.start + share * h,
            node["q"] + share * h * node["v"] + (share * h) ** 2 / 2 * parts["a"],
            node["v"] + share * h * parts["a"],
            parts["a"],
            node["z"] + share * h * parts["rate"],
            self.full_multipliers(parts["lam"]),
            u,
            u_rate,
        )

    def equations(self, interval, scales):
        parts, (at,) = self.block(interval.block), self.points(interval)
        rate = self._motion(*at.arguments[:-1], interval.p)[2]
        end, after = self.point(interval, 1.0), self.node(interval.next_node)
        _, position_jacobian, jacobian, _ = self.constraints.function(end.t, after["q"], interval.p)
        metric = ca.diag(ca.DM(1 / self.weights))
        q, v = end.q + metric @ (position_jacobian.T @ parts["mu_1"]), end.v + metric @ (jacobian.T @ parts["mu_2"])
        return [
            *self.motion_rows(at, interval.p, 0.5, scales),
            self._state_rows(parts["rate"] - rate, "rate of", 0.5, scales.z / scales.time),
            self._continuity(after["q"] - q, "q", scales.q, scales),
            self._continuity(after["v"] - v, "v", scales.v, scales),
            self._state_rows(after["z"] - end.z, "continuity of", 1.0, scales.z),
            *self.constraint_rows(after["q"], after["v"], end.t, interval.p, 1.0, scales),
        ]


@pytest.fixture(scope="module")
def turn():
    """Half a turn of a four-bar."""
    return half_turn(crank_rocker())


def test_is_the_scheme_of_one_gauss_point(turn):
    own = mbd.optimize(turn, intervals=20, transcription=Midpoint)
    theirs = mbd.optimize(turn, intervals=20, degree=1)
    assert own.cost == pytest.approx(theirs.cost, rel=1e-8)
    np.testing.assert_allclose(own.trajectory.final.q, theirs.trajectory.final.q, atol=1e-8)
    assert own.trajectory.statistics.method == "midpoint"


def test_a_class_of_the_package_is_its_name(turn):
    by_class = mbd.optimize(turn, intervals=10, transcription=GaussLegendre)
    assert by_class.cost == pytest.approx(mbd.optimize(turn, intervals=10).cost, rel=1e-12)


def test_is_not_saved_by_name(turn, tmp_path):
    own = mbd.optimize(turn, intervals=10, transcription=Midpoint)
    with pytest.raises(mbd.ModelError, match=r"'midpoint', which is no part of the package.*save solution.trajectory"):
        own.save(tmp_path / "own.npz")
    own.trajectory.save(tmp_path / "motion.npz")
    assert not (tmp_path / "own.npz").exists()


@pytest.mark.parametrize("wrong", ["trapezoid", Transcription.__mro__[1], Midpoint.point, None])
def test_anything_else_is_refused(turn, wrong):
    with pytest.raises(mbd.ModelError, match="one of gauss-legendre, hermite-simpson or a subclass of"):
        mbd.optimize(turn, transcription=wrong)
