"""A mechanism as JavaScript: its equations, its start, and the numbers that a page needs to solve them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...assembly.consistent_start import levels_of
from ...assembly.setup import Setup
from ...equations.numeric import NumericEquations
from ...errors import ExpressionError, MechanismError
from ...model.conditions import Condition, read_conditions, stacked
from ...model.forces.friction.modes import switching
from ...model.mechanism import Mechanism
from ...model.symbols import Input, Parameter, place_of
from ...numerics.graph import count_of_operations
from ...printing.javascript import to_javascript, unknown_operation
from ...results.state import State
from ...results.validity import validity_conditions
from ...simulation.contact.watched_terms import has_gaps

#: Names of the arguments of all functions of a page.
ARGUMENTS = ["t", "q", "v", "a", "z", "lam", "u", "p"]
#: Longest step, s: if forces begin at a contact or a stop, which a long step would jump over, and otherwise.
STEP_TO_CONTACTS, STEP = 1 / 400, 1 / 60
#: Violation of the constraints that counts as zero, in sizes of the mechanism.
TOLERANCE = 1e-12
#: Frequency with which the whole mechanism would swing at the pointer, Hz.
PULL = 1.5


class LiveModel:
    """The equations of motion of a mechanism for a page that solves them.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    initial : sequence of relations, or State
        The start.
    parameters, inputs : sequence, optional
        Symbols that sliders change; by default all parameters and inputs of the mechanism.

    Attributes
    ----------
    setup : Setup
        The mechanism at its start.
    sliders : list of Slider
    varying : casadi.SX
        Parameters with a slider.

    Raises
    ------
    MechanismError
        If the page cannot follow the mechanism: exact stick and slip, inequalities at the start, operations without a
        counterpart in JavaScript, friction on redundant joints; and for a slider that the mechanism does not have.
    """

    def __init__(self, mechanism: Any, initial: Any, parameters: Any, inputs: Any):
        if not isinstance(mechanism, Mechanism):
            raise MechanismError(f"animate: live=True takes a mechanism, which the page solves, got {mechanism!r}")
        _refuse_elements(mechanism)
        time = float(initial.t) if isinstance(initial, State) else 0.0
        self.setup = Setup(mechanism, "animate", t=time, initial=initial)
        self.mechanism, self.eom = mechanism, self.setup.eom
        self.numeric: NumericEquations = self.setup.numeric
        self.start: State = self.setup.start
        if self.eom.Q_depends_on_lam and self.setup.has_redundant_rows:
            raise MechanismError(
                "animate: live=True cannot share friction among redundant joints, of which no single load is known; "
                "leave out a redundant joint (check names them), or animate a motion of simulate"
            )
        _ = self.start[self.eom.a]  # raises if there are no accelerations
        self.sliders = _sliders(mechanism, self.start, parameters, inputs)
        self._refuse_values()
        self._positions, self._speeds = self._conditions()

    @property
    def varying(self) -> ca.SX:
        """Parameters that have a slider."""
        symbols = [s.symbol for s in self.sliders if not s.is_input]
        return ca.vertcat(ca.SX(0, 1), *symbols)

    def _refuse_values(self) -> None:
        """Raise if a slider leads to a value that the model refuses, as a negative mass."""
        for slider in self.sliders:
            for end in () if slider.is_input else (slider.low, slider.high):
                values = self.setup.p.copy()
                values[slider.index] = end
                try:
                    self.mechanism.check_values(values)
                except MechanismError as error:
                    raise MechanismError(
                        f"animate: the slider of '{slider.name}' goes from {slider.low:g} to {slider.high:g}, but "
                        f"{error}; give the parameter narrower limits, Parameter(…, lower=, upper=)"
                    ) from error

    def _conditions(self) -> tuple[list[Condition], list[Condition]]:
        """Conditions of the start, on positions and on velocities."""
        if isinstance(self.setup.initial, State):
            return [], []
        positions, speeds, states = levels_of(self.numeric, read_conditions(self.setup.initial))
        for condition in (*positions, *speeds):
            if not condition.equality:
                raise MechanismError(
                    f"animate: live=True starts from equalities, got {condition.label}; "
                    "state the value at which it is to start"
                )
        for condition in states:
            if self.varying.numel() and ca.depends_on(condition.expression, self.varying):
                raise MechanismError(
                    f"animate: the first-order state in {condition.label} would change with a slider; "
                    "state its start as a number"
                )
        return positions, speeds

    # --- code --------------------------------------------------------------------------------
    def functions(self, outputs: ca.SX) -> dict[str, ca.Function]:
        """Functions of the page by name, each of all arguments and with one column as its result.

        Parameters
        ----------
        outputs : casadi.SX
            Expressions that the page shows (k,).
        """
        eom = self.eom
        entries = _entries(eom.Phi_q)
        columns = {
            "mass": eom.mass_diagonal,
            "weights": self.numeric.weights_expression,
            "constraints": ca.vertcat(eom.Phi, entries, eom.nu),
            "dynamics": ca.vertcat(eom.Q, eom.gamma, entries),
            "outputs": outputs,
            "conditions": self._rows(self._positions, eom.q),
            "speeds": self._rows(self._speeds, eom.v),
            "validity": ca.vertcat(ca.SX(0, 1), *[c.expression for c in validity_conditions(self.mechanism)]),
        }
        if eom.z.numel():
            columns["rates"] = eom.z_rate
        if eom.Q_depends_on_lam:
            columns["slope"] = _entries(ca.jacobian(eom.Q, eom.lam))
        return {name: self._function(name, column) for name, column in columns.items()}

    def _rows(self, conditions: Sequence[Condition], unknowns: ca.SX) -> ca.SX:
        """Values of conditions, those on velocities at rest, and the entries of their slopes."""
        values = stacked(conditions)
        entries = _entries(ca.jacobian(values, unknowns))
        if unknowns is self.eom.v:
            values = ca.substitute(values, unknowns, ca.SX.zeros(unknowns.numel()))
        return ca.vertcat(values, entries)

    def _function(self, name: str, column: ca.SX) -> ca.Function:
        column = ca.cse(ca.densify(ca.SX(column)))
        return ca.Function(name, list(self.eom.symbols), [column], ARGUMENTS, ["y"])

    def code(self, functions: dict[str, ca.Function]) -> str:
        """JavaScript of functions, with a table of them and of arrays for their values."""
        parts = ["const MODEL = {};"]
        for name, function in functions.items():
            size = function.numel_out(0)
            parts.append(to_javascript(function, f"model_{name}"))
            parts.append(f"MODEL.{name} = {{ call: model_{name}, values: new Float64Array({size}) }};")
        return "\n".join(parts)

    # --- numbers --------------------------------------------------------------------------------
    def data(self) -> dict[str, Any]:
        """Numbers of the model as the page reads them."""
        from scipy.integrate import DOP853

        eom, numeric, start = self.eom, self.numeric, self.start
        masses = [float(m) for m in numeric.mass[: 3 * len(self.mechanism.bodies) : 3]]
        heavy = sum(masses) or 1.0
        stiffness = heavy * (2 * np.pi * PULL) ** 2
        q, v, _ = eom.estimate
        from_state = isinstance(self.setup.initial, State)
        light = self._effective_masses()
        return {
            "n": eom.q.numel(), "m": eom.lam.numel(), "t0": start.t,
            "q0": start.q.tolist(), "v0": start.v.tolist(), "z0": start.z.tolist(),
            "u0": start.inputs.tolist(), "p0": numeric.p.tolist(),
            "estimate": {"q": (start.q if from_state else q).tolist(), "v": (start.v if from_state else v).tolist()},
            "positionRows": eom.position_rows.tolist(),
            "jacobian": _triplets(eom.Phi_q),
            "slope": _triplets(ca.jacobian(eom.Q, eom.lam)) if eom.Q_depends_on_lam else None,
            "conditions": {"count": len(self._positions), **self._slopes(self._positions, eom.q)},
            "speeds": {"count": len(self._speeds), **self._slopes(self._speeds, eom.v)},
            "effectiveMasses": None if light is None else np.asarray(light).tolist(),
            "angular": eom.angular_rows.astype(int).tolist(), "angles": eom.angles.astype(int).tolist(),
            "projectionWeights": numeric.projection_weights.tolist(),
            "size": numeric.scale.length, "tolerance": TOLERANCE * max(1.0, numeric.scale.length),
            "maxStep": STEP_TO_CONTACTS if has_gaps(self.mechanism) else STEP,
            "pull": {"stiffness": stiffness, "damping": float(np.sqrt(stiffness * heavy))},
            "driven": bool(self.mechanism.drivers),
            "sliders": [s.data() for s in self.sliders],
            "validity": [c.message for c in validity_conditions(self.mechanism)],
            "tableau": {name: getattr(DOP853, name).tolist() for name in ("A", "B", "C", "E3", "E5")},
        }  # fmt: skip

    def _effective_masses(self) -> np.ndarray | None:
        """Effective masses of the rows, if bodies are light or may become light by a slider; any will do."""
        light = self.numeric.augmentation
        for slider in self.sliders:
            if light is None and not slider.is_input and ca.depends_on(self.eom.mass_diagonal, slider.symbol):
                values = self.setup.p.copy()
                values[slider.index] = slider.low
                light = NumericEquations(self.eom, values).augmentation
        return light

    @staticmethod
    def _slopes(conditions: Sequence[Condition], unknowns: ca.SX) -> dict[str, list[int]]:
        return _triplets(ca.jacobian(stacked(conditions), unknowns))

    def largest_element(self) -> str:
        """Description of the element with the most operations."""
        elements = [*self.mechanism.joints, *self.mechanism.drivers, *self.mechanism.forces]
        sizes = [count_of_operations(_expressions(e)) for e in elements]
        return f"{elements[int(np.argmax(sizes))].description} ({max(sizes)} operations)" if sizes else "the bodies"


class Slider:
    """A parameter or an input that a page changes, and its range."""

    def __init__(self, symbol: Any, index: int, value: float, is_input: bool):
        self.symbol, self.index, self.value, self.is_input = symbol, index, value, is_input
        self.name: str = symbol.label
        low, high = float(symbol.lower), float(symbol.upper)
        # without limits: about the value, on its side of zero; an input to both sides
        span = 2 * abs(value) or (10.0 if is_input else 1.0)
        least = -span if is_input or value == 0 else (0.2 * value if value > 0 else 2 * value)
        most = span if is_input or value >= 0 else 0.2 * value
        self.low = low if np.isfinite(low) else min(least, value, high)
        self.high = high if np.isfinite(high) else max(most, value, self.low)
        if not self.low < self.high:
            raise MechanismError(f"animate: '{self.name}' has no range for a slider, {self.low:g} … {self.high:g}")

    def data(self) -> dict[str, Any]:
        """The slider as the page reads it."""
        return {
            "name": self.name, "input": self.is_input, "index": self.index, "value": self.value,
            "low": self.low, "high": self.high, "unit": "",
        }  # fmt: skip


def _sliders(mechanism: Mechanism, start: State, parameters: Any, inputs: Any) -> list[Slider]:
    sliders = []
    for asked, own, values, kind, name in (
        (parameters, mechanism.parameters, start.parameters, Parameter, "parameters"),
        (inputs, mechanism.inputs, start.inputs, Input, "inputs"),
    ):
        listed = [asked] if isinstance(asked, kind) else own if asked is None else asked
        if isinstance(listed, dict) or not isinstance(listed, Sequence):
            raise MechanismError(f"animate: {name}= takes a list of parameters and inputs, got {asked!r}")
        for symbol in listed:
            index = place_of(symbol, own)
            if index is None:
                raise MechanismError(f"animate: {name}= holds {symbol!r}, which the mechanism does not have")
            sliders.append(Slider(symbol, index, float(values[index]), kind is Input))
    names = [slider.name for slider in sliders]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise MechanismError(f"animate: two sliders would be called '{twice}'; name parameters and inputs apart")
    return sliders


def _refuse_elements(mechanism: Mechanism) -> None:
    """Raise for elements that a page cannot follow."""
    for element in switching(mechanism):
        raise MechanismError(
            f"animate: a live page does not follow {element.description}: it {element.exactness}, or animate a motion "
            "of simulate"
        )
    for element in mechanism.elements:
        missing = unknown_operation(_expressions(element))
        if missing is not None:
            raise ExpressionError(
                f"animate: {element.description} uses the operation '{missing}', which a page cannot evaluate; "
                "animate a motion of simulate"
            )


def _expressions(element: Any) -> ca.SX:
    """All that an element contributes to the equations, as one column."""
    return ca.vertcat(ca.SX(0, 1), *[ca.vec(ca.SX(part)) for part in element.expressions()])


def _entries(matrix: ca.SX) -> ca.SX:
    """Nonzero entries of a matrix as a column."""
    return ca.vertcat(ca.SX(0, 1), *matrix.nonzeros())


def _triplets(matrix: ca.SX) -> dict[str, list[int]]:
    """Rows and columns of the nonzero entries of a matrix."""
    rows, columns = matrix.sparsity().get_triplet()
    return {"rows": [int(k) for k in rows], "columns": [int(k) for k in columns]}
