"""Results as a notebook shows them: tables with the numbers of the results, and names that are no markup."""

from html.parser import HTMLParser

import numpy as np
import pytest

import mbdcasadi as mbd


class Cells(HTMLParser):
    """Rows of a table as text; fails if tags do not match."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.open, self.text = [], [], []
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data

    def row(self, name):
        return next(row for row in self.rows if row[0] == name)


@pytest.fixture(scope="module")
def pendulum():
    """An arm with a name that looks like markup, a stiffness, and a first-order state."""
    stiffness = mbd.Parameter("k", 3.0, lower=0, upper=10)
    arm = mbd.Body("<arm>", 1.0, 1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(-0.5, 0), stiffness=stiffness)
    charge = mbd.StateVariable("charge", 2.0)
    return mbd.Mechanism(
        [arm], joints=[hinge], forces=[mbd.Gravity(), spring], parameters=[stiffness], states={charge: -charge}
    )


def test_a_state_shows_its_coordinates(pendulum):
    (arm,) = pendulum.bodies
    state = mbd.assemble(pendulum, [arm.phi == 0.25, arm.omega == -2])
    cells = Cells(state._repr_html_())
    assert cells.rows[0][1:] == ["x, m", "y, m", "phi, rad", "vx, m/s", "vy, m/s", "omega, rad/s"]
    np.testing.assert_allclose(np.array(cells.row("<arm>")[1:], float), np.r_[state.q, state.v], rtol=1e-5)
    assert "charge = 2" in cells.text


def test_an_equilibrium_shows_whether_it_is_stable(pendulum):
    assert any("stable" in text for text in Cells(mbd.equilibrium(pendulum)._repr_html_()).text)


def test_a_motion_shows_its_summary(pendulum):
    motion = mbd.simulate(pendulum, duration=0.5)
    cells = Cells(motion._repr_html_())
    assert cells.row("outputs")[1] == "201, t = 0 … 0.5 s"
    largest = np.max(np.hypot(*motion[pendulum.joint("hinge").reaction_on(pendulum.bodies[0]).force].T))
    assert f"{largest:.4g} N at t" in cells.row("largest reaction")[1]


def test_a_report_shows_its_lines(pendulum):
    report = mbd.check(pendulum)
    cells = Cells(report._repr_html_())
    assert cells.row("degrees of freedom")[1] == "1" and "can be simulated" in cells.text[0]
    assert [" ".join(row) for row in cells.rows] == [" ".join(line.split()) for line in str(report).splitlines()]


def test_a_solution_shows_cost_and_parameters():
    push = mbd.Input("push", lower=-10, upper=10)
    block = mbd.Body("block", 1.0, 0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    cart = mbd.Mechanism([block], joints=[guide], forces=[mbd.Force("f", block.at(0, 0), (push, 0))], inputs=[push])
    problem = mbd.OptimalControlProblem(
        cart, duration=1.0, initial=[block.x == 0, block.vx == 0], final=[block.x == 1, block.vx == 0],
        running_cost=push**2,
    )  # fmt: skip
    solution = mbd.optimize(problem, intervals=4)
    cells = Cells(solution._repr_html_())
    assert float(cells.row("cost")[1]) == pytest.approx(12.0, rel=1e-6)  # 12 d² / T³, by calculus
    assert cells.row("duration")[1] == "1 s" and cells.row("mesh intervals")[1] == "4"


def test_a_fit_shows_standard_errors(pendulum):
    (arm,), (stiffness,) = pendulum.bodies, pendulum.parameters
    times = np.linspace(0, 1, 21)
    motion = mbd.simulate(pendulum, times, parameters={stiffness: 4.0})
    noise = 1e-4 * np.random.default_rng(1).standard_normal(21)
    fit = mbd.identify(pendulum, times, data=[(arm.phi, motion[arm.phi] + noise)], unknowns=[stiffness])
    value, error = Cells(fit._repr_html_()).row("k")[1:]
    assert float(value) == pytest.approx(fit[stiffness], rel=1e-5) and fit[stiffness] == pytest.approx(4.0, abs=0.01)
    assert float(error) == pytest.approx(fit.standard_error[stiffness], rel=0.1)


def test_a_sweep_shows_its_cases(pendulum):
    (arm,), (stiffness,) = pendulum.bodies, pendulum.parameters
    swept = mbd.sweep(pendulum, np.linspace(0, 0.1, 3), {stiffness: np.linspace(1, 5, 30)}, {"phi": arm.phi})
    cells = Cells(swept._repr_html_())
    assert cells.rows[0] == ["case", "k", ""] and cells.row("0") == ["0", "1", "done"]
    assert len(cells.rows) == 1 + 12 and cells.row("29") == ["29", "5", "done"]
    few = mbd.sweep(pendulum, np.linspace(0, 0.1, 3), {stiffness: [1.0, 2.0]}, {"phi": arm.phi})
    assert len(Cells(few._repr_html_()).rows) == 3
