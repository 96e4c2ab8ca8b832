"""The stepper of CasADi's integrators: the forms of the equations that are tried in turn, and singular poses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...equations.numeric import NumericEquations
from ...errors import SimulationError
from ...integrators import IDAS, Integrator, RungeKutta
from ...integrators.bdf.pieces import ImplicitIntegrator
from ...integrators.compiled import (
    FEW_STEPS,
    MAX_STEPS,
    CompiledIntegrator,
    Dae,
    InitialValueProblem,
    IntegrationFailure,
)
from ...integrators.native.pieces import NativeIntegrator
from ...numerics.console import Interruption
from ...numerics.least_squares import largest
from ..contact.compiled_elements import compiled_elements
from ..contact.watched_terms import WatchedTerms, watched_terms
from ..formulations import Formulation, Regularised, choose_formulation
from ..path import Path, StatesAt, states_from_start
from ..schedule import PIECES, Piece
from ..stepper import PRECISE, Counts, SteppedSystem, Stepper, lending_of
from .explicit_system import explicit_system, switching_of

#: Rate at which drift decays in the regularised form, by piece, and by radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0
#: Message of IDAS where it cannot go on over a stop at which an input bends; started anew there it can.
KINK = "IDA_ERR_FAIL"
#: Distance from consistent unknowns from which the search of IDAS for them succeeds, relative and absolute: from 1e-6
#: of them it still failed under friction that is close to holding, from 1e-5 to 1e-1 it did not.
PERTURBATION, LEAST_PERTURBATION = 1e-3, 1e-6


class NearSingularPose(IntegrationFailure):
    """The usual form of the equations failed near a singular pose, which may be passed otherwise."""


def refuse_joined_bodies(integrator: Integrator, numeric: NumericEquations) -> None:
    """Raise with the names of what a method for free bodies does not take."""
    held = f"{', '.join(numeric.eom.row_names[:6])} hold bodies" if numeric.eom.lam.numel() else ""
    if held or numeric.massless:
        raise SimulationError(
            f'method="{integrator.name}" takes bodies with mass that no joint holds, and '
            f'{held or "a body has no mass"}; use method="idas"'
        )


class CompiledStepper(Stepper):
    """Advances by CasADi's integrators, one form of the equations after the other."""

    def __init__(self, system: SteppedSystem):
        super().__init__(system)
        if self.integrator.runs_piecewise:
            refuse_joined_bodies(self.integrator, self.numeric)
        self._terms, self._usual_length = watched_terms(self.numeric.eom), system.span / PIECES
        self._compiled: dict[Formulation, CompiledIntegrator] = {}
        self._borrowed: list[tuple[Any, tuple[CompiledIntegrator, Any]]] = []
        #: largest angular velocity that was seen, rad/s
        self._fastest = 0.0
        #: starts and steps before the integrators were given back
        self._before = 0, 0
        self._precise: tuple[Formulation, CompiledIntegrator] | None = None

    @property
    def notes(self) -> list[str]:
        said = [one.said for one in self._compiled.values() if isinstance(one, NativeIntegrator)]
        remark = "" if said else compiled_elements(self._terms)[1]
        return [*said, *([remark] if remark else [])]

    @property
    def counts(self) -> Counts:
        starts = sum(compiled.starts for compiled in self._compiled.values())
        all_steps = sum(compiled.all_steps for compiled in self._compiled.values())
        current = self._compiled.get(self.formulation)
        return Counts(self._before[0] + starts, current.steps if current else 0, self._before[1] + all_steps)

    # --- integrating -------------------------------------------------------------------------
    def _of(self, form: Formulation) -> CompiledIntegrator:
        if form not in self._compiled:
            self._compiled[form] = self._integrator(form, self.integrator, self._terms)
        return self._compiled[form]

    def _integrator(
        self, form: Formulation, method: Integrator, terms: WatchedTerms | None = None
    ) -> CompiledIntegrator:
        """An integrator that is kept for the mechanism, and lent to this run alone."""
        numeric, signals = self.numeric, self.signals
        settings = type(method), method.max_step, method.key
        key = form, settings, numeric.light_key, signals.structure, terms is None

        def make() -> tuple[CompiledIntegrator, Any]:
            made = self._native(method, terms) or CompiledIntegrator(self._system(form, terms), self._careful(method))
            # the expression is kept beside it: a hash in the structure is unique only while the node lives
            return made, signals.parametrised

        borrowed = lending_of(numeric).borrow(key, make)
        borrowed[0].restart_counting()
        self._borrowed.append((key, borrowed))
        return borrowed[0]

    def _careful(self, method: Integrator) -> Integrator:
        """A method with tolerances at which its steps follow what switches."""
        if method.error_at_switches == 1.0:
            return method
        switching = switching_of(self.numeric.eom, self.signals, with_gaps=True)
        return method.for_switches() if switching.numel_out(0) else method

    def _native(self, method: Integrator, terms: WatchedTerms | None) -> NativeIntegrator | None:
        """A method that runs in code of this package."""
        if not method.runs_piecewise:
            return None
        numeric = self.numeric
        return ImplicitIntegrator(
            explicit_system(numeric, self.signals, terms, implicit=True), method, numeric.eom.mechanism.cache
        )

    def _system(self, form: Formulation, terms: WatchedTerms | None) -> Dae:
        """The system of an integrator, with compiled elements if they are many of a kind."""
        if terms is None:
            return form.dae(self.numeric, self.signals, in_tree=True)
        elements, _ = compiled_elements(terms)
        rates = terms.rates if elements is None else None
        return form.dae(self.numeric, self.signals, quadratures=rates, elements=elements, in_tree=True)

    def release(self) -> None:
        self._before = self.counts.starts, self.counts.all_steps
        self._compiled, self._precise = {}, None
        while self._borrowed:
            lending_of(self.numeric).give_back(*self._borrowed.pop())

    def _unknowns(self, compiled: CompiledIntegrator, form: Formulation, time: float, x: np.ndarray) -> np.ndarray:
        """Estimate of the algebraic unknowns from which the integrator finds consistent ones.

        Zero where the equations are linear in them, since one Newton step of IDAS
        then finds them, while a residual of rounding size, which no step reduces,
        makes its line search fail (seen from 200 bodies on).
        """
        if not form.is_algebraic:
            return np.zeros(0)
        if self.numeric.eom.Q_depends_on_lam:
            found, part = self.outputs.unknowns(time, x), compiled.dae.part
            return found if part is None else found[part.unknowns]
        return np.zeros(compiled.dae.z.numel())

    def advance(
        self, piece: Piece, x: np.ndarray, interruption: Interruption, comes_near: Callable[[Path], bool] | None = None
    ) -> Path:
        usual = self.formulation

        def attempt(form: Formulation, steps: int, *, nearby: bool = False) -> Path | IntegrationFailure:
            compiled, problem = self._of(form), self._problem(form, piece, x)
            problem = replace(problem, z=perturbed(problem.z)) if nearby else problem
            try:
                states = compiled.advance(problem, steps)[0]
            except IntegrationFailure as failure:
                if interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
                    raise KeyboardInterrupt from None
                return failure
            return _path(piece, x, states, compiled.integrals)

        outcome = attempt(usual, FEW_STEPS)
        if isinstance(outcome, IntegrationFailure) and outcome.flag == "IDA_LINESEARCH_FAIL":
            # the search for consistent unknowns mistakes rounding for a failure, and succeeds from nearby
            outcome = attempt(usual, FEW_STEPS, nearby=True)
        if isinstance(outcome, Path):
            return outcome
        has_constraints = self.numeric.eom.lam.numel() > 0
        if has_constraints and not isinstance(usual, Regularised) and not self.numeric.eom.Q_depends_on_lam:
            if comes_near is not None:
                self._stop_near_singular_pose(piece, x, outcome.flag, comes_near)
            across = attempt(Regularised(), FEW_STEPS)  # which passes singular poses
            if isinstance(across, Path):
                return across
        if outcome.flag == "IDA_TOO_MUCH_WORK":
            outcome = attempt(usual, MAX_STEPS)
            if isinstance(outcome, Path):
                return outcome
        stopped = self._of(usual).rescue(self._problem(usual, piece, x), outcome.flag)
        if interruption.requested:
            raise KeyboardInterrupt
        if stopped.is_overcome and outcome.flag == KINK:
            return _path(piece, x, stopped.x, self._of(usual).integrals)
        raise stopped

    def _problem(self, form: Formulation, piece: Piece, x: np.ndarray) -> InitialValueProblem:
        """The piece from a state at its start, as the integrator of a form takes it."""
        (start, times), u = piece.inside, self.signals.channel_from(piece.begins)
        z, p = self._unknowns(self._of(form), form, piece.start, x), self._parameters(piece)
        return InitialValueProblem(x, z, start, times, p, u, piece.stops, self.max_step)

    def _stop_near_singular_pose(
        self, piece: Piece, x: np.ndarray, flag: str, comes_near: Callable[[Path], bool]
    ) -> None:
        """Raise if the part of a piece that the usual form reaches comes near to a singular pose."""
        problem = self._problem(self.formulation, piece, x)
        reached = self._of(self.formulation).reach(problem, flag)
        count = len(reached.x)
        path = Path(np.r_[piece.start, piece.times[:count]], np.vstack([x, reached.x]), np.zeros((count, 0)))
        if count and comes_near(path):
            raise NearSingularPose(reached.flag, reached.x, reached.z, float(problem.times[count - 1]), reached.x[-1])

    def _parameters(self, piece: Piece | None) -> np.ndarray:
        """Parameters of the integrator: those of the model, levels of inputs, and the rate at which drift decays."""
        rate = 0.0
        if piece is not None:
            rate = max(DECAY / min(self._usual_length, piece.length), DECAY_PER_RADIAN * self._fastest)
        return np.concatenate([self.numeric.p, self.levels, [rate]])

    def states_from(self, start: float, x: np.ndarray, *, precise: bool = False) -> StatesAt:
        if not precise:
            return self._states_from(self.formulation, self._of(self.formulation), start, x)
        if self._precise is None:
            explicit = not self.numeric.eom.Q_depends_on_lam
            method: Integrator = RungeKutta(*PRECISE) if explicit else IDAS(*PRECISE)
            form = choose_formulation(self.numeric, method, redundant=self.formulation.tolerates_redundancy)
            self._precise = form, self._integrator(form, method)
        # before a lock-up no number of steps is enough
        return self._states_from(*self._precise, start, x, steps=FEW_STEPS)

    def unprojected(self, start: float, x: np.ndarray, times: np.ndarray) -> np.ndarray:
        return self._states_from(self.formulation, self._of(self.formulation), start, x, project=False)(times)

    def _states_from(
        self,
        form: Formulation,
        compiled: CompiledIntegrator,
        start: float,
        x: np.ndarray,
        *,
        project: bool = True,
        steps: int = MAX_STEPS,
    ) -> StatesAt:
        z, p = self._unknowns(compiled, form, start, x), self._parameters(None)
        u = self.signals.channel_from(np.array([start]))

        def integrated(times: np.ndarray) -> np.ndarray:
            columns = None if u is None else np.tile(u, (1, times.size))
            # dense output is less exact than steps: those end at each of the times
            problem = InitialValueProblem(x, z, start, times, p, columns, np.ones(times.size, bool))
            try:
                states = compiled.advance(problem, steps)[0]
            except IntegrationFailure as failure:
                if failure.flag != "IDA_LINESEARCH_FAIL" or not form.is_algebraic:
                    raise
                states = compiled.advance(replace(problem, z=perturbed(z)), steps)[0]
            return self.outputs.projected(times, states) if project else states

        return states_from_start(start, x, integrated)

    def note_turning(self, x: np.ndarray) -> None:
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self._fastest = max(self._fastest, largest(turning))


def _path(piece: Piece, x: np.ndarray, states: np.ndarray, since: np.ndarray) -> Path:
    """Path from a state through those at all times of a piece, with the integrals since its start."""
    increments = np.diff(since, axis=0, prepend=np.zeros((1, since.shape[1])))
    return Path(np.append(piece.start, piece.times), np.vstack([x, states]), increments)


def perturbed(z: np.ndarray) -> np.ndarray:
    """Return unknowns near consistent ones; at these themselves the search of IDAS mistakes rounding for a failure."""
    return z + LEAST_PERTURBATION + PERTURBATION * np.abs(z)
