"""Integrators of a run: forms of the equations, what is tried in turn, and singular poses on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..equations.numeric import NumericEquations
from ..integrators.integration import FEW_STEPS, MAX_STEPS, IntegrationFailure, Integrator
from ..numerics.console import Interruption
from ..numerics.least_squares import largest
from ..results.state import State
from .chunks import Chunk
from .formulations import EXPLICIT_BODIES, Formulation, choose
from .input_sampling import InputFeed
from .outputs import Outputs
from .resolution import Path, Resolution

#: Fall of the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to the largest one seen, at which the regularised
#: form takes over for the rest of a run: the mechanism passes near a singular pose. For many bodies, where the
#: change costs more, the pose must be nearer to it.
NEARLY_SINGULAR, NEARLY_SINGULAR_MANY = 0.02, 1e-4
#: The same, below which no chunk is to end: the projection there is uncertain, and a start from it is off.
NO_START = 0.02
#: Decay of drift in the regularised form: so many times in a chunk, and for each radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0
#: Relative distance from consistent unknowns at which the search of IDAS for them starts well.
BESIDE = 1e-6


class Stepper:
    """The state of a run, and the integrators that advance it.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    feed : InputFeed
        Inputs.
    method : {"idas", "erk", "rosenbrock"}
        Integrator.
    settings : dict
        ``reltol``, ``abstol``, ``jit``, ``options`` of the integrator.
    resolution : Resolution
        Has some rates integrated along.
    start : State
        Where the run starts.
    redundant : bool
        Whether rows are dependent there.

    Attributes
    ----------
    formulation : Formulation
        Form of the equations that is used now.
    x : numpy.ndarray
        State ``(q, v, z)`` from which the next chunk starts.
    fastest : float
        Largest angular velocity that was seen, rad/s.
    path : Path
        What the integrator found over the last chunk, as the steps have it: not projected.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        feed: InputFeed,
        method: str,
        settings: dict[str, Any],
        resolution: Resolution,
        start: State,
        *,
        redundant: bool,
    ):
        self.numeric, self.feed, self.method = numeric, feed, method
        self._settings, self._resolution = settings, resolution
        self._integrators: dict[Formulation, Integrator] = {}
        self._outputs = {flag: Outputs(numeric, feed, redundant=flag) for flag in (False, True)}
        self.formulation = choose(numeric, method, redundant=redundant)
        self.x = np.r_[start.q, start.v, start.z]
        unknowns = np.r_[start.a, start.lam]
        #: estimate of the algebraic unknowns from which the integrator finds consistent ones: zero where the equations
        #: are linear in them, since one Newton step of IDAS then finds them, while a residual of rounding size, which
        #: no step reduces, makes its line search fail (seen from 200 bodies on)
        self._z = unknowns if numeric.eom.Q_depends_on_lam else np.zeros_like(unknowns)
        self.path = Path(np.zeros(0), np.zeros((0, 0)), np.zeros((0, 0)))
        self.fastest = self._regular = 0.0

    @property
    def outputs(self) -> Outputs:
        """Outputs in the form of the equations that is used now."""
        return self._outputs[self.formulation.redundant]

    @property
    def starts(self) -> int:
        """Number of starts of an integrator."""
        return sum(integrator.starts for integrator in self._integrators.values())

    @property
    def steps(self) -> int:
        """Steps of the last chunk, where the integrator counts them."""
        return self._integrator(self.formulation).steps

    def go_on_from(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> None:
        """Start the next chunk from a projected state."""
        self.x = x
        if self.numeric.eom.Q_depends_on_lam:
            self._z = self.outputs.unknowns(time, x, channel)

    # --- integrating -------------------------------------------------------------------------
    def _integrator(self, form: Formulation) -> Integrator:
        if form not in self._integrators:
            dae = form.dae(self.numeric, self.feed.signals, watched=self._resolution.rates)
            self._integrators[form] = Integrator(dae, self.method, **self._settings)
        return self._integrators[form]

    def advance(
        self, chunk: Chunk, channel: np.ndarray | None, usual_length: float, interruption: Interruption
    ) -> np.ndarray:
        """States at the outputs of a chunk.

        Where the usual form fails the regularised one is tried, which passes
        singular poses; then the usual one with all the steps it may take.
        """
        usual, flag, p = self.formulation, "", self._parameters(chunk, usual_length)
        attempts = [(usual, FEW_STEPS), (usual, FEW_STEPS), (usual, MAX_STEPS)]
        if usual.name != "regularised" and not self.numeric.eom.Q_depends_on_lam:
            attempts.insert(2, (Formulation("regularised"), FEW_STEPS))
        for k, (form, steps) in enumerate(attempts):
            if k == 1 and flag != "IDA_LINESEARCH_FAIL":
                continue
            if k > 1 and form == usual and flag != "IDA_TOO_MUCH_WORK":
                break
            z, integrator = self._z if form.algebraic else np.zeros(0), self._integrator(form)
            if k == 1:  # its search for consistent unknowns takes rounding for a failure, and starts well from beside
                z = beside(z)
            try:
                states = integrator.advance(self.x, z, chunk.start, chunk.times, p, channel, steps)[0]
                knots, since = np.r_[chunk.start, chunk.times], integrator.integrals
                increments = np.diff(since, axis=0, prepend=np.zeros((1, since.shape[1])))
                self.path = Path(knots, np.vstack([self.x, states]), increments)
                return states
            except IntegrationFailure as failure:
                if interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
                    raise KeyboardInterrupt from None
                flag = failure.flag if form == usual else flag
        z = self._z if usual.algebraic else np.zeros(0)
        stopped = self._integrator(usual).rescue(flag, self.x, z, chunk.start, chunk.times, p, channel)
        if interruption.requested:
            raise KeyboardInterrupt
        raise stopped

    def _parameters(self, chunk: Chunk, usual_length: float) -> np.ndarray:
        """Parameters of the integrator: those of the model, and the rate at which drift decays."""
        rate = max(DECAY / min(usual_length, chunk.length), DECAY_PER_RADIAN * self.fastest)
        return np.r_[self.numeric.p, rate]

    def way_from(self, start: float, x: np.ndarray, channel: np.ndarray | None) -> Callable[[float], np.ndarray]:
        """Projected state by time after an output, each by a short integration from there."""
        z = self.outputs.unknowns(start, x, channel) if self.formulation.algebraic else np.zeros(0)
        p = np.r_[self.numeric.p, 0.0]
        integrator = self._integrator(self.formulation)

        def state_at(time: float) -> np.ndarray:
            if time <= start:
                return x
            try:
                reached = integrator.advance_once(x, z, start, time, p, channel)
            except IntegrationFailure as failure:
                if failure.flag != "IDA_LINESEARCH_FAIL":
                    raise
                reached = integrator.advance_once(x, beside(z), start, time, p, channel)
            return self.outputs.projected(np.array([time]), reached[None, :])[0]

        return state_at

    # --- singular poses on the way ---------------------------------------------------------------
    def note_turning(self, x: np.ndarray) -> None:
        """Keep the largest angular velocity that was seen."""
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self.fastest = max(self.fastest, largest(turning))

    def came_near_singular(self) -> bool:
        """Change to the regularised form where the poses of a chunk come near to a singular one."""
        regularity = self.outputs.recovery.regularity
        self._regular = max(self._regular, float(np.max(regularity, initial=0.0)))
        many = len(self.numeric.eom.mechanism.bodies) > EXPLICIT_BODIES
        limit = (NEARLY_SINGULAR_MANY if many else NEARLY_SINGULAR) * self._regular
        near = float(np.min(regularity, initial=np.inf)) < limit
        if not near or self.formulation.name == "regularised" or self.numeric.eom.Q_depends_on_lam:
            return False
        self.formulation = Formulation("regularised")
        return True

    def ends_near_singular(self) -> bool:
        """Whether a chunk ends so near to a singular pose that no integrator should be started there."""
        return float(self.outputs.recovery.regularity[-1]) < NO_START * self._regular


def beside(z: np.ndarray) -> np.ndarray:
    """Unknowns near to consistent ones: at these the search of IDAS takes rounding for a failure."""
    return z + BESIDE * (1 + np.abs(z))
