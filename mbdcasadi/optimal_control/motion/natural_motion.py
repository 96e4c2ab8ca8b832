"""Motions that a mechanism makes by itself: its driven displacements follow a course, and all else moves freely.

Let ``w = B^T v`` with ``B = dQ/du`` be the velocities on which the inputs do work, and s their integrals. The inputs by
which ``w`` follows a course ``s_r(t)`` solve

    B^T a(q, v, u) + (dB^T/dt) v = s_r'' - 2 k (w - s_r') - k² (s - s_r),

within their limits; the coordinates that they do not drive swing as their own dynamics have it. This is partial
feedback linearisation; without inputs to find it is the free motion, or that under given inputs.

References
----------
Spong, "Partial feedback linearization of underactuated mechanical systems", IROS 1994.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from ...numerics.console import call
from ...numerics.lazy import cached_property
from ...results.interpolation import hermite, linear
from ..poses.kinematic_guess import KinematicPath
from ..program.setup import PhaseSetup
from .guess import PhaseGuess

#: Stretches of a simulation, in each of which the course of the inputs is even, and steps of the method of Runge and
#: Kutta in each: rates up to 1000 over the duration are stable.
STRETCHES, STEPS = 80, 5
#: Rate k at which a displacement comes back to its course, over the duration: some steps of the simulation.
RATE = 60.0
#: Share of the largest effect of inputs on their displacements below which there is none.
EFFECT = 1e-9


@dataclass(frozen=True)
class Course:
    """What the inputs are to do at instants that divide the duration evenly.

    Displacements that the inputs drive follow a course; if they do not, the inputs themselves do.
    """

    #: (STRETCHES + 1, n_u)
    values: np.ndarray
    of_inputs: bool


class NaturalMotion:
    """Simulations of a phase whose driven displacements follow a course.

    Parameters
    ----------
    setup : PhaseSetup
        Phase, with its equations at the parameters that are given.
    """

    def __init__(self, setup: PhaseSetup):
        self._setup, self._numeric = setup, setup.numeric
        self._eom = setup.numeric.eom

    @property
    def is_underactuated(self) -> bool:
        """True if the mechanism has more degrees of freedom than inputs."""
        eom = self._setup.scheme.eom
        return eom.u.numel() < eom.q.numel() - len(self._setup.scheme.rows)

    @property
    def drives(self) -> bool:
        """True if every input does work on a displacement of its own, not only through first-order states."""
        count = self._eom.u.numel()
        return count > 0 and bool(np.linalg.matrix_rank(self._effects(self._setup.path.poses[:1])[0]) == count)

    def displacements(self, path: KinematicPath) -> np.ndarray:
        """Driven displacements along poses, from zero at the first one (k, n_u)."""
        effects = self._effects(path.poses)
        steps = np.einsum("kij,ki->kj", (effects[1:] + effects[:-1]) / 2, np.diff(path.poses, axis=0))
        return np.vstack([np.zeros(effects.shape[2]), np.cumsum(steps, axis=0)])

    @property
    def sizes(self) -> np.ndarray:
        """Typical sizes of the driven displacements (n_u,)."""
        sizes: np.ndarray = np.linalg.norm(
            self._effects(self._setup.path.poses[:1])[0] * self._setup.scales.q[:, None], axis=0
        )
        return sizes

    def along(
        self, path: KinematicPath, v: np.ndarray, z: np.ndarray, waves: np.ndarray | None = None
    ) -> PhaseGuess | None:
        """Motion from velocities and first-order states at the start of a path, which driven displacements follow.

        Waves (STRETCHES + 1, n_u) may lead them to both sides of it. It is None if the motion does not get to the end.
        """
        shares = (path.times - path.times[0]) / (path.times[-1] - path.times[0])
        at, along = np.linspace(0, 1, STRETCHES + 1), self.displacements(path)
        even = at**3 * (10 - 15 * at + 6 * at**2)  # from rest to rest
        values = np.column_stack([np.interp(even, shares, column) for column in along.T])
        return self._simulated(path, v, z, Course(values + (0.0 if waves is None else waves), of_inputs=False))

    def under(
        self, path: KinematicPath, v: np.ndarray, z: np.ndarray, inputs: np.ndarray | None = None
    ) -> PhaseGuess | None:
        """Motion from the same start under inputs (STRETCHES + 1, n_u), or their own values: the free motion."""
        values = np.tile(self._eom.input_values, (STRETCHES + 1, 1)) if inputs is None else inputs
        return self._simulated(path, v, z, Course(values, of_inputs=True))

    def _simulated(self, path: KinematicPath, v: np.ndarray, z: np.ndarray, course: Course) -> PhaseGuess | None:
        """The motion as a guess for the times of a path; None if it does not get to the end."""
        eom, n_u = self._eom, self._eom.u.numel()
        begin, time = float(path.segment_times[0]), float(path.segment_times[-1] - path.segment_times[0])
        step = time / STRETCHES
        rates = np.gradient(course.values, step, axis=0)
        second = np.diff(rates, axis=0) / step
        low, high = _ranges(self._setup)
        fixed = np.r_[self._numeric.p, RATE / time, float(course.of_inputs), low, high]
        begins = begin + step * np.arange(STRETCHES)
        controls = np.vstack([begins, course.values[:-1].T, rates[:-1].T, second.T])
        first = np.r_[path.poses[0], v, z, np.zeros(n_u)]
        times = np.r_[begins, begin + time]
        last = np.column_stack([controls, controls[:, -1]])
        last[0, -1] = begins[-1]
        try:  # a motion that does not get to its end is no guess, and no matter of the user
            result = call(partial(self._integrator, x0=first, p=np.r_[fixed, begin, step], u=controls))
            states = np.column_stack([first, result["xf"].full()])
            loads = self._loads.map(STRETCHES + 1)
            values = call(loads, times, states, last, np.tile(fixed[:, None], STRETCHES + 1))
        except RuntimeError:  # of CasADi, if a state has no accelerations
            return None
        a, lam, u, rate = (part.full().T for part in values)
        if not all(np.all(np.isfinite(part)) for part in (states, a, lam, u, rate)):
            return None
        n, n_z = eom.q.numel(), eom.z.numel()
        q, v, z = states[:n].T, states[n : 2 * n].T, states[2 * n : 2 * n + n_z].T

        def sample(at: np.ndarray) -> dict[str, np.ndarray]:
            at = np.clip(at, begin, begin + time)
            of_states = linear(times, z, at) if n_z else np.zeros((at.size, 0))
            near_q, near_v = hermite(times, q, v, a, at)
            near = self._setup.loads.states(at, near_q, near_v, linear(times, a, at), of_states)
            of_rates = linear(times, rate, at) if n_z else of_states
            names = "q", "v", "a", "z", "rate", "lam", "u"
            return dict(
                zip(names, (*near, of_states, of_rates, linear(times, lam, at), linear(times, u, at)), strict=True)
            )

        return PhaseGuess(sample, path.segment_times)

    # --- compiled functions ---------------------------------------------------------------------
    def _effects(self, poses: np.ndarray) -> np.ndarray:
        """``B = dQ/du`` at poses and rest (k, n, n_u)."""
        eom, p, start = self._eom, self._numeric.p, self._setup.start
        function = self._terms
        return np.array([function(0.0, q, 0 * q, start.z, eom.input_values, p)[0].full() for q in poses])

    @cached_property
    def _terms(self) -> ca.Function:
        """``(t, q, v, z, u, p) -> (B, w, its rate but for B^T a, z')``."""
        eom = self._eom

        def make() -> ca.Function:
            effect = ca.jacobian(eom.Q, eom.u)
            w = effect.T @ eom.v
            rate = ca.jtimes(w, ca.vertcat(eom.q, eom.t), ca.vertcat(eom.v, 1))
            return ca.Function(
                "terms",
                [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p],
                [ca.densify(x) for x in (effect, w, rate, eom.z_rate)],
            )

        return eom.shared.get_or_create("terms of natural motions", make)

    @cached_property
    def _motion(self) -> tuple[list[ca.MX], list[ca.MX]]:
        """Symbols ``t, y, control, fixed``, and ``y', a, lam, u, z'`` by these."""
        eom, numeric = self._eom, self._numeric
        n, n_z, n_u, n_p = eom.q.numel(), eom.z.numel(), eom.u.numel(), eom.p.numel()
        t, y = ca.MX.sym("t"), ca.MX.sym("y", 2 * n + n_z + n_u)
        control, fixed = ca.MX.sym("control", 1 + 3 * n_u), ca.MX.sym("fixed", n_p + 2 + 2 * n_u)
        q, v, z, s = ca.vertsplit(y, np.cumsum([0, n, n, n_z, n_u]).tolist())
        begins, value, rate, second = ca.vertsplit(control, np.cumsum([0, 1, n_u, n_u, n_u]).tolist())
        p, k, of_inputs, low, high = ca.vertsplit(fixed, np.cumsum([0, n_p, 1, 1, n_u, n_u]).tolist())
        redundant = numeric.has_redundant_rows(self._setup.start.t, self._setup.start.q)
        dynamics = numeric.forward_dynamics(redundant=redundant)
        since = t - begins
        wanted, wanted_rate = value + since * rate + since**2 / 2 * second, rate + since * second
        u, w = wanted, ca.MX.zeros(n_u)
        if n_u:
            effect, w, drift, _ = self._terms(t, q, v, z, ca.DM(eom.input_values), p)
            still = dynamics(t, q, v, z, ca.DM.zeros(n_u), p)[0]
            unit = ca.DM.eye(n_u)
            by_input = ca.horzcat(*[dynamics(t, q, v, z, unit[:, j], p)[0] - still for j in range(n_u)])
            rest = second - 2 * k * (w - wanted_rate) - k**2 * (s - wanted) - drift - effect.T @ still
            gain = effect.T @ by_input
            square = gain.T @ gain
            damped = square + EFFECT * ca.trace(square) * ca.DM.eye(n_u)
            found = ca.solve(damped, gain.T @ rest)
            u = ca.fmin(ca.fmax(ca.if_else(of_inputs, wanted, found), low), high)
        a, lam = dynamics(t, q, v, z, u, p)
        z_rate = self._terms(t, q, v, z, u, p)[3]
        return [t, y, control, fixed], [ca.vertcat(v, a, z_rate, w), a, lam, u, z_rate]

    @cached_property
    def _loads(self) -> ca.Function:
        arguments, (_, *values) = self._motion
        return ca.Function("loads", arguments, values)

    @cached_property
    def _integrator(self) -> ca.Function:
        """Simulation of unit stretches: times are shares of a step, counted from the start of the motion."""
        (t, y, control, fixed), (rate, *_) = self._motion
        share, begin, step = ca.MX.sym("share"), ca.MX.sym("begin"), ca.MX.sym("step")
        function = ca.Function("rate", [t, y, control, fixed], [rate])
        rates = step * function(begin + step * share, y, control, fixed)
        dae = {"t": share, "x": y, "u": control, "p": ca.vertcat(fixed, begin, step), "ode": rates}
        options = {"number_of_finite_elements": STEPS}
        return ca.integrator("natural", "rk", dae, 0.0, list(range(1, STRETCHES + 1)), options)


def _ranges(setup: PhaseSetup) -> tuple[np.ndarray, np.ndarray]:
    """Limits of the inputs (n_u,)."""
    inputs = setup.phase.mechanism.inputs
    return np.array([u.lower for u in inputs]), np.array([u.upper for u in inputs])
