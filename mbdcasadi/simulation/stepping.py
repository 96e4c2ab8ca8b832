"""The integrators of one set of equations: the forms that are tried in turn, and singular poses on the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..integrators import IDAS, Integrator, RungeKutta
from ..integrators.compiled import FEW_STEPS, MAX_STEPS, CompiledIntegrator, Dae, IntegrationFailure
from ..integrators.lending import Lending
from ..numerics.console import Interruption
from ..numerics.least_squares import largest
from .compiled_elements import compiled_elements
from .formulations import Formulation, Regularised, choose_formulation
from .outputs import Outputs
from .path import Path
from .resolution import Resolution
from .schedule import Piece
from .watched_terms import WatchedTerms

#: Tolerances of what is integrated to rounding.
PRECISE = (1e-12, 1e-13)
#: Decay of drift in the regularised form: so many times in a piece, and for each radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0
#: Relative distance from consistent unknowns at which the search of IDAS for them starts well.
PERTURBATION = 1e-6


class NearSingularPose(IntegrationFailure):
    """The usual form of the equations failed near a singular pose, which may be passed otherwise."""


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
        True if rows are dependent.
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
        self._borrowed: list[tuple[Any, tuple[CompiledIntegrator, Any]]] = []
        self._outputs = {flag: Outputs(numeric, signals, levels, redundant=flag) for flag in (False, True)}
        self.formulation = choose_formulation(numeric, integrator, redundant=redundant)
        self.fastest = 0.0
        self._counts = 0, 0
        self._precise: tuple[Formulation, CompiledIntegrator] | None = None

    @property
    def outputs(self) -> Outputs:
        """Outputs in the form of the equations that is used now."""
        return self._outputs[self.formulation.tolerates_redundancy]

    @property
    def tolerant_outputs(self) -> Outputs:
        """Outputs also in singular poses: multipliers are those of least norm."""
        return self._outputs[True]

    @property
    def notes(self) -> list[str]:
        """Sentences on how it ran."""
        remark = compiled_elements(self._resolution.terms)[1]
        return [remark] if remark else []

    @property
    def starts(self) -> int:
        """Number of starts of an integrator."""
        return self._counts[0] + sum(compiled.starts for compiled in self._compiled.values())

    @property
    def steps(self) -> int:
        """Steps of the last piece."""
        return self._of(self.formulation).steps

    @property
    def all_steps(self) -> int:
        """Steps of all pieces."""
        return self._counts[1] + sum(compiled.all_steps for compiled in self._compiled.values())

    # --- integrating -------------------------------------------------------------------------
    def _of(self, form: Formulation) -> CompiledIntegrator:
        if form not in self._compiled:
            self._compiled[form] = self._integrator(form, self.integrator, self._resolution.terms)
        return self._compiled[form]

    def _integrator(
        self, form: Formulation, method: Integrator, terms: WatchedTerms | None = None
    ) -> CompiledIntegrator:
        """An integrator that is kept for the mechanism, and lent to this run alone."""
        numeric, signals = self.numeric, self.signals
        settings = type(method), method.max_step, method.key
        key = form, settings, numeric.light_key, signals.structure, terms is None

        def make() -> tuple[CompiledIntegrator, Any]:
            made = CompiledIntegrator(self._system(form, terms), method)
            # the expression is kept beside it: a hash in the structure is unique only while the node lives
            return made, signals.parametrised

        borrowed = lending_of(numeric).borrow(key, make)
        borrowed[0].restart_counting()
        self._borrowed.append((key, borrowed))
        return borrowed[0]

    def _system(self, form: Formulation, terms: WatchedTerms | None) -> Dae:
        """The system of an integrator, with compiled elements if they are many of a kind."""
        if terms is None:
            return form.dae(self.numeric, self.signals)
        elements, _ = compiled_elements(terms)
        if elements is not None:
            return form.compiled_dae(self.numeric, self.signals, elements)
        return form.dae(self.numeric, self.signals, quadratures=terms.rates)

    def release(self) -> None:
        """Give back the integrators at the end of a run; their counts stay."""
        self._counts = self.starts, self.all_steps
        self._compiled, self._precise = {}, None
        while self._borrowed:
            lending_of(self.numeric).give_back(*self._borrowed.pop())

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

    def advance(
        self,
        piece: Piece,
        x: np.ndarray,
        interruption: Interruption,
        comes_near: Callable[[Path], bool] | None = None,
    ) -> Path:
        """Integrate over a piece from a consistent state.

        If the usual form fails, the regularised one is tried, which passes
        singular poses; then the usual one with all the steps it may take.

        Parameters
        ----------
        comes_near : callable, optional
            ``path -> bool``: True if a path comes near to a singular pose. The other forms are then not tried.

        Raises
        ------
        NearSingularPose, IntegrationFailure
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
            if k == 2 and comes_near is not None and form != usual:
                self._stop_near_singular_pose(piece, x, flag, comes_near)
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

    def _stop_near_singular_pose(
        self, piece: Piece, x: np.ndarray, flag: str, comes_near: Callable[[Path], bool]
    ) -> None:
        """Raise if the part of a piece that the usual form reaches comes near to a singular pose."""
        start, times = piece.inside
        z, u = self._unknowns(self.formulation, piece.start, x), self.signals.channel_from(piece.begins)
        reached = self._of(self.formulation).reach(flag, x, z, start, times, self._parameters(piece), u, self._max_step)
        count = len(reached.x)
        path = Path(np.r_[piece.start, piece.times[:count]], np.vstack([x, reached.x]), np.zeros((count, 0)))
        if count and comes_near(path):
            raise NearSingularPose(reached.flag, reached.x, reached.z, float(times[count - 1]), reached.x[-1])

    def _parameters(self, piece: Piece | None) -> np.ndarray:
        """Parameters of the integrator: those of the model, levels of inputs, and the rate at which drift decays."""
        rate = 0.0
        if piece is not None:
            rate = max(DECAY / min(self._usual_length, piece.length), DECAY_PER_RADIAN * self.fastest)
        return np.r_[self.numeric.p, self.levels, rate]

    def way_from(self, start: float, x: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from later times (k,) to projected states (k, n_x), by one short integration each."""
        return self._way(self.formulation, self._of(self.formulation), start, x)

    def unprojected(self, start: float, x: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States at times after a consistent state as the integrator finds them (k, n_x).

        Raises
        ------
        IntegrationFailure
            If it does not get there.
        """
        return self._way(self.formulation, self._of(self.formulation), start, x, project=False)(times)

    def _way(
        self,
        form: Formulation,
        compiled: CompiledIntegrator,
        start: float,
        x: np.ndarray,
        *,
        project: bool = True,
        steps: int = MAX_STEPS,
    ) -> Callable[[np.ndarray], np.ndarray]:
        z, p = self._unknowns(form, start, x), self._parameters(None)
        u = self.signals.channel_from(np.array([start]))

        def states_at(times: np.ndarray) -> np.ndarray:
            later = times > start
            found = np.tile(x, (times.size, 1))
            if not np.any(later):
                return found
            columns = None if u is None else np.tile(u, (1, int(np.sum(later))))
            # dense output is less exact than steps: those end at each of the times
            stops = np.ones(int(np.sum(later)), bool)
            try:
                reached = compiled.advance(x, z, start, times[later], p, columns, stops=stops, steps=steps)[0]
            except IntegrationFailure as failure:
                if failure.flag != "IDA_LINESEARCH_FAIL" or not form.is_algebraic:
                    raise
                z_near = perturbed(z)
                reached = compiled.advance(x, z_near, start, times[later], p, columns, stops=stops, steps=steps)[0]
            found[later] = self.outputs.projected(times[later], reached) if project else reached
            return found

        return states_at

    # --- singular poses on the way ---------------------------------------------------------------
    def note_turning(self, x: np.ndarray) -> None:
        """Keep the largest angular velocity that was seen."""
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self.fastest = max(self.fastest, largest(turning))

    def precise_way_from(self, start: float, x: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from later times to projected states, integrated to rounding.

        Near to a lock-up no number of steps is enough: few are tried.
        """
        if self._precise is None:
            explicit = not self.numeric.eom.Q_depends_on_lam
            method: Integrator = RungeKutta(*PRECISE) if explicit else IDAS(*PRECISE)
            form = choose_formulation(self.numeric, method, redundant=self.formulation.tolerates_redundancy)
            self._precise = form, self._integrator(form, method)
        return self._way(*self._precise, start, x, steps=FEW_STEPS)


def lending_of(numeric: NumericEquations) -> Lending:
    """Integrators that are kept for a mechanism."""
    return numeric.eom.mechanism.cache.get_or_create("integrators", Lending)


def perturbed(z: np.ndarray) -> np.ndarray:
    """Unknowns near to consistent ones: at these the search of IDAS takes rounding for a failure."""
    return z + PERTURBATION * (1 + np.abs(z))
