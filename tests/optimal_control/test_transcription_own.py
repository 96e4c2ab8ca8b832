"""A transcription of the user's own: implicit midpoint, written in full, beside the scheme of one Gauss point."""

from dataclasses import replace

import numpy as np
import pytest
from motions import crank_rocker, half_turn

import mbdcasadi as mbd
from mbdcasadi.optimal_control.transcription.points import Interval


class Midpoint(mbd.Transcription):
    """Accelerations constant in each interval; the equations of motion hold in its middle."""

    name = "midpoint"
    order = 2
    stages = np.array([0.5])
    quadrature = np.array([1.0])

    @property
    def interval_variables(self):
        nowhere = np.array([np.nan])
        return {
            "a": (self.eom.q.numel(), self.stages),
            "lam": (len(self.rows), self.stages),
            "u": (self.eom.u.numel(), np.array(self.inputs.inner)),
            "rate": (self.eom.z.numel(), self.stages),
            "mu_1": (self.constraints.position_count, nowhere),
            "mu_2": (self.constraints.velocity_count, nowhere),
        }

    def input_points(self, *, lower_degree):
        return (0.5,), False

    def point(self, interval, tau):
        inner, first, h = self.split_interval(interval.inner), self.split_point(interval.first), interval.length
        return mbd.CollocationPoint(
            interval.start + tau * h,
            first["q"] + tau * h * first["v"] + (tau * h) ** 2 / 2 * inner["a"],
            first["v"] + tau * h * inner["a"],
            inner["a"],
            first["z"] + tau * h * inner["rate"],
            self.full_multipliers(inner["lam"]),
            *self.inputs_at(interval, tau),
        )

    def equations(self, interval, scales):
        inner, p, (at,) = self.split_interval(interval.inner), interval.p, self.points(interval)
        end, last = self.point(interval, 1.0), self.split_point(interval.last)
        dq, dv = self.corrections(end.t, last["q"], p, inner["mu_1"], inner["mu_2"])
        return [
            *self.motion_rows(at, p, 0.5, scales),
            self.state_rate_rows(inner["rate"] - self.state_rates(at, p), 0.5, scales),
            self.continuity_rows(last["q"] - end.q - dq, scales),
            self.continuity_rows(last["v"] - end.v - dv, scales, velocities=True),
            self.state_continuity_rows(last["z"] - end.z, 1.0, scales),
            *self.constraint_rows(last["q"], last["v"], end.t, p, 1.0, scales),
        ]


class Chained(Midpoint):
    """A row that sees a point of an interval which begins at a point of another one."""

    name = "chained"

    def equations(self, interval, scales):
        first, *others = super().equations(interval, scales)
        middle = self.at(interval, 0.5)
        other = replace(interval, points={}, first=interval.first * (1 + 1e-3 * middle.v[0]))
        seen = self.at(other, 0.25)
        return [replace(first, expression=first.expression + 1e-3 * seen.q[0] * seen.v[0]), *others]


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
    by_class = mbd.optimize(turn, intervals=10, transcription=mbd.GaussLegendre)
    assert by_class.cost == pytest.approx(mbd.optimize(turn, intervals=10).cost, rel=1e-12)


def test_is_not_saved_by_name(turn, tmp_path):
    own = mbd.optimize(turn, intervals=10, transcription=Midpoint)
    with pytest.raises(mbd.ModelError, match=r"'midpoint', which is not part of the package.*save solution.trajectory"):
        own.save(tmp_path / "own.npz")
    own.trajectory.save(tmp_path / "motion.npz")
    assert not (tmp_path / "own.npz").exists()


@pytest.mark.parametrize("wrong", ["trapezoid", mbd.Transcription, mbd.Transcription.__mro__[1], Midpoint.point, None])
def test_anything_else_is_refused(turn, wrong):
    with pytest.raises(mbd.ModelError, match="one of gauss-legendre, hermite-simpson or a subclass of"):
        mbd.optimize(turn, transcription=wrong)


@pytest.mark.slow
def test_an_object_has_its_own_degree(turn):
    """Of a class of the package and of the user's own."""
    by_object = mbd.optimize(turn, intervals=12, transcription=mbd.GaussLegendre(degree=2))
    by_name = mbd.optimize(turn, intervals=12, degree=2)
    assert by_object.cost == pytest.approx(by_name.cost, rel=1e-12)
    assert by_object.program.size == by_name.program.size
    own = mbd.optimize(turn, intervals=12, transcription=Midpoint())
    assert own.cost == pytest.approx(mbd.optimize(turn, intervals=12, transcription=Midpoint).cost, rel=1e-12)


def test_an_object_of_a_scheme_of_the_package_is_saved(turn, tmp_path):
    solution = mbd.optimize(turn, intervals=10, transcription=mbd.GaussLegendre(degree=2))
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", turn)
    assert back.cost == solution.cost and back.verify().final_error == pytest.approx(solution.verify().final_error)


@pytest.mark.slow
def test_one_object_serves_several_problems(turn):
    """What it knows of the equations of one problem does not reach the next one."""
    scheme = mbd.HermiteSimpson()
    first = mbd.optimize(turn, intervals=10, transcription=scheme)
    f = crank_rocker(length=2.0)
    other = half_turn(f, path=[f.tau <= 5])
    assert mbd.optimize(other, intervals=10, transcription=first.program.phases[0].scheme).cost == pytest.approx(
        mbd.optimize(other, intervals=10, transcription="hermite-simpson").cost, rel=1e-10
    )


class Padded(Midpoint):
    """A scheme with a variable of its own, which is always zero."""

    @property
    def interval_variables(self):
        return super().interval_variables | {"spare": (1, np.array([np.nan]))}

    def equations(self, interval, scales):
        from mbdcasadi.optimal_control.transcription.rows import Rows

        spare = self.split_interval(interval.inner)["spare"]
        return [*super().equations(interval, scales), Rows(spare, ("spare",), 0.5, np.ones(1), ("",))]


class Sized(Padded):
    def variable_sizes(self, scales):
        return super().variable_sizes(scales) | {"spare": np.ones(1)}


def test_variables_of_its_own(turn):
    """Their size is asked for by name."""
    with pytest.raises(mbd.ModelError, match="'midpoint'.*'spare'.*variable_sizes"):
        mbd.optimize(turn, intervals=8, transcription=Padded)
    sized = mbd.optimize(turn, intervals=8, transcription=Sized)
    assert sized.cost == pytest.approx(mbd.optimize(turn, intervals=8, transcription=Midpoint).cost, rel=1e-8)


class Stubborn(Midpoint):
    def __init__(self):
        """Nothing is made of a degree."""


def test_a_class_that_takes_no_degree(turn):
    with pytest.raises(mbd.ModelError, match="Stubborn does not take the degree.*give an object"):
        mbd.optimize(turn, intervals=8, transcription=Stubborn)
    assert mbd.optimize(turn, intervals=8, transcription=Stubborn()).cost > 0


@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
def test_points_of_intervals_that_begin_at_points(monkeypatch):
    """The optimum is that of rows in which no symbols stand for the values at points."""
    problem = half_turn(crank_rocker())
    chained = mbd.optimize(problem, intervals=6, transcription=Chained)
    monkeypatch.setattr(Interval, "with_symbols", lambda interval: interval)
    whole = mbd.optimize(half_turn(crank_rocker()), intervals=6, transcription=Chained)
    assert chained.cost == pytest.approx(whole.cost, rel=1e-8)
    assert chained.cost != pytest.approx(mbd.optimize(problem, intervals=6, transcription=Midpoint).cost, rel=1e-6)
