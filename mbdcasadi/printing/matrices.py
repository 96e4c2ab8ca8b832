"""Matrices of expressions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ..errors import ModelError
from .latex import LatexStyle
from .terms import TextStyle
from .text import LIMIT, write


def _entries(matrix: Any, style: TextStyle, limit: int, function: str) -> list[list[str]]:
    try:
        matrix = ca.SX(matrix)
    except (TypeError, NotImplementedError):
        raise ModelError(f"{function}: takes a matrix in casadi.SX or of numbers, got {matrix!r}") from None
    rows, columns = matrix.shape
    return [[write(matrix[i, j], style, limit) for j in range(columns)] for i in range(rows)]


def _names(names: Sequence[str] | None, count: int, what: str) -> list[str]:
    names = [""] * count if names is None else [str(name) for name in names]
    if len(names) != count:
        raise ModelError(f"matrix_to_text: got {len(names)} {what} names for {count} {what}s")
    return names


def matrix_to_text(
    matrix: Any,
    row_names: Sequence[str] | None = None,
    column_names: Sequence[str] | None = None,
    limit: int = LIMIT,
) -> str:
    """Matrix or vector as plain text, with aligned columns.

    Parameters
    ----------
    matrix : casadi.SX, casadi.DM or numpy.ndarray
        Any shape; a vector is a column.
    row_names, column_names : sequence of str, optional
        Names in front of the rows and above the columns.
    limit : int
        As in :func:`to_text`, for each entry.

    Returns
    -------
    str
        One line a row.

    Raises
    ------
    ModelError
        If it is not a matrix, and for names that do not match its shape.

    Examples
    --------
    >>> print(matrix_to_text(ca.diag(ca.SX.sym("m", 2)), row_names=["x", "y"]))
    x [ m_0    0 ]
    y [   0  m_1 ]
    """
    entries = _entries(matrix, TextStyle(), limit, "matrix_to_text")
    rows, columns = ca.SX(matrix).shape
    row_names, heads = _names(row_names, rows, "row"), _names(column_names, columns, "column")
    widths = [max(map(len, [head, *column])) for head, *column in zip(heads, *entries, strict=True)]
    margin = max(map(len, row_names), default=0)
    margin += margin > 0

    def line(name: str, values: Sequence[str], left: str, right: str) -> str:
        cells = "  ".join(value.rjust(width) for value, width in zip(values, widths, strict=True))
        return f"{name.ljust(margin)}{left} {cells} {right}".rstrip()

    lines = [line("", heads, " ", "")] if any(heads) else []
    lines += [line(name, row, "[", "]") for name, row in zip(row_names, entries, strict=True)]
    return "\n".join(lines)


def matrix_to_latex(matrix: Any, limit: int = LIMIT) -> str:
    """Matrix or vector in LaTeX, as a ``bmatrix`` (package amsmath).

    Parameters
    ----------
    matrix : casadi.SX, casadi.DM or numpy.ndarray
        Any shape; a vector is a column.
    limit : int
        As in :func:`to_text`, for each entry.

    Returns
    -------
    str
        For math mode.

    Raises
    ------
    ModelError
        If it is not a matrix.
    """
    rows = [" & ".join(row) for row in _entries(matrix, LatexStyle(), limit, "matrix_to_latex")]
    return "\\begin{bmatrix}\n" + " \\\\\n".join(rows) + "\n\\end{bmatrix}"
