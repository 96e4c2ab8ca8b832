"""Cases of a sweep: lists of values, grids, Latin hypercubes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arguments.values import pairs_of, position_in
from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..model.quantities import refuse_twice
from ..model.symbols import Input, Parameter, number
from ..numerics.real import real_array

Symbol = Parameter | Input


def read_cases(mechanism: Mechanism, cases: Any) -> dict[Symbol, np.ndarray]:
    """Values by symbol, each (k,); single numbers hold for all cases."""
    columns: dict[Symbol, np.ndarray] = {}
    for key, values in _pairs(cases, "cases="):
        position_in(mechanism.parameters if isinstance(key, Parameter) else mechanism.inputs, key, "cases=")
        columns[key] = _numbers(key, values, "cases=")
    lengths = {key.label: array.size for key, array in columns.items() if array.ndim == 1}
    if columns and not lengths:
        raise ModelError("cases= holds single numbers only; give a list of values for one of them at least")
    if not lengths or 0 in lengths.values():
        raise ModelError("cases= is empty; give {parameter: values}")
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"'{label}' has {size}" for label, size in lengths.items())
        raise ModelError(
            f"cases=: all lists must be of one length, but {text}; full_factorial gives every combination of values"
        )
    count = next(iter(lengths.values()))
    return {key: np.broadcast_to(array, (count,)).copy() for key, array in columns.items()}


def _pairs(values: Any, what: str) -> list[tuple[Symbol, Any]]:
    """Pairs of a symbol and what belongs to it; no symbol twice."""
    if isinstance(values, Sequence) and all(isinstance(case, Mapping) for case in values):
        raise ModelError(f"{what} takes one {{parameter: values}}, with all values of each in a list, got {values!r}")
    pairs = pairs_of(values, what)
    for key, _ in pairs:
        if not isinstance(key, Parameter | Input):
            raise ModelError(f"{what} takes {{Parameter or Input: values}}, got the key {key!r}")
    refuse_twice([key for key, _ in pairs], what)
    return pairs


def _numbers(key: Symbol, values: Any, what: str) -> np.ndarray:
    """Values of a symbol, a number or a list of them."""
    try:
        array = real_array(values)
    except (TypeError, ValueError):
        raise ModelError(f"{what}: the values of '{key.label}' must be numbers, got {values!r}") from None
    if array.ndim > 1 or not np.all(np.isfinite(array)):
        raise ModelError(f"{what}: the values of '{key.label}' must be a list of finite numbers")
    return array


def full_factorial(values: Any) -> dict[Symbol, np.ndarray]:
    """Every combination of values, the last symbol varying fastest.

    Parameters
    ----------
    values : mapping
        Parameter or input to a list of values.

    Returns
    -------
    dict
        For ``cases=`` of :func:`sweep`.

    Examples
    --------
    >>> k, c = Parameter("k", 1.0), Parameter("c", 0.0)
    >>> full_factorial({k: [1, 2], c: [0, 0.1, 0.2]})[k]
    array([1., 1., 1., 2., 2., 2.])
    """
    pairs = _pairs(values, "full_factorial")
    lists: Sequence[np.ndarray] = [np.atleast_1d(_numbers(key, v, "full_factorial")) for key, v in pairs]
    if not lists or any(column.size == 0 for column in lists):
        raise ModelError("full_factorial: give {parameter: values}, one value at least for each")
    columns = np.meshgrid(*lists, indexing="ij")
    return {key: column.ravel() for (key, _), column in zip(pairs, columns, strict=True)}


def latin_hypercube(ranges: Any, count: int, seed: int | None = None) -> dict[Symbol, np.ndarray]:
    """Points that fill a box evenly, by SciPy's Latin hypercube.

    Parameters
    ----------
    ranges : mapping
        Parameter or input to (lower, upper).
    count : int
        Number of cases.
    seed : int, optional
        The same seed gives the same cases.

    Returns
    -------
    dict
        For ``cases=`` of :func:`sweep`.

    References
    ----------
    McKay, Beckman, Conover, Technometrics 21, 1979.
    """
    from scipy.stats import qmc

    pairs = _pairs(ranges, "latin_hypercube")
    if seed is not None and (not isinstance(seed, int | np.integer) or seed < 0):
        raise ModelError(f"latin_hypercube: seed must be an integer that is not negative, got {seed!r}")
    if not pairs or isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
        raise ModelError(f"latin_hypercube: give {{parameter: (lower, upper)}} and a number of cases, got {count!r}")
    limits = []
    for key, pair in pairs:
        try:
            low, high = pair
        except (TypeError, ValueError):
            raise ModelError(f"latin_hypercube: '{key.label}' needs (lower, upper), got {pair!r}") from None
        limits.append([number(low, "latin_hypercube", "lower"), number(high, "latin_hypercube", "upper")])
        if limits[-1][0] >= limits[-1][1]:
            raise ModelError(f"latin_hypercube: lower of '{key.label}' must be below upper, got {pair!r}")
    sample = qmc.LatinHypercube(d=len(pairs), rng=np.random.default_rng(seed)).random(count)
    box = np.array(limits)
    scaled = qmc.scale(sample, box[:, 0], box[:, 1])
    return {key: scaled[:, k] for k, (key, _) in enumerate(pairs)}


def farthest(values: np.ndarray, count: int) -> np.ndarray:
    """Places of the cases, at most `count`, each as far as can be from those before, by the ranks of their values.

    Parameters
    ----------
    values : numpy.ndarray
        By case (k, n).
    """
    ranks = np.array([np.unique(column, return_inverse=True)[1] for column in values.T], float).reshape(-1, len(values))
    size = np.max(ranks, axis=1, initial=0.0, keepdims=True)
    places = ranks / np.where(size > 0, size, 1.0)
    chosen, distance = [0], np.full(len(values), np.inf)
    while len(chosen) < min(count, len(values)):
        distance = np.minimum(distance, np.sum((places - places[:, chosen[-1:]]) ** 2, axis=0))
        if not np.max(distance) > 0:
            break
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen)
