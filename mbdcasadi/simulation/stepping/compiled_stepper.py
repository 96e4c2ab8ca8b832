"""The stepper of CasADi's integrators: the forms of the equations that are tried in turn, and singular poses."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...errors import SimulationError
from ...integrators import IDAS, Integrator, RungeKutta
from ...integrators.compiled import (
    FEW_STEPS,
    PART_STEPS,
    CompiledIntegrator,
    Dae,
    Forms,
    InitialValueProblem,
    IntegrationFailure,
)
from ...integrators.native.pieces import NativeIntegrator
from ...integrators.native.stretch import ExplicitSystem
from ...model.forces.active_rows import ActiveRows
from ...numerics.console import Interruption
from ...numerics.least_squares import largest
from ..contact.compiled_elements import compiled_elements
from ..contact.watched_terms import WatchedTerms, watched_terms
from ..formulations import Formulation, Regularised, choose_formulation
from ..path import Path, StatesAt, states_from_start
from ..schedule import PIECES, Piece
from ..stepper import PRECISE, Counts, Looks, SteppedSystem, Stepper, lending_of
from .explicit_system import explicit_system, switching_of

#: Rate at which drift decays in the regularised form, by piece, and by radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0


class NearSingularPose(IntegrationFailure):
    """The usual form of the equations failed near a singular pose, which may be passed otherwise."""

    def __init__(self, failure: IntegrationFailure):
        super().__init__(failure.flag, failure.x, failure.z, failure.last, failure.last_x, failure.integrals)


def refuse_joined_bodies(integrator: Integrator, numeric: NumericEquations) -> None:
    """Raise with the names of what a method for free bodies does not take."""
    eom = numeric.eom
    contacts = [one.name for one in eom.mechanism.elements if isinstance(one, ActiveRows)]  # once they close
    names = list(dict.fromkeys([*(eom.row_names if eom.lam.numel() else []), *contacts]))
    held = f"{', '.join(names[:6])} hold{'s' * (len(names) == 1)} bodies" if names else ""
    if held or numeric.massless:
        raise SimulationError(
            f'method="{integrator.name}" takes bodies with mass that no joint holds, and '
            f'{held or "a body has no mass"}; use method="idas"'
        )


class CompiledStepper(Stepper):
    """Advances by CasADi's integrators, one form of the equations after the other."""

    def __init__(self, system: SteppedSystem, looks: Looks | None = None):
        super().__init__(system, looks)
        self._terms, self._usual_length = watched_terms(self.numeric.eom), system.span / PIECES
        self._compiled: dict[Formulation, CompiledIntegrator] = {}
        self._borrowed: list[tuple[Any, tuple[CompiledIntegrator, Any]]] = []
        #: notices Ctrl-C in the run that it advances
        self._interruption: Interruption | None = None
        #: largest angular velocity that was seen, rad/s
        self._fastest = 0.0
        #: starts and steps before the integrators were given back
        self._before = 0, 0
        self._precise: tuple[Formulation, CompiledIntegrator] | None = None

    @property
    def notes(self) -> list[str]:
        notes = [one.note for one in self._compiled.values() if isinstance(one, NativeIntegrator)]
        remark = "" if notes else compiled_elements(self._terms)[1]
        return [*notes, *([remark] if remark else [])]

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
            made = method.over_pieces(self._forms(form, terms))
            made = made or CompiledIntegrator(self._system(form, terms), self._careful(method))
            # the expression is kept beside it: a hash in the structure is unique only while the node lives
            return made, signals.parametrised

        borrowed = lending_of(numeric).borrow(key, make)
        if not method.plugin:  # one of equal settings, which may have others of its own
            borrowed[0].integrator = method
        borrowed[0].restart_counting()
        self._borrowed.append((key, borrowed))
        return borrowed[0]

    def _careful(self, method: Integrator) -> Integrator:
        """A method with tolerances at which its steps follow what switches."""
        if method.error_at_switches == 1.0:
            return method
        switching = switching_of(self.numeric.eom, self.signals, with_gaps=True)
        return method.for_switches() if switching.numel_out(0) else method

    def _forms(self, form: Formulation, terms: WatchedTerms | None) -> Forms:
        """The equations for a method in code of its own."""
        numeric, signals = self.numeric, self.signals

        def explicit() -> ExplicitSystem:
            refuse_joined_bodies(self.integrator, numeric)
            return explicit_system(numeric, signals, terms, implicit=True)

        eom, integrands = numeric.eom, ca.SX(0, 1) if terms is None else terms.rates
        forward = partial(numeric.forward_dynamics, redundant=form.tolerates_redundancy)
        return Forms(eom, signals.function(eom), integrands, forward, explicit)

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
        """Algebraic unknowns of the integrator at a state."""
        if not form.is_algebraic:
            return np.zeros(0)
        found, part = self.outputs.unknowns(time, x), compiled.part
        return found if part is None else found[part.unknowns]

    def advance(
        self,
        piece: Piece,
        x: np.ndarray,
        interruption: Interruption,
        comes_near: Callable[[Path], bool] | None = None,
        stopped: IntegrationFailure | None = None,
    ) -> Path:
        form, compiled, self._interruption = self.formulation, self._of(self.formulation), interruption
        if stopped is None:
            try:
                states = compiled.advance(self._problem(form, piece, x), interruption)[0]
                return _path(piece, x, states, compiled.integrals)
            except IntegrationFailure as failure:
                stopped = failure
            if interruption.requested:
                raise KeyboardInterrupt
        if self.numeric.eom.lam.numel() and not isinstance(form, Regularised) and not self.numeric.eom.Q_depends_on_lam:
            if comes_near is not None and len(stopped.x) and comes_near(_path(piece, x, stopped.x, stopped.integrals)):
                raise NearSingularPose(stopped)
            across = self._regularised(piece, x, stopped)
            if across is not None:
                return across
        if interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
            raise KeyboardInterrupt from None
        raise stopped

    def _regularised(self, piece: Piece, x: np.ndarray, stopped: IntegrationFailure) -> Path | None:
        """The path over a piece whose last part is in the form that passes singular poses; None if it fails too."""
        form, count = Regularised(), len(stopped.x)
        problem, compiled = self._problem(form, piece, x), self._of(form)
        if count:
            problem = problem.after(stopped.x[-1], problem.z, float(problem.times[count - 1]), slice(count, None))
        try:
            states = compiled.advance_as_whole(problem, PART_STEPS)[0]
        except IntegrationFailure:
            return None
        before = stopped.integrals[-1] if count else 0.0
        integrals = np.vstack([stopped.integrals, before + compiled.integrals]) if count else compiled.integrals
        return _path(piece, x, np.vstack([stopped.x, states]), integrals)

    def _problem(self, form: Formulation, piece: Piece, x: np.ndarray) -> InitialValueProblem:
        """The piece from a state at its start, as the integrator of a form takes it."""
        (start, times), u = piece.inside, self.signals.channel_from(piece.begins)
        z, p = self._unknowns(self._of(form), form, piece.start, x), self._parameters(piece)
        return InitialValueProblem(x, z, start, times, p, u, piece.stops, self.max_step)

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
        return self._states_from(*self._precise, start, x, in_parts=False)

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
        in_parts: bool = True,
    ) -> StatesAt:
        z, p = self._unknowns(compiled, form, start, x), self._parameters(None)
        u = self.signals.channel_from(np.array([start]))

        def integrated(times: np.ndarray) -> np.ndarray:
            columns = None if u is None else np.tile(u, (1, times.size))
            # dense output is less exact than steps: those end at each of the times
            problem = InitialValueProblem(x, z, start, times, p, columns, np.ones(times.size, bool))
            if in_parts:
                states = compiled.advance(problem, self._interruption)[0]
            else:
                states = compiled.advance_as_whole(problem, FEW_STEPS)[0]
            return self.outputs.projected(times, states) if project else states

        return states_from_start(start, x, integrated)

    def note_turning(self, x: np.ndarray) -> None:
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self._fastest = max(self._fastest, largest(turning))


def _path(piece: Piece, x: np.ndarray, states: np.ndarray, since: np.ndarray) -> Path:
    """Path from a state through those at the first times of a piece, with the integrals since its start."""
    increments = np.diff(since, axis=0, prepend=np.zeros((1, since.shape[1])))
    return Path(np.append(piece.start, piece.times[: len(states)]), np.vstack([x, states]), increments)
