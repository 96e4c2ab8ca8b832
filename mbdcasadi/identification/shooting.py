"""Multiple shooting: a motion in segments whose starts are unknowns of their own.

The starts ``x_k`` need not fit together until the end, so that data which lead
the segments keep a motion that is unstable, or far from the data, from running
away. They are eliminated again before the least-squares step: with
``x_{k+1} = F_k(x_k, theta) + gap`` linearised, every ``dx_k = P_k dtheta + e_k``
and one forward integration with as many directions as there are unknowns, and
one more for the gaps, gives the condensed Jacobian.

References
----------
Bock, "Numerical treatment of inverse problems in chemical reaction kinetics", 1981; Albersmeyer and Diehl, "The lifted
Newton method and its application in optimization", SIAM J. Optim. 20, 2010.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..errors import SimulationError
from ..integrators.failures import reason_of
from ..model.cache import Cache
from ..numerics.least_squares import largest, least_norm, project_velocity
from ..numerics.newton import solve
from ..numerics.rank import analyse_rank
from ..sensitivity.compiled_run import PATTERNS, MotionSetup
from ..sensitivity.cuts import Cuts
from ..sensitivity.derivatives import Compiled, lengths_of
from ..sensitivity.differentiable_start import found
from ..simulation.contact.compiled_elements import has_many_contacts
from .data import Experiment, range_of

#: Singular values below this share of the largest one belong to directions, or combinations of unknowns, that leave no
#: trace in the data.
UNSEEN = 1e-6


@dataclass
class Linearised:
    """Residuals of an experiment and how they change.

    Attributes
    ----------
    outputs : numpy.ndarray
        Model at the samples (n_y, n_t).
    slope : numpy.ndarray
        By the unknowns, gaps closed (n_y, n_t, n_theta).
    closing : numpy.ndarray
        Change of the outputs when the gaps close (n_y, n_t).
    gaps : numpy.ndarray
        (segments - 1, n_x).
    node_slope, node_closing : numpy.ndarray
        Change of the segments' starts (segments, n_x, n_theta) and (segments, n_x).
    """

    outputs: np.ndarray
    slope: np.ndarray
    closing: np.ndarray
    gaps: np.ndarray
    node_slope: np.ndarray
    node_closing: np.ndarray


class FitSetup(MotionSetup):
    """The arguments of an identification; "auto" takes DOP853 if it runs here, but for many contacts."""

    def _in_c(self) -> tuple[ca.SX, ...] | None:
        return None if has_many_contacts(self.numeric) else ()


class Shooting:
    """One experiment in segments.

    Parameters
    ----------
    places : list of int
        Positions of the unknowns among the parameters.
    segments : int
        Number of intervals.
    """

    def __init__(self, setup: MotionSetup, experiment: Experiment, places: list[int], segments: int):
        self.setup, self.experiment, self.places = setup, experiment, places
        self.motion = setup.motion(places)
        eom = setup.eom
        ends = np.unique(np.round(np.linspace(0, setup.grid.size - 1, segments + 1)).astype(int))
        self.spans = list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))
        self._compiled = Cache(PATTERNS * len(self.spans))
        self.guess = setup.differentiable_start.guess
        self.nodes = np.zeros((len(self.spans), eom.q.numel() + eom.v.numel() + eom.z.numel()))

    def _segment(self, k: int, x0: np.ndarray, theta: np.ndarray) -> tuple[Compiled, tuple[np.ndarray, ...]]:
        """Compiled function of a segment whose motion is cut as it is from a start, and the arguments of these cuts."""
        grid, values = self._span(k)
        course = self.motion.course(x0, values._replace(p=self._parameters(theta)), grid)
        compiled = self._compiled.get_or_create(
            (k, course.pattern), lambda: Compiled(self._function(k, course)), bounded=True
        )
        return compiled, course.arguments

    def _span(self, k: int) -> tuple[np.ndarray, RunValues]:
        """Output times of a segment, and the values of parameters and inputs as they were given."""
        (first, last), values = self.spans[k], self.motion.values
        return self.setup.grid[first : last + 1], values._replace(channel=values.channel[:, first:last])

    def _function(self, k: int, course: Cuts) -> ca.Function:
        """``(x0, theta, cuts, sides, borders) -> (end on the constraints, outputs, clock)`` of a segment."""
        motion, (grid, values) = self.motion, self._span(k)
        x0, theta = ca.MX.sym("x0", self.nodes.shape[1]), ca.MX.sym("theta", len(self.places))
        arguments = course.symbols
        p = ca.MX(ca.DM(values.p))
        p[self.places] = theta
        states, end = motion.motion(course, grid)(x0, p, *values[1:], *arguments)
        outputs = motion.outputs(self.experiment.outputs, grid)(states, p, *values[1:])
        return ca.Function("segment", [x0, theta, *arguments], [end, outputs, states])

    # --- evaluation --------------------------------------------------------------------
    def prepare(self, theta: np.ndarray) -> float:
        """Set the starts of the segments from a simulation, led by the data if it departs from them.

        Returns
        -------
        float
            Largest departure from the data over a segment, in ranges of the data; infinite if the simulation stops.
        """
        self.nodes[0], departure = self._start(theta)[0], 0.0
        samples, size = self.experiment.samples, range_of(self.experiment)
        for k, (first, _) in enumerate(self.spans[1:], start=1):
            try:
                guess, outputs = self._run(k - 1, self.nodes[k - 1], theta)
                off = np.abs(outputs[:, -1] - samples[:, first]) / size
                departure = max(departure, largest(off[self.experiment.measured[:, first]]))
            except SimulationError:
                guess, departure = self.nodes[k - 1], np.inf
            self.nodes[k] = nodes_from_data(self.setup, self.experiment, first, guess)
        return departure

    def evaluate(self, theta: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Outputs (n_y, n_t), gaps, and the starts, the first one as the conditions require."""
        nodes = nodes.copy()
        nodes[0], guess = self._start(theta)
        outputs, gaps = np.zeros(self.experiment.samples.shape), np.zeros((len(nodes) - 1, nodes.shape[1]))
        for k, (first, last) in enumerate(self.spans):
            end, values = self._run(k, nodes[k], theta)
            skip = 0 if k == 0 else 1  # where segments meet, the end of the first one is compared
            outputs[:, first + skip : last + 1] = values[:, skip:]
            if k + 1 < len(nodes):
                gaps[k] = end - nodes[k + 1]
        self.guess = guess
        return outputs, gaps, nodes

    def linearise(self, theta: np.ndarray) -> Linearised:
        """Outputs and gaps with their condensed derivatives at the present starts."""
        outputs, gaps, self.nodes = self.evaluate(theta, self.nodes)
        count, n_x = len(self.places), self.nodes.shape[1]
        n_y, n_t = outputs.shape
        slope, closing = np.zeros((n_y, n_t, count)), np.zeros((n_y, n_t))
        node_slope, node_closing = np.zeros((len(self.nodes), n_x, count)), np.zeros((len(self.nodes), n_x))
        node_slope[0] = self._start_slope(theta)
        for k, (first, last) in enumerate(self.spans):
            seeds = np.column_stack([node_slope[k], node_closing[k]])
            towards = np.column_stack([np.eye(count), np.zeros(count)])
            moved_end, moved = self._forward(k, theta, seeds, towards)
            moved = moved.reshape(count + 1, last - first + 1, n_y).transpose(2, 1, 0)
            skip = 0 if k == 0 else 1
            slope[:, first + skip : last + 1] = moved[:, skip:, :-1]
            closing[:, first + skip : last + 1] = moved[:, skip:, -1]
            if k + 1 < len(self.nodes):
                node_slope[k + 1], node_closing[k + 1] = moved_end[:, :-1], moved_end[:, -1] + gaps[k]
        return Linearised(outputs, slope, closing, gaps, node_slope, node_closing)

    def _forward(
        self, k: int, theta: np.ndarray, seeds: np.ndarray, towards: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        segment, cuts = self._segment(k, self.nodes[k], theta)
        arguments, lengths = [self.nodes[k], theta, *cuts], lengths_of(towards, theta)
        try:
            moved = segment.changes(arguments, segment(*arguments), seeds * lengths, towards * lengths)
        except RuntimeError as error:
            raise SimulationError(f"identify: the integrator stopped in segment {k + 1}: {reason_of(error)}") from None
        # the directions of a matrix stand side by side
        return moved[0].full() / lengths, moved[1].full().T.reshape(lengths.size, -1) / lengths[:, None]

    # --- starts and segments --------------------------------------------------------------
    def _parameters(self, theta: np.ndarray) -> np.ndarray:
        p = self.setup.numeric.p.copy()
        p[self.places] = theta
        return p

    def _start(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        start = self.setup.differentiable_start
        p = self._parameters(theta)
        self.setup.mechanism.check_values(p)
        x, guess, residual = start.function(p, start.right, start.z_estimate, self.guess)
        if not found(float(residual)):
            raise SimulationError("identify: no start meets the constraints and initial= at the values tried")
        return x.full().ravel(), guess.full().ravel()

    def _start_slope(self, theta: np.ndarray) -> np.ndarray:
        start, count = self.setup.differentiable_start, len(self.places)
        p = self._parameters(theta)
        arguments = [p, start.right, start.z_estimate, self.guess]
        seeds = np.zeros((p.size, count))
        seeds[self.places] = np.eye(count)
        function = Compiled(start.function)
        return function.changes(arguments, function(*arguments), seeds)[0].full()

    def _run(self, k: int, x0: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        segment, cuts = self._segment(k, x0, theta)
        try:
            end, values, states = segment(x0, theta, *cuts)
        except RuntimeError as error:
            raise SimulationError(f"identify: the integrator stopped in segment {k + 1}: {reason_of(error)}") from None
        if not self.motion.reached(states.full(), self._span(k)[0]):
            raise SimulationError(f"identify: the integrator stopped in segment {k + 1}")
        return end.full().ravel(), values.full()


def nodes_from_data(setup: MotionSetup, experiment: Experiment, index: int, guess: np.ndarray) -> np.ndarray:
    """State ``(q, v, z)`` at a time of the experiment.

    Measured positions move the pose, their differences in time the
    velocity, as little as need be; the constraints hold to rounding. First-order
    states, and whatever is not seen in the data, stay as guessed.
    """
    numeric, eom = setup.numeric, setup.eom
    n, time = eom.q.numel(), float(setup.grid[index])
    q, v, z = guess[:n], guess[n : 2 * n], guess[2 * n :]
    outputs = ca.vertcat(*[ca.vec(e) for e in experiment.outputs])
    others = ca.vertcat(eom.v, eom.a, eom.z, eom.lam, eom.u)
    usable = [k for k in np.flatnonzero(experiment.measured[:, index]) if not ca.depends_on(outputs[int(k)], others)]
    if not usable:
        return guess
    rows = ca.densify(outputs[[int(k) for k in usable]])
    function = ca.Function(
        "measured", [eom.q, eom.t, eom.p], [rows, ca.jacobian(rows, eom.q), ca.jacobian(rows, eom.t)]
    )
    target = experiment.samples[usable, index]

    def both(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi, jacobian = numeric.position(time, q, z)
        values, slope, _ = function(q, time, numeric.p)
        return np.r_[phi, values.full().ravel() - target], np.vstack([jacobian, slope.full()])

    led = solve(both, q, numeric.weights, iterations=20, step_limit=0.5)
    closed = solve(lambda q: numeric.position(time, q, z), led.x, numeric.weights, iterations=20)
    if not closed.converged:
        return guess
    q = closed.x
    jacobian, nu = numeric.velocity(time, q, z)
    _, slope, drift = function(q, time, numeric.p)
    rates = np.array([_rate(setup.grid, experiment.samples[k], index) for k in usable])
    seen = np.isfinite(rates)
    free = analyse_rank(jacobian).null_columns
    v = project_velocity(jacobian, nu, v)
    missing = (rates - drift.full().ravel() - slope.full() @ v)[seen]
    v = v + free @ least_norm(slope.full()[seen] @ free, missing, threshold=UNSEEN)
    return np.concatenate([q, v, z])


def _rate(times: np.ndarray, samples: np.ndarray, index: int) -> float:
    """Slope of a line through the samples around a time; NaN where there are not two."""
    near = [k for k in range(max(index - 2, 0), min(index + 3, times.size)) if np.isfinite(samples[k])]
    if len(near) < 2:
        return np.nan
    return float(np.polyfit(times[near] - times[index], samples[near], 1)[0])
