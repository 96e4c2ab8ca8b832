"""The equations, outputs and start of a mechanism as functions that are written as C."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..assembly.consistent_start import levels_of
from ..equations import Equations
from ..equations.least_norm import of_least_norm
from ..equations.newton_code import NewtonLoop, newton_step
from ..equations.numeric import NumericEquations
from ..equations.saddle import REPORTED, SHIFTED, Saddle
from ..equations.switching.explicit_time import explicit_time
from ..errors import ModelError
from ..model.conditions import Condition, stacked
from ..model.validity import ValidityCondition
from ..numerics.c_code import Tape, UnsupportedOperation, simplified, tape_of
from ..numerics.lazy import cached_property
from ..numerics.rank import analyse_rank
from ..numerics.tolerances import MET
from ..results.state import State
from ..results.validity import validity_conditions
from ..simulation.contact.compiled_elements import repeated_elements
from ..simulation.contact.watched_terms import WatchedTerms, least_gap, watched_terms
from ..simulation.quantities import quantities_of
from ..simulation.stepping.explicit_system import dynamics_of, projection_of, switching_of


@dataclass(frozen=True, eq=False)
class Model:
    """Mechanism, start and outputs of a unit.

    Attributes
    ----------
    numeric : NumericEquations
        Equations at the values of the export.
    signals : Signals
        Inputs of the mechanism.
    start : State
        The start.
    conditions : tuple of Condition
        Conditions that the start meets besides the constraints.
    outputs : dict of str to casadi.SX
        Scalars by name.
    drift_rate : float
        Rate with which drift from the constraints decays in model exchange, 1/s.
    is_state : bool
        True if the start was given as a state; a start at other parameters is then the nearest one to it.
    """

    numeric: NumericEquations
    signals: Signals
    start: State
    conditions: tuple[Condition, ...]
    outputs: dict[str, ca.SX]
    drift_rate: float
    is_state: bool = False

    @property
    def estimate(self) -> np.ndarray:
        """Values of (q, v, z) to which the start is nearest among all that meet the constraints and conditions."""
        start = self.start
        q, v, z = (start.q, start.v, start.z) if self.is_state else self.eom.estimate
        return np.r_[q, v, start.z if self.eom.follows_states else z]  # states of servos may follow the pose

    @property
    def eom(self) -> Equations:
        """The symbolic equations."""
        return self.numeric.eom

    @cached_property
    def is_redundant(self) -> bool:
        """True if constraint rows depend on each other at the start."""
        return self.numeric.has_redundant_rows(self.start.t, self.start.q)

    @cached_property
    def levels(self) -> tuple[list[Condition], list[Condition], list[Condition]]:
        """Conditions on positions, velocities and states that hold as equalities at the start."""
        held = [c for c in self.conditions if c.equality or abs(float(self.start[c.expression])) <= MET]
        return levels_of(self.numeric, tuple(held))

    # --- the equations -------------------------------------------------------------------
    @property
    def _known(self) -> list[ca.SX]:
        eom = self.eom
        return [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]

    def refuse_unsupported(self) -> None:
        """Raise if the reactions on which forces depend are not unique."""
        if self.eom.Q_depends_on_lam and self.is_redundant:
            raise ModelError(f"export_fmu: {self.eom.why_not_unique}")

    def _solve(self, force: ca.SX, gamma: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Changes of (a, lam) that changes of the force and of the right side of the acceleration equation cause."""
        eom, numeric = self.eom, self.numeric
        if eom.Q_depends_on_lam:
            return numeric.saddle(under_reactions=True).solve(force, gamma)
        a, lam = numeric.saddle(REPORTED if self.is_redundant else None).solve(force, gamma)
        weights = numeric.multiplier_weights if self.is_redundant else None
        return a, lam if weights is None else of_least_norm(eom, lam, weights)

    @property
    def _dynamics(self) -> list[Tape | NewtonLoop]:
        """Code of ``(t, q, v, z, u, p) -> (a, rate of z, lam, regularity)``, after that of the functions it calls."""
        eom = self.eom
        if not self.eom.Q_depends_on_lam:
            return [_tape(_renamed(dynamics_of(self.numeric, redundant=self.is_redundant), "dynamics"))]
        results = [eom.a, ca.densify(eom.z_rate), eom.lam, ca.SX(1)]
        functions = [
            newton_step(eom, "dynamics_step", self.numeric.augmentation),
            ca.Function("dynamics_results", [*self._known, ca.vertcat(eom.a, eom.lam)], results),
        ]
        step, results_of = map(_tape, functions)
        return [step, results_of, NewtonLoop("dynamics", step, results_of)]

    @property
    def _projection(self) -> ca.Function:
        eom = self.eom
        if eom.lam.numel():
            return _renamed(projection_of(eom), "projection")
        weights = ca.SX.sym("weights", eom.q.numel())
        return ca.Function("projection", [eom.t, eom.q, eom.v, eom.z, eom.p, weights], [eom.q, eom.v, ca.SX(0)])

    @property
    def _outputs(self) -> ca.SX:
        return ca.densify(ca.vertcat(ca.SX(0, 1), *self.outputs.values()))

    @property
    def _tangent(self) -> ca.Function:
        """``(t, q, v, a, z, lam, u, p, dq, dv, dz, du, dp) -> (d rates of x, d outputs)``."""
        eom = self.eom
        along = [ca.SX.sym(f"d{name}", symbol.numel()) for name, symbol in zip("qvzup", self._seeded, strict=True)]
        symbols, seeds = ca.vertcat(*self._seeded), ca.vertcat(*along)
        left, n = -ca.jtimes(ca.densify(eom.residual()), symbols, seeds), eom.q.numel()
        da, dlam = self._solve(left[:n, :], left[n:, :])
        everything = ca.vertcat(symbols, eom.a, eom.lam)
        every_seed = ca.vertcat(seeds, da, dlam)

        def change(expression: ca.SX) -> ca.SX:
            return ca.densify(ca.jtimes(ca.densify(expression), everything, every_seed))

        rates = ca.vertcat(along[1] + change(self._drift[0]), da + change(self._drift[1]), change(eom.z_rate))
        results = [ca.densify(rates), change(self._outputs)]
        return ca.Function("tangent", [*eom.symbols, *along], results)

    @property
    def _seeded(self) -> list[ca.SX]:
        eom = self.eom
        return [eom.q, eom.v, eom.z, eom.u, eom.p]

    @cached_property
    def _drift(self) -> tuple[ca.SX, ca.SX]:
        """Terms that are added to the rates of q and v so that drift from the constraints decays."""
        eom = self.eom
        if not eom.lam.numel():
            return ca.SX(eom.q.numel(), 1), ca.SX(eom.q.numel(), 1)
        weights = ca.SX(ca.DM(self.numeric.projection_weights))
        q, v, _ = projection_of(eom)(eom.t, eom.q, eom.v, eom.z, eom.p, weights)
        return self.drift_rate * (q - eom.q), self.drift_rate * (v - eom.v)

    # --- switches, checks, messages --------------------------------------------------------
    @cached_property
    def timed(self) -> ca.SX:
        """Functions of time and parameters at whose zeros something switches."""
        return explicit_time(self.eom).switches

    @cached_property
    def terms(self) -> WatchedTerms:
        """Contacts and stops with their gaps."""
        return watched_terms(self.eom)

    @cached_property
    def compared(self) -> ca.SX:
        """Quantities of the state at whose zeros loads switch."""
        return ca.vertcat(ca.SX(0, 1), *quantities_of(self.eom, self.signals).compared)

    @property
    def switching(self) -> ca.Function:
        """``(t, q, v, z, p) ->`` quantities at whose zeros the solver of the unit ends its steps."""
        return switching_of(self.eom, self.signals, with_gaps=repeated_elements(self.terms) is None)

    @property
    def gaps(self) -> ca.SX:
        """Gaps of contacts and stops."""
        return ca.vertcat(ca.SX(0, 1), *[least_gap(owner) for owner in self.terms.owners])

    @property
    def _closings(self) -> list[ca.Function]:
        """``(t, q, v, a, z, lam, u, p) ->`` gaps, their rates and bounds of these; and what accelerations add."""
        whole = list(self.eom.symbols)
        pulls = ca.jtimes(self.gaps, self.eom.q, self.eom.a) if self.terms.owners else ca.SX(0, 1)
        return [
            ca.Function("gap_rates", whole, [ca.densify(self.terms.gap_expressions)]),
            ca.Function("gap_pulls", whole, [ca.densify(pulls)]),
        ]

    @cached_property
    def checks(self) -> list[tuple[ca.SX, bool, str]]:
        """Margins of limited quantities in the parameters, whether they must be above zero, and messages."""
        limits = self.eom.mechanism.limits
        checks = []
        for limit in limits:
            for bound, strict, words in ((limit.at_least, False, "be at least"), (limit.above, True, "be above")):
                if bound is not None:
                    message = f"{limit.owner}: {limit.name} must {words} {bound:g}"
                    checks.append((limit.expression - bound, strict, message))
        return checks

    @cached_property
    def validity(self) -> tuple[ValidityCondition, ...]:
        """Conditions under which the elements are valid, and ranges of quantities that vary."""
        mechanism = self.eom.mechanism
        ranges = [
            ValidityCondition(x.expression - least, f"{x.owner}: {x.name} must be {word} {least:g}")
            for x in mechanism.varying_limits
            for word, least in (("at least", x.at_least), ("above", x.above))
            if least is not None and self.eom.contains(x.expression)
        ]
        return (*validity_conditions(mechanism), *ranges)

    @cached_property
    def forces(self) -> list[tuple[ca.SX, str]]:
        """Components of the forces of the elements, with the elements they belong to."""
        forces = []
        for element in self.eom.mechanism.elements:
            for _, force in element.virtual_work:
                forces += [(part, element.description) for part in ca.vertsplit(ca.densify(ca.vec(ca.SX(force))))]
        return [(part, owner) for part, owner in forces if not part.is_constant()]

    # --- the start ---------------------------------------------------------------------------
    @cached_property
    def _pose_rows(self) -> tuple[ca.SX, ca.SX]:
        eom = self.eom
        conditions = stacked(self.levels[0])
        return ca.vertcat(eom.Phi, conditions), ca.vertcat(eom.position_jacobian, ca.jacobian(conditions, eom.q))

    @cached_property
    def _velocity_rows(self) -> tuple[ca.SX, ca.SX]:
        eom = self.eom
        conditions = stacked(self.levels[1])
        residual = ca.vertcat(eom.Phi_q @ eom.v - eom.nu, conditions)
        return residual, ca.vertcat(eom.Phi_q, ca.jacobian(conditions, eom.v))

    def _leaves_free(self, rows: ca.SX) -> bool:
        """True if rows leave a motion free, so that the nearest to the estimate is taken."""
        eom, start = self.eom, self.start
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        slopes = ca.Function("slopes", known, [ca.densify(rows)])
        values = slopes(start.t, start.q, start.v, start.z, self.numeric.p).full()
        columns = self.numeric.column_scale
        return bool(analyse_rank(values * columns).rank < columns.size) if values.size else True

    @property
    def pose_is_nearest(self) -> bool:
        """True if conditions leave the pose of the start free in part."""
        return self._leaves_free(self._pose_rows[1])

    @property
    def velocity_is_nearest(self) -> bool:
        """True if conditions leave the velocity of the start free in part."""
        return self._leaves_free(self._velocity_rows[1])

    def _start_function(
        self, name: str, unknown: ca.SX, rows: ca.SX, slopes: ca.SX, known: Sequence[ca.SX]
    ) -> ca.Function:
        """``(…, estimate) -> (unknown, largest residual)``: one step of Newton's method, nearest to an estimate."""
        estimate = ca.SX.sym("estimate", unknown.numel())
        weights = self.numeric.weights if unknown.numel() == self.numeric.weights.size else np.ones(unknown.numel())
        if rows.numel():
            # constraints and conditions may imply each other, and conditions are in any unit
            norm = ca.sum2(slopes**2 @ ca.DM(1 / weights))
            saddle = Saddle(ca.SX(ca.DM(weights)), slopes, np.full(rows.numel(), False), SHIFTED, norm=norm)
            value = estimate - saddle.project(rows + slopes @ (estimate - unknown))
            left = ca.norm_inf(ca.densify(rows))
        else:
            value, left = estimate, ca.SX(0)
        return ca.Function(name, [*known, estimate], [ca.densify(value), left])

    @property
    def _start(self) -> list[ca.Function]:
        eom = self.eom
        pose = self._start_function("start_pose", eom.q, *self._pose_rows, [eom.t, eom.q, eom.z, eom.p])
        rows, slopes = self._velocity_rows
        velocity = self._start_function("start_velocity", eom.v, rows, slopes, [eom.t, eom.q, eom.v, eom.z, eom.p])
        at_states = stacked(self.levels[2])
        rate = ca.jacobian(at_states, eom.z)
        z = eom.z
        if at_states.numel():
            matrix = rate @ rate.T
            z = z - rate.T @ ca.solve(matrix, at_states)
        left = ca.norm_inf(ca.densify(at_states)) if at_states.numel() else ca.SX(0)
        return [pose, velocity, ca.Function("start_states", [eom.t, eom.z, eom.p], [ca.densify(z), left])]

    # --- all of them ----------------------------------------------------------------------------
    @cached_property
    def functions(self) -> list[ca.Function]:
        """All functions that the C code of a unit calls besides those of the dynamics."""
        eom = self.eom
        state = [eom.t, eom.q, eom.v, eom.z, eom.p]
        margins = ca.vertcat(ca.SX(0, 1), *[ca.SX(value) for value, _, _ in self.checks])
        valid = ca.vertcat(ca.SX(0, 1), *[c.expression for c in self.validity])
        forces = ca.vertcat(ca.SX(0, 1), *[part for part, _ in self.forces])
        return [
            self._projection,
            self.switching,
            ca.Function("outputs", list(eom.symbols), [self._outputs]),
            self._tangent,
            ca.Function("indicators", state, [ca.densify(ca.vertcat(self.timed, self.compared, self.gaps))]),
            *self._closings,
            ca.Function("checks", [eom.p], [ca.densify(margins)]),
            ca.Function("validity", list(eom.symbols), [ca.densify(valid)]),
            ca.Function("element_forces", list(eom.symbols), [ca.densify(forces)]),
            *self._start,
        ]

    @cached_property
    def code(self) -> list[Tape | NewtonLoop]:
        """Functions that are written as C, those that are called before those that call them.

        Raises
        ------
        ModelError
            For an operation that is not written as C.
        """
        try:
            return [*self._dynamics, *map(_tape, self.functions)]
        except UnsupportedOperation as error:
            raise ModelError(
                f"export_fmu: the model contains the operation '{error.operation}', which has no C code"
            ) from None

    # --- structure --------------------------------------------------------------------------------
    @cached_property
    def dependencies(self) -> tuple[np.ndarray, np.ndarray]:
        """Sparsity of the rates and the outputs by (states, inputs), (n_x, n_x + n_u) and (n_y, n_x + n_u)."""
        eom = self.eom
        known = ca.vertcat(eom.q, eom.v, eom.z, eom.u)
        unknown = ca.vertcat(eom.a, eom.lam)
        reach = np.ones((unknown.numel(), known.numel()), bool)
        if not self.eom.Q_depends_on_lam:
            a, _, lam, _ = dynamics_of(self.numeric, redundant=self.is_redundant)(*self._known)
            reach = _pattern(ca.vertcat(a, lam), known)
        rates = ca.vertcat(eom.v + self._drift[0], eom.a + self._drift[1], eom.z_rate)
        patterns = []
        for expression in (rates, self._outputs):
            direct, through = _pattern(expression, known), _pattern(expression, unknown)
            patterns.append(direct | (through.astype(int) @ reach.astype(int) > 0))
        return patterns[0], patterns[1]


def _pattern(expression: ca.SX, symbols: ca.SX) -> np.ndarray:
    """Sparsity of a column by the symbols (k, n)."""
    shape = expression.numel(), symbols.numel()
    if not all(shape):
        return np.zeros(shape, bool)
    sparsity = ca.jacobian_sparsity(ca.densify(expression), symbols)
    pattern: np.ndarray = ca.DM(sparsity, 1).full() != 0
    return pattern


def _tape(function: ca.Function) -> Tape:
    return tape_of(simplified(function))


def _renamed(function: ca.Function, name: str) -> ca.Function:
    arguments = function.sx_in()
    return ca.Function(name, arguments, [ca.densify(result) for result in function.call(arguments)])
