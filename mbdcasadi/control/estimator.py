"""An estimator of the state of a machine from its measurements, over a moving horizon."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of, position_in
from ..equations import equations
from ..errors import ModelError, SimulationError
from ..linear.tree_model import TreeModel
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..model.quantities import entries, no_relation, refuse_twice
from ..model.symbols import Parameter, as_expression, number, positive
from ..numerics.real import real_array
from ..results.state import State
from .moving_horizon import Arrival, Stage, best_changes
from .stages import StageFunctions, TreePoint

#: Steps of integration between two samples: more would take an update ten seconds.
MOST_STEPS = 100_000


@dataclass(frozen=True)
class _Window:
    """What an estimator knows: samples since the first state, and the states and disturbances that fit them."""

    times: tuple[float, ...]
    states: tuple[np.ndarray, ...]
    near: tuple[np.ndarray, ...]
    disturbances: tuple[np.ndarray, ...]
    inputs: tuple[np.ndarray, ...]
    measured: tuple[np.ndarray, ...]
    arrival: Arrival
    parameters: np.ndarray


class Estimator:
    """Moving-horizon estimation: the motion of the last samples that fits the measurements best.

    With states x, disturbances w of inputs that are constant over a sample, and what is known of the first state, the
    weighted squares ``(x_0 - m)^T P^-1 (x_0 - m) + sum (w / sigma_w)^2 + sum ((y - h(x)) / sigma_y)^2`` are made least,
    by one Gauss-Newton step over the horizon at every sample. As samples leave the horizon, m and P follow by the
    Kalman filter. For a linear mechanism this is the Kalman filter. Loops are closed inside.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    measured : sequence of expressions
        What is measured at every sample: positions, velocities, accelerations, reactions, or any function of them.
    noise : sequence of float
        Standard deviations of these, in their units.
    disturbance : mapping of Input to float, optional
        Standard deviations of what is added to inputs, constant over a sample and independent of other samples.
    sample : float
        Time between two updates, s.
    horizon : int
        Number of samples that are kept.
    unknown : sequence of Parameter, optional
        Parameters that are estimated, as states that are constant.
    state : sequence of expressions, optional
        Positions that describe the motion, as in :class:`Controller`.

    Attributes
    ----------
    state_names : tuple of str
        Positions, rates, first-order states and unknown parameters: the order of the covariance.
    measured, noise, unknown : casadi.SX, numpy.ndarray, tuple of Parameter
        As given.

    Raises
    ------
    ModelError, ExpressionError
        For deviations that are not positive, symbols that the mechanism does not have, forces that depend on reactions,
        redundant constraints, and samples over which the mechanism's fastest mode takes too many steps.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> force = mbd.Input("force")
    >>> cart = mbd.Body("cart", mass=2, inertia=1)
    >>> rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    >>> push = mbd.Force("push", cart.at(0, 0), (force, 0))
    >>> model = mbd.Mechanism([cart], [rail], forces=[push], inputs=[force])
    >>> estimator = mbd.Estimator(
    ...     model, measured=[cart.x], noise=[0.01], disturbance={force: 0.1}, sample=0.1, horizon=20
    ... )
    >>> estimator.reset(mbd.assemble(model, [cart.x == 0, cart.vx == 0]), [[1, 0], [0, 1]])
    >>> for k in range(1, 11):
    ...     state = estimator.update([0.2 * k], {force: 0})
    >>> round(state[cart.vx], 2)
    2.0
    """

    def __init__(
        self,
        mechanism: Mechanism,
        measured: Sequence[Any],
        noise: Sequence[float],
        disturbance: Any = None,
        *,
        sample: float,
        horizon: int,
        unknown: Sequence[Parameter] = (),
        state: Sequence[Any] | None = None,
    ):
        if not isinstance(mechanism, Mechanism):
            raise ModelError(f"Estimator: takes a Mechanism, got {mechanism!r}")
        for element in switching(mechanism):
            raise ModelError(
                f"Estimator: {element.description} switches between sticking and sliding, or contact and flight; take "
                "a smooth law, as Coulomb, Stribeck or a Contact"
            )
        self.mechanism, self.sample = mechanism, positive(sample, "Estimator", "sample")
        if isinstance(horizon, bool) or not isinstance(horizon, int | np.integer) or horizon < 1:
            raise ModelError(f"Estimator: horizon must be a whole number of samples above zero, got {horizon!r}")
        self.horizon = int(horizon)
        given = [as_expression(x, "measured=") for x in entries(measured, "measured=")]
        rows = [no_relation(x, "Estimator", "what is measured") for x in given]
        self.noise = np.array([positive(x, "Estimator", "noise") for x in entries(noise, "noise=")])
        outputs = ca.vertcat(ca.SX(0, 1), *rows)
        if not rows or outputs.numel() != self.noise.size:
            raise ModelError(
                f"Estimator: noise= takes a deviation for each measured quantity, got {self.noise.size} for "
                f"{outputs.numel()}"
            )
        pairs = pairs_of(disturbance, "disturbance=")
        disturbed = [position_in(mechanism.inputs, key, "disturbance=") for key, _ in pairs]
        self._deviation = np.array([positive(s, f"disturbance of '{key.label}'", "deviation") for key, s in pairs])
        self.measured, self.unknown = outputs, tuple(entries(unknown, "unknown="))
        refuse_twice(self.unknown, "unknown=")
        places = [position_in(mechanism.parameters, x, "unknown=") for x in self.unknown]
        self._model = TreeModel(mechanism, equations(mechanism), state, "Estimator")
        self.state_names = (*self._model.names, *(mechanism.parameters[k].label for k in places))
        steps = self._model.steps_over(self.sample)
        if steps > MOST_STEPS:
            raise ModelError(
                f"Estimator: a sample of {self.sample:g} s takes {steps} steps of integration, more than {MOST_STEPS}, "
                f"since the fastest mode of the start has {self._model.fastest:.3g} 1/s; give a shorter sample"
            )
        self._stages = StageFunctions(self._model, outputs, disturbed, places, self.sample, steps)
        self._window: _Window | None = None

    # --- samples -----------------------------------------------------------------------------------------------
    def reset(self, state: State, covariance: Any) -> None:
        """Begin a motion.

        Parameters
        ----------
        state : State
            Mean of the state one sample before the first update; parameters are taken from it, the unknown ones as
            their means.
        covariance : array
            Of the state (n_x, n_x), in the order of :attr:`state_names`, positive semidefinite.
        """
        if not isinstance(state, State):
            raise ModelError(f"Estimator.reset: takes a State, got {state!r}")
        eom, places, count = self._model.eom, self._stages.unknown, len(self.state_names)
        whole = ca.vertcat(self._model.state, eom.p[places], self._model.q, self._model.v, eom.z, eom.p)
        values = np.atleast_1d(state[whole])
        try:
            given = real_array(covariance)
        except (TypeError, ValueError):
            given = np.zeros(0)
        if given.shape != (count, count) or not np.isfinite(given).all():
            raise ModelError(
                f"Estimator.reset: covariance must be {count} x {count} finite numbers, for {self.state_names}, got "
                f"{covariance!r}"
            )
        size = np.sqrt(np.maximum(np.diag(given), 0.0))
        size[size == 0] = 1.0
        squares, axes = np.linalg.eigh(given / np.outer(size, size))
        rounding = count * np.finfo(float).eps * max(1.0, float(np.max(np.abs(squares))))
        if not np.allclose(given, given.T, rtol=1e-9, atol=0) or np.min(squares) < -rounding:
            raise ModelError("Estimator.reset: covariance must be symmetric, and without negative eigenvalues")
        root = size[:, None] * axes * np.sqrt(np.maximum(squares, 0.0))
        x, s, p = np.split(values, [count, values.size - eom.p.numel()])
        self._window = _Window((state.t,), (x,), (s,), (), (), (), Arrival(x, root), p)

    def update(self, measured: Any, inputs: Any = None) -> State:
        """Predict one sample, and correct with what was measured at its end.

        Parameters
        ----------
        measured : sequence of float
            Values (n_y,); nan for one that is missing at this sample.
        inputs : mapping of Input to float, or list of pairs
            All inputs of the mechanism over the sample, without disturbances.

        Returns
        -------
        State
            At the end of the sample, with estimates of the unknown parameters, and inputs with those of disturbances.

        Raises
        ------
        SimulationError
            If the motion over the horizon has no value, or loops do not close; the estimator is as before.
        """
        window = self._started("update")
        try:
            y = real_array(measured).ravel()
        except (TypeError, ValueError):
            y = np.zeros(0)
        if y.shape != self.noise.shape or np.isinf(y).any():
            raise ModelError(
                f"Estimator.update: takes {self.noise.size} measured values, numbers or nan if missing, got "
                f"{measured!r}"
            )
        u = self._inputs(inputs)
        if len(window.inputs) == self.horizon:
            window = self._shortened(window)
        window = self._longer(window, y, u)
        stages, points = self._linear(window)
        try:
            states, disturbances = best_changes(window.arrival, window.states[0], stages, self._deviation)
        except np.linalg.LinAlgError:
            states, disturbances = [np.full(len(self.state_names), np.nan)], []
        self._refuse_nan(window.times[-2], *states, *disturbances)
        window = replace(
            window,
            states=tuple(x + change for x, change in zip(window.states, states, strict=True)),
            near=tuple(point.s for point in points),
            disturbances=tuple(d + change for d, change in zip(window.disturbances, disturbances, strict=True)),
        )
        state = self._state_of(window)
        self._window = window
        return state

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the last state (n_x, n_x), in the order of :attr:`state_names`."""
        window = self._started("covariance")
        arrival = window.arrival
        for k, stage in enumerate(self._linear(window)[0]):
            arrival = arrival.after(stage, window.states[k], window.states[k + 1], self._deviation)
        covariance: np.ndarray = arrival.root @ arrival.root.T
        return covariance

    # --- parts of an update ------------------------------------------------------------------------------------
    def _started(self, what: str) -> _Window:
        if self._window is None:
            raise ModelError(f"Estimator.{what}: there is no state yet; call reset(state, covariance) first")
        return self._window

    def _inputs(self, inputs: Any) -> np.ndarray:
        values = np.full(len(self.mechanism.inputs), np.nan)
        for key, value in pairs_of(inputs, "inputs="):
            place = position_in(self.mechanism.inputs, key, "inputs=")
            values[place] = number(value, f"input '{key.label}'", "value")
        if np.isnan(values).any():
            missing = self.mechanism.inputs[int(np.argmax(np.isnan(values)))]
            raise ModelError(f"Estimator.update: inputs= has no value of '{missing.label}'")
        return values

    def _longer(self, window: _Window, y: np.ndarray, u: np.ndarray) -> _Window:
        """The window with a sample more, at the end of which the state is that of the motion."""
        d, t, x = np.zeros(self._deviation.size), window.times[-1], window.states[-1]
        point = self._complete(t, x, window.near[-1], window)
        end, _, _, near = self._stages.advance(t, x, point, u, d, window.parameters)
        self._refuse_nan(t, end)
        return replace(
            window,
            times=(*window.times, t + self.sample),
            states=(*window.states, end),
            near=(*window.near, near),
            disturbances=(*window.disturbances, d),
            inputs=(*window.inputs, u),
            measured=(*window.measured, y),
        )

    def _shortened(self, window: _Window) -> _Window:
        """The window without its first sample, which the arrival then knows."""
        (first,), _ = self._linear(window, 1)
        samples = ("times", "states", "near", "disturbances", "inputs", "measured")
        later = {name: getattr(window, name)[1:] for name in samples}
        arrival = window.arrival.after(first, window.states[0], window.states[1], self._deviation)
        return replace(window, arrival=arrival, **later)

    def _complete(self, t: float, x: np.ndarray, near: np.ndarray, window: _Window) -> TreePoint:
        point = self._stages.complete(t, x, window.parameters, near)
        if point is None:
            shown = ", ".join(f"{name} = {value:.6g}" for name, value in zip(self.state_names, x, strict=True))
            raise SimulationError(
                f"Estimator: at t = {t:.6g} s the loops do not close in the estimated state {shown}; call reset with a "
                "state near the motion, or give a smaller covariance"
            )
        return point

    def _linear(self, window: _Window, count: int | None = None) -> tuple[list[Stage], list[TreePoint]]:
        """The first samples of a window about its states, in linear form, and these states; all if `count` is None."""
        found, stages, p = [], self._stages, window.parameters
        count = len(window.inputs) if count is None else count
        points = [self._complete(window.times[0], window.states[0], window.near[0], window)]
        for k in range(count):
            t, x, after = window.times[k], window.states[k], window.states[k + 1]
            d, u = window.disturbances[k], window.inputs[k]
            end, by_x, by_d, _ = stages.advance(t, x, points[-1], u, d, p)
            points.append(self._complete(window.times[k + 1], after, window.near[k + 1], window))
            y, seen, seen_by_d = stages.output(window.times[k + 1], after, points[-1], u, d, p)
            weight = np.where(np.isnan(window.measured[k]), 0.0, 1 / self.noise)
            miss = weight * (np.nan_to_num(window.measured[k]) - y)
            stage = Stage(by_x, by_d, end - after, weight[:, None] * seen, weight[:, None] * seen_by_d, miss, d)
            self._refuse_nan(t, *vars(stage).values())
            found.append(stage)
        return found, points

    def _refuse_nan(self, t: float, *values: np.ndarray) -> None:
        if not all(np.isfinite(part).all() for part in values):
            raise SimulationError(
                f"Estimator: between t = {t:.6g} s and {t + self.sample:.6g} s the estimated motion or a measured "
                "quantity has no finite value; call reset with a state near the motion"
            )

    def _state_of(self, window: _Window) -> State:
        model, t, x = self._model, window.times[-1], window.states[-1]
        s = self._complete(t, x, window.near[-1], window).s
        n, p = model.q.numel(), self._stages.parameters(x, window.parameters)
        u = window.inputs[-1].copy()
        u[self._stages.disturbed] += window.disturbances[-1]
        return model.state_at(t, s[:n], s[n : 2 * n], s[2 * n :], u, p)

    def __repr__(self) -> str:
        return (
            f"Estimator({len(self.state_names)} states of {self.noise.size} measured quantities; every "
            f"{self.sample:g} s over {self.horizon} samples)"
        )
