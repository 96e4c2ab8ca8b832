"""Result of a sweep."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter
from ..numerics.lazy import optional_package
from ..results.notebook import html_table
from ..sensitivity.design_variables import output_place

#: Cases of a sweep that a notebook shows, at most.
SHOWN_CASES = 12

if TYPE_CHECKING:
    import xarray


class Sweep:
    """Outputs of many runs; ``swept["name"]`` is (cases, n_t), or (cases, n_t, k) for a vector.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n_t,), s.
    cases : dict
        Parameter or input to its values (cases,).
    failures : dict of int to str
        Message of each case that failed; its outputs are NaN.
    done : numpy.ndarray of bool
        Indices of the cases that were run; all of them, unless the sweep was interrupted.
    seconds : float
        Wall-clock time of the runs, s.
    notes : list of str
        Remarks on the runs: of a method in C, which code ran.

    Notes
    -----
    A sweep can be pickled. Symbols belong to the model in memory and stay
    behind: one that was read back knows parameters, inputs and outputs by name.
    """

    def __init__(self, t: np.ndarray, cases: dict[Any, np.ndarray], outputs: list[tuple[Any, ca.SX]]):
        self.t, self.cases = t, cases
        self._kinds = {key.label: "parameters" if isinstance(key, Parameter) else "inputs" for key in cases}
        self._outputs = [(name if isinstance(name, str) else str(e), e.numel(), e) for name, e in outputs]
        self._rows = sum(size for _, size, _ in self._outputs)
        count = len(next(iter(cases.values())))
        self._values = np.full((count, t.size, self._rows), np.nan)
        self.done = np.zeros(count, bool)
        self.failures: dict[int, str] = {}
        self.seconds = 0.0
        self.notes: list[str] = []

    def __len__(self) -> int:
        return self.done.size

    def __getstate__(self) -> dict[str, Any]:
        cases = {_label(key): values for key, values in self.cases.items()}
        outputs = [(name, size, None) for name, size, _ in self._outputs]
        return self.__dict__ | {"cases": cases, "_outputs": outputs}

    def __copy__(self) -> Sweep:
        new = object.__new__(type(self))
        new.__dict__.update(self.__dict__)
        return new

    def __deepcopy__(self, memo: dict) -> Sweep:
        new = copy(self)
        new.cases = {key: values.copy() for key, values in self.cases.items()}
        new.t, new._values, new.done = self.t.copy(), self._values.copy(), self.done.copy()
        new.failures, new.notes = dict(self.failures), list(self.notes)
        return new

    def take(self, indices: np.ndarray, values: np.ndarray, messages: list[str]) -> None:
        """Enter a batch of finished cases."""
        self._values[indices] = values.reshape(len(indices), self.t.size, self._rows)
        self.done[indices] = True
        self.failures |= {int(k): m for k, m in zip(indices, messages, strict=True) if m}

    def __getitem__(self, key: Any) -> np.ndarray:
        """Values of an output, by its name or by the expression."""
        return self._columns()[output_place([(name, expression) for name, _, expression in self._outputs], key)]

    def _columns(self) -> list[np.ndarray]:
        """Values of each output: (cases, n_t) of a scalar, else (cases, n_t, k)."""
        sizes = [size for _, size, _ in self._outputs]
        parts = np.split(self._values, np.cumsum(sizes)[:-1], axis=2)
        return [part[:, :, 0] if size == 1 else part for part, size in zip(parts, sizes, strict=True)]

    @property
    def names(self) -> list[str]:
        """Names of the outputs."""
        return [name for name, _, _ in self._outputs]

    def case(self, index: int, mechanism: Mechanism | None = None) -> dict[str, dict[Any, float]]:
        """Values of one case as ``simulate(mechanism, …, **swept.case(3))`` takes them.

        A sweep that was pickled knows names only and needs the mechanism: ``swept.case(3, mechanism)``.
        """
        if not isinstance(index, int | np.integer) or not -len(self) <= index < len(self):
            raise ModelError(f"the sweep has {len(self)} cases, and none of index {index}")
        values_by_kind: dict[str, dict[Any, float]] = {"parameters": {}, "inputs": {}}
        for key, values in self.cases.items():
            kind = self._kinds[_label(key)]
            values_by_kind[kind][self._symbol(key, kind, mechanism)] = float(values[index])
        return values_by_kind

    @staticmethod
    def _symbol(key: Any, kind: str, mechanism: Mechanism | None) -> Any:
        if not isinstance(key, str):
            return key
        if mechanism is None:
            raise ModelError("a sweep that was pickled knows names only; give the mechanism: swept.case(3, mechanism)")
        symbols = mechanism.parameters if kind == "parameters" else mechanism.inputs
        named = [symbol for symbol in symbols if symbol.label == key]
        if len(named) != 1:
            raise ModelError(f"the mechanism has {len(named)} {kind} named '{key}', which the sweep varies")
        return named[0]

    def to_xarray(self) -> xarray.Dataset:
        """Return a Dataset over ``case`` and ``t``; the values of the cases are coordinates of ``case``.

        They have the name of the parameter, or ``name.value`` if an output is called so.
        """
        xr = optional_package("xarray", "to_xarray", "data")
        coordinates: dict[str, Any] = {"t": ("t", self.t, {"units": "s"}), "case": np.arange(len(self))}
        taken = {*self.names, "t", "case", "axis", "failure"}
        for key, values in self.cases.items():
            label = _label(key)
            coordinates[f"{label}.value" if label in taken else label] = ("case", values)
        coordinates["failure"] = ("case", [self.failures.get(k, "") for k in range(len(self))])
        variables: dict[str, Any] = {}
        for (name, size, _), values in zip(self._outputs, self._columns(), strict=True):
            last = () if size == 1 else ("axis",) if size == 2 else (f"{name}_0",)
            variables[name] = (("case", "t", *last), values)
            if size == 2:
                coordinates["axis"] = ["x", "y"]
        return xr.Dataset(variables, coords=coordinates)

    def __repr__(self) -> str:
        text = f"Sweep over {', '.join(map(_label, self.cases))}: {len(self)} cases, {self.t.size} times"
        text += f", {int(np.sum(~self.done))} not run" if not np.all(self.done) else ""
        text += f", {len(self.failures)} failed" if self.failures else ""
        shown = [f"  case {k}: {m}" for k, m in list(self.failures.items())[:3]]
        shown += [f"  note: {note}" for note in self.notes]
        return "\n".join([f"{text}, {self.seconds:.3g} s", *shown])

    def _repr_html_(self) -> str:
        """The values of the cases as a table, for notebooks; of many the first and the last."""
        keys, count = list(self.cases), len(self)
        shown = range(count) if count <= SHOWN_CASES else [*range(SHOWN_CASES - 2), -1, count - 1]
        rows = [
            [str(k), *(f"{float(self.cases[key][k]):.6g}" for key in keys), self._outcome(k)]
            if k >= 0
            else ["…"] * (len(keys) + 2)
            for k in shown
        ]
        return html_table(repr(self).splitlines()[0], rows, ["case", *map(_label, keys), ""])

    def _outcome(self, k: int) -> str:
        return self.failures.get(k, "done" if self.done[k] else "not run")


def _label(key: Any) -> str:
    """Name of a parameter or input, which it is itself in a sweep that was pickled."""
    return key if isinstance(key, str) else str(key.label)
