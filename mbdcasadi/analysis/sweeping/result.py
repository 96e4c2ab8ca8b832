"""What a sweep found."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...errors import MechanismError, ModelError
from ...model.symbols import Parameter
from ..flow.design import same

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
        Which cases were run; all of them, unless the sweep was interrupted.
    seconds : float
        Wall-clock time of the runs, s.
    """

    def __init__(self, t: np.ndarray, cases: dict[Any, np.ndarray], outputs: list[tuple[Any, ca.SX]]):
        self.t, self.cases = t, cases
        self._outputs = outputs
        self._rows = sum(e.numel() for _, e in outputs)
        count = len(next(iter(cases.values())))
        self._values = np.full((count, t.size, self._rows), np.nan)
        self.done = np.zeros(count, bool)
        self.failures: dict[int, str] = {}
        self.seconds = 0.0

    def __len__(self) -> int:
        return self.done.size

    def take(self, indices: np.ndarray, values: np.ndarray, messages: list[str]) -> None:
        """Enter a batch of finished cases."""
        self._values[indices] = values.reshape(len(indices), self.t.size, self._rows)
        self.done[indices] = True
        self.failures |= {int(k): m for k, m in zip(indices, messages, strict=True) if m}

    def __getitem__(self, key: Any) -> np.ndarray:
        """Values of an output, by its name or by the expression."""
        first = 0
        for name, expression in self._outputs:
            size = expression.numel()
            if name == key if isinstance(key, str) else same(expression, ca.SX(key)):
                return self._values[:, :, first] if size == 1 else self._values[:, :, first : first + size]
            first += size
        raise ModelError(f"{key!r} is not among the outputs: {', '.join(map(str, self.names))}")

    @property
    def names(self) -> list[str]:
        """Names of the outputs."""
        return [name if isinstance(name, str) else str(expression) for name, expression in self._outputs]

    def case(self, index: int) -> dict[str, dict[Any, float]]:
        """Values of one case as ``simulate(mechanism, …, **swept.case(3))`` takes them."""
        if not -len(self) <= index < len(self):
            raise ModelError(f"the sweep has {len(self)} cases, and none of index {index}")
        given: dict[str, dict[Any, float]] = {"parameters": {}, "inputs": {}}
        for key, values in self.cases.items():
            given["parameters" if isinstance(key, Parameter) else "inputs"][key] = float(values[index])
        return given

    def to_xarray(self) -> xarray.Dataset:
        """Return a Dataset over ``case`` and ``t``; the values of the cases are coordinates of ``case``.

        They bear the name of the parameter, or ``name.value`` where an output is called so.
        """
        try:
            import xarray as xr
        except ImportError:
            raise MechanismError('to_xarray needs xarray; install it by pip install "mbdcasadi[data]"') from None
        coordinates: dict[str, Any] = {"t": ("t", self.t, {"units": "s"}), "case": np.arange(len(self))}
        taken = {*self.names, "t", "case", "axis", "failure"}
        for key, values in self.cases.items():
            coordinates[f"{key.label}.value" if key.label in taken else key.label] = ("case", values)
        coordinates["failure"] = ("case", [self.failures.get(k, "") for k in range(len(self))])
        variables: dict[str, Any] = {}
        for name, (key, expression) in zip(self.names, self._outputs, strict=True):
            size = expression.numel()
            last = () if size == 1 else ("axis",) if size == 2 else (f"{name}_0",)
            variables[name] = (("case", "t", *last), self[key])
            if size == 2:
                coordinates["axis"] = ["x", "y"]
        return xr.Dataset(variables, coords=coordinates)

    def __repr__(self) -> str:
        text = f"Sweep over {', '.join(key.label for key in self.cases)}: {len(self)} cases, {self.t.size} times"
        text += f", {int(np.sum(~self.done))} not run" if not np.all(self.done) else ""
        text += f", {len(self.failures)} failed" if self.failures else ""
        shown = [f"  case {k}: {m}" for k, m in list(self.failures.items())[:3]]
        return "\n".join([f"{text}, {self.seconds:.3g} s", *shown])
