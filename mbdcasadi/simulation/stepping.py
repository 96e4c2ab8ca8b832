"""The integrators of one set of equations: the forms that are tried in turn, and singular poses on the way."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..integrators import Integrator
from ..integrators.compiled import FEW_STEPS, MAX_STEPS, CompiledIntegrator, IntegrationFailure
from ..numerics.console import Interruption
from ..numerics.least_squares import largest
from .formulations import EXPLICIT_BODIES, Formulation, Regularised, choose_formulation
from .outputs import Outputs
from .resolution import Path, Resolution
from .schedule import Piece

#: Fall of the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to the largest one seen, at which the regularised
#: form takes over for the rest of a run: the mechanism passes near a singular pose. For many bodies, where the
#: change costs more, the pose must be nearer to it.
NEARLY_SINGULAR, NEARLY_SINGULAR_MANY = 0.02, 1e-4
#: The same, below which no piece is to end: the projection there is uncertain, and a start from it is off.
NO_START = 0.02
#: Decay of drift in the regularised form: so many times in a piece, and for each radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0
#: Relative distance from consistent unknowns at which the search of IDAS for them starts well.
PERTURBATION = 1e-6
#: Length of a step, relative to the run, that a Taylor expansion takes where an integrator cannot.
TINY_STEP = 1e-9


class Stepper:
    """The state of one set of equations, and the integrators that advance it.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        Inputs.
    levels : numpy.ndarray
        Values of the inputs that are numbers; whoever calls a controller changes them in place.
    integrator : Integrator
        Method and tolerances.
    resolution : Resolution
        Has some rates integrated along.
    usual_length : float
        Length of a usual piece, s.
    redundant : bool
        Whether rows are dependent.
    max_step : float, optional
        Longest step, s.

    Attributes
    ----------
    formulation : Formulation
        Form of the equations that is used now.
    fastest : float
        Largest angular velocity that was seen, rad/s.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        levels: np.ndarray,
        integrator: Integrator,
        resolution: Resolution,
        usual_length: float,
        *,
        redundant: bool,
        max_step: float | None = None,
    ):
        self.numeric, self.signals, self.levels, self.integrator = numeric, signals, levels, integrator
        self._resolution, self._usual_length, self._max_step = resolution, usual_length, max_step
        self._compiled: dict[Formulation, CompiledIntegrator] = {}
        self._outputs = {flag: Outputs(numeric, signals, levels, redundant=flag) for flag in (False, True)}
        self.formulation = choose_formulation(numeric, integrator, redundant=redundant)
        self.fastest = self._regular = 0.0

    @property
    def outputs(self) -> Outputs:
        """Outputs in the form of the equations that is used now."""
        return self._outputs[self.formulation.tolerates_redundancy]

    @property
    def starts(self) -> int:
        """Number of starts of an integrator."""
        return sum(compiled.starts for compiled in self._compiled.values())

    @property
    def steps(self) -> int:
        """Steps of the last piece."""
        return self._of(self.formulation).steps

    @property
    def all_steps(self) -> int:
        """Steps of all pieces."""
        return sum(compiled.all_steps for compiled in self._compiled.values())

    # --- integrating -------------------------------------------------------------------------
    def _of(self, form: Formulation) -> CompiledIntegrator:
        if form not in self._compiled:
            dae = form.dae(self.numeric, self.signals, quadratures=self._resolution.rates)
            self._compiled[form] = CompiledIntegrator(dae, self.integrator)
        return self._compiled[form]

    def _unknowns(self, form: Formulation, time: float, x: np.ndarray) -> np.ndarray:
        """Estimate of the algebraic unknowns from which the integrator finds consistent ones.

        Zero where the equations are linear in them, since one Newton step of IDAS
        then finds them, while a residual of rounding size, which no step reduces,
        makes its line search fail (seen from 200 bodies on).
        """
        if not form.is_algebraic:
            return np.zeros(0)
        if self.numeric.eom.Q_depends_on_lam:
            return self.outputs.unknowns(time, x)
        return np.zeros(self.numeric.eom.q.numel() + self.numeric.eom.lam.numel())

    def advance(self, piece: Piece, x: np.ndarray, interruption: Interruption) -> Path:
        """Integrate over a piece from a consistent state.

        If the usual form fails, the regularised one is tried, which passes
        singular poses; then the usual one with all the steps it may take.

        Raises
        ------
        IntegrationFailure
            With the outputs that were reached.
        KeyboardInterrupt
            On Ctrl-C in compiled code.
        """
        usual, flag = self.formulation, ""
        p = self._parameters(piece)
        start, times = piece.inside
        u = self.signals.channel_from(piece.begins)
        attempts = [(usual, FEW_STEPS), (usual, FEW_STEPS), (usual, MAX_STEPS)]
        if not isinstance(usual, Regularised) and not self.numeric.eom.Q_depends_on_lam:
            attempts.insert(2, (Regularised(), FEW_STEPS))
        for k, (form, steps) in enumerate(attempts):
            if k == 1 and flag != "IDA_LINESEARCH_FAIL":
                continue
            if k > 1 and form == usual and flag != "IDA_TOO_MUCH_WORK":
                break
            z, compiled = self._unknowns(form, piece.start, x), self._of(form)
            if k == 1:  # its search for consistent unknowns takes rounding for a failure, and starts well from beside
                z = perturbed(z)
            try:
                states = compiled.advance(
                    x, z, start, times, p, u, stops=piece.stops, steps=steps, max_step=self._max_step
                )[0]
                since = compiled.integrals
                increments = np.diff(since, axis=0, prepend=np.zeros((1, since.shape[1])))
                return Path(np.r_[piece.start, piece.times], np.vstack([x, states]), increments)
            except IntegrationFailure as failure:
                if interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
                    raise KeyboardInterrupt from None
                flag = failure.flag if form == usual else flag
        z = self._unknowns(usual, piece.start, x)
        stopped = self._of(usual).rescue(flag, x, z, start, times, p, u, self._max_step)
        if interruption.requested:
            raise KeyboardInterrupt
        raise stopped

    def _parameters(self, piece: Piece | None) -> np.ndarray:
        """Parameters of the integrator: those of the model, levels of inputs, and the rate at which drift decays."""
        rate = 0.0
        if piece is not None:
            rate = max(DECAY / min(self._usual_length, piece.length), DECAY_PER_RADIAN * self.fastest)
        return np.r_[self.numeric.p, self.levels, rate]

    def way_from(self, start: float, x: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from later times (k,) to projected states (k, n_x), by one short integration each."""
        form, z = self.formulation, self._unknowns(self.formulation, start, x)
        u, p, compiled = self.signals.channel_from(np.array([start])), self._parameters(None), self._of(form)

        def states_at(times: np.ndarray) -> np.ndarray:
            later = times > start
            found = np.tile(x, (times.size, 1))
            if not np.any(later):
                return found
            columns = None if u is None else np.tile(u, (1, int(np.sum(later))))
            try:
                reached = compiled.advance(x, z, start, times[later], p, columns)[0]
            except IntegrationFailure as failure:
                if failure.flag != "IDA_LINESEARCH_FAIL" or not form.is_algebraic:
                    raise
                reached = compiled.advance(x, perturbed(z), start, times[later], p, columns)[0]
            found[later] = self.outputs.projected(times[later], reached)
            return found

        return states_at

    # --- singular poses on the way ---------------------------------------------------------------
    def note_turning(self, x: np.ndarray) -> None:
        """Keep the largest angular velocity that was seen."""
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self.fastest = max(self.fastest, largest(turning))

    def came_near_singular(self) -> bool:
        """Change to the regularised form if the poses of a piece come near to a singular one."""
        regularity = self.outputs.recovery.regularity
        self._regular = max(self._regular, float(np.max(regularity, initial=0.0)))
        many = len(self.numeric.eom.mechanism.bodies) > EXPLICIT_BODIES
        limit = (NEARLY_SINGULAR_MANY if many else NEARLY_SINGULAR) * self._regular
        near = float(np.min(regularity, initial=np.inf)) < limit
        if not near or isinstance(self.formulation, Regularised) or self.numeric.eom.Q_depends_on_lam:
            return False
        self.formulation = Regularised()
        return True

    def ends_near_singular(self) -> bool:
        """Whether a piece ends so near to a singular pose that no integrator should be started there."""
        return float(self.outputs.recovery.regularity[-1]) < NO_START * self._regular


def perturbed(z: np.ndarray) -> np.ndarray:
    """Unknowns near to consistent ones: at these the search of IDAS takes rounding for a failure."""
    return z + PERTURBATION * (1 + np.abs(z))
