"""The variables by which a motion is differentiated: parameters, inputs, starts, as one vector of numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import position_in
from ..assembly.setup import Setup
from ..errors import ModelError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.quantities import entries
from ..model.symbols import Input, Parameter, StateVariable, as_expression, place_of
from ..numerics.lazy import cached_property
from ..results.state import State
from .differentiable_start import DifferentiableStart


@dataclass(frozen=True, eq=False)
class Entry:
    """One thing to differentiate by.

    Attributes
    ----------
    key : Parameter, Input, StateVariable or relation
        As the user gave it.
    label : str
        In words.
    kind : {"parameter", "input", "samples", "state", "condition", "later"}
        The variable; a parameter or input that only later mechanisms have is "later".
    index : int
        Position among those of its kind.
    values : numpy.ndarray
        Its values now (k,): one, or the samples of an input.
    lower, upper : float
        Its limits.
    """

    key: Any
    label: str
    kind: str
    index: int
    values: np.ndarray
    lower: float = -np.inf
    upper: float = np.inf

    @property
    def size(self) -> int:
        """Count of numbers."""
        return self.values.size


class DesignVariables:
    """Entries in the order given, and what they set in a compiled motion.

    Parameters
    ----------
    wrt : sequence
        Parameters; inputs (the constant, or every sample); first-order states
        (their initial estimate); relations of ``initial=`` (their right side).
    setup : Setup
        Mechanism, parameters, inputs, times; ``initial`` as it was given, to recognise relations.
    start : DifferentiableStart
        The start.
    """

    def __init__(self, wrt: Any, setup: Setup, start: DifferentiableStart):
        self.start, self._setup = start, setup
        keys = entries(wrt, "wrt=")
        if not keys:
            raise ModelError("wrt= is empty; name parameters, inputs, states or relations of initial=")
        self.entries = tuple(self._entry(key) for key in keys)
        for k, entry in enumerate(self.entries):
            if any(e.kind == entry.kind and e.index == entry.index for e in self.entries[:k]):
                raise ModelError(f"wrt= names {entry.label} twice")
        self.places = np.cumsum([0, *[e.size for e in self.entries]])

    @property
    def size(self) -> int:
        """Length of the vector."""
        return int(self.places[-1])

    @property
    def values(self) -> np.ndarray:
        """The vector at the values given."""
        return np.concatenate([e.values for e in self.entries])

    @property
    def bounds(self) -> list[tuple[float, float]]:
        """Limits of each number, as ``scipy.optimize`` takes them."""
        return [(e.lower, e.upper) for e in self.entries for _ in range(e.size)]

    def slice_of(self, key: Any) -> slice:
        """Slice of an entry in the vector."""
        for k, entry in enumerate(self.entries):
            if same(entry.key, key):
                return slice(int(self.places[k]), int(self.places[k + 1]))
        names = ", ".join(e.label for e in self.entries)
        raise ModelError(f"{getattr(key, 'label', key)!r} is not among what was differentiated by: {names}")

    # --- reading --------------------------------------------------------------------
    def _entry(self, key: Any) -> Entry:
        mechanism, p = self._setup.mechanism, self._setup.p
        if isinstance(key, Parameter):
            k = position_in(mechanism.parameters, key, "wrt=")
            return Entry(key, f"parameter '{key.label}'", "parameter", k, p[[k]], key.lower, key.upper)
        if isinstance(key, Input):
            return self._input(key, position_in(mechanism.inputs, key, "wrt="))
        if isinstance(key, StateVariable):
            k = position_in(mechanism.states, key, "wrt=")
            value = self.start.z_estimate[[k]]
            return Entry(key, f"start of state '{key.label}'", "state", k, value, key.lower, key.upper)
        return self._relation(key)

    def _input(self, key: Input, k: int) -> Entry:
        signals = self._setup.signals
        samples = signals.samples
        if k in samples:
            place = list(samples).index(k)
            return Entry(key, f"input '{key.label}'", "samples", place, samples[k], key.lower, key.upper)
        if k not in signals.level_places:
            raise ModelError(
                f"wrt= holds input '{key.label}', which is given by an expression in time or state; "
                "put parameters into the expression and differentiate by these"
            )
        place = signals.level_places[k]
        value = signals.level_values[[place]]
        return Entry(key, f"input '{key.label}'", "input", place, value, key.lower, key.upper)

    def _relation(self, key: Any) -> Entry:
        if not isinstance(key, ca.SX) or key.numel() != 1 or isinstance(self._setup.initial, State):
            raise ModelError(f"wrt= takes parameters, inputs, states, or scalar relations of initial=; got {key!r}")
        labels = [c.label for c in self.start.conditions]
        read: Sequence[Condition] = read_conditions([key])
        if not read[0].equality or read[0].label not in labels:
            raise ModelError(f"wrt= holds {read[0].label}, which is not an equality of initial=")
        return Entry(key, f"right side of {read[0].label}", "condition", labels.index(read[0].label), np.zeros(1))

    # --- setting --------------------------------------------------------------------------
    @cached_property
    def function(self) -> ca.Function:
        """``d -> (right sides, z estimate, p, levels, channel)``: the start and the run by the vector."""
        signals, grid, start = self._setup.signals, self._setup.grid, self.start
        given = start.right, start.z_estimate, self._setup.p, signals.level_values, signals.channel_over(grid)
        right, z, p, levels, channel = (ca.MX(ca.DM(part)) for part in given)
        d, steps = ca.MX.sym("d", self.size), ca.DM(np.diff(grid)).T
        for entry, low, high in zip(self.entries, self.places[:-1], self.places[1:], strict=True):
            entry_values = d[int(low) : int(high)]
            if entry.kind == "parameter":
                p[entry.index] = entry_values
            elif entry.kind == "condition":
                right[entry.index] = entry_values
            elif entry.kind == "state":
                z[entry.index] = entry_values
            elif entry.kind == "input":
                levels[entry.index] = entry_values
            elif entry.kind == "samples":
                channel[2 * entry.index, :] = entry_values[:-1].T
                channel[2 * entry.index + 1, :] = (entry_values[1:] - entry_values[:-1]).T / steps
        return ca.Function("given", [d], [right, z, p, levels, channel])

    @property
    def varied(self) -> list[int]:
        """Positions of the parameters among the entries."""
        return [entry.index for entry in self.entries if entry.kind == "parameter"]

    def parameters(self, d: np.ndarray) -> np.ndarray:
        """Parameter values at a vector."""
        p = self._setup.p.copy()
        for entry, low in zip(self.entries, self.places[:-1], strict=True):
            if entry.kind == "parameter":
                p[entry.index] = d[low]
        return p


class PhasedDesignVariables(DesignVariables):
    """Entries of a motion through several mechanisms: parameters and inputs of all of them.

    Parameters
    ----------
    wrt, setup, start
        As for :class:`DesignVariables`, of the first mechanism.
    whole : Mechanism
        All parts of the mechanisms.
    values : mapping
        Values of parameters and inputs by symbol.
    """

    def __init__(self, wrt: Any, setup: Setup, start: DifferentiableStart, whole: Mechanism, values: Mapping[Any, Any]):
        self._whole, self._values = whole, values
        super().__init__(wrt, setup, start)

    def _entry(self, key: Any) -> Entry:
        first = self._setup.mechanism
        known = {Parameter: ("parameter", "parameters"), Input: ("input", "inputs")}
        for kind, (word, name) in known.items():
            if isinstance(key, kind) and place_of(key, getattr(first, name)) is None:
                k = position_in(getattr(self._whole, name), key, "wrt=")
                value = self._values.get(key, key.value)
                if isinstance(value, ca.SX) or np.ndim(value):
                    raise ModelError(
                        f"wrt= holds input '{key.label}', which is given by an expression; put parameters into it and "
                        "differentiate by these"
                    )
                return Entry(key, f"{word} '{key.label}'", "later", k, np.array([float(value)]), key.lower, key.upper)
        return super()._entry(key)


def find_output(outputs: Iterable[tuple[Any, Any]], key: Any) -> int | None:
    """Return the place of an output among pairs of a name and an expression, by either; None if there is none."""
    if isinstance(key, str):
        return next((k for k, (name, _) in enumerate(outputs) if isinstance(name, str) and name == key), None)
    wanted = as_expression(key, "output")
    return next((k for k, (_, expression) in enumerate(outputs) if same(expression, wanted)), None)


def output_place(outputs: Iterable[tuple[Any, Any]], key: Any) -> int:
    """Return the place of an output as :func:`find_output` does; the error of a missing one names the others."""
    pairs = list(outputs)
    place = find_output(pairs, key)
    if place is None:
        raise ModelError(f"{key!r} is not among the outputs: {', '.join(str(name) for name, _ in pairs)}")
    return place


def same(one: Any, other: Any) -> bool:
    """True if two keys are the same expression, entry by entry of the graph."""
    if one is other:
        return True
    if not isinstance(one, ca.SX) or not isinstance(other, ca.SX) or one.shape != other.shape:
        return False
    return all(
        ca.is_equal(a, b, 8) for a, b in zip(ca.vertsplit(ca.vec(one)), ca.vertsplit(ca.vec(other)), strict=True)
    )
