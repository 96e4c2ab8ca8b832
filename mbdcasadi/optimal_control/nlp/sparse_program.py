"""A sparse nonlinear program made of one function mapped over the intervals and one for the ends.

Derivatives are taken of these two small functions as ``SX``; the nonzeros of
all intervals are gathered into the whole by constant index vectors. Building
stays linear in the number of intervals, and nothing is differentiated twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...numerics.lazy import cached_property

#: An expression of a piece, and further symbols in it with their values for all copies.
Part = tuple[ca.SX, list[tuple[ca.SX, ca.MX]]]


@dataclass(frozen=True)
class MappedBlock:
    """Rows and cost of one kind, in variables gathered from those of the program."""

    #: (n,)
    variables: ca.SX
    #: values that change from copy to copy
    data: ca.SX
    #: values that do not change, shared by all pieces of a program
    parameters: ca.SX
    #: (k,)
    rows: ca.SX
    cost: ca.SX
    #: place of each variable of each copy in the program (n, copies)
    index: np.ndarray


class SparseProgram:
    """Cost, rows and derivatives of a program made of pieces, in the order of their rows."""

    def __init__(self, size: int, pieces: list[MappedBlock], parameters: ca.SX):
        self.size = size
        self.pieces, self.parameters = pieces, parameters
        self._x = ca.MX.sym("x", size)
        data = [p.data.numel() * p.index.shape[1] for p in pieces]
        self._p = ca.MX.sym("p", parameters.numel() + sum(data))
        self._shared = self._p[: parameters.numel()]
        self._data, first = [], parameters.numel()
        for piece, count in zip(pieces, data, strict=True):
            copies = piece.index.shape[1]
            self._data.append(ca.reshape(self._p[first : first + count], piece.data.numel(), copies))
            first += count
        self.data_size = first
        self.row_count = sum(p.rows.numel() * p.index.shape[1] for p in pieces)

    @cached_property
    def derivatives(self) -> dict[str, ca.Function]:
        """Derivatives as IPOPT takes them; all solvers of the program share them."""
        x, p = self._x, self._p
        cost, rows = self._values
        costs: list[Part] = [(piece.cost, []) for piece in self.pieces]
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.row_count)
        gradient, jacobian, hessian = self._gradient(costs), self._jacobian(), self._hessian(lam_f, lam_g)
        return derivatives_for_ipopt((x, p, lam_f, lam_g), (cost, gradient), (rows, jacobian), hessian)

    def solver(self, options: dict) -> ca.Function:
        """IPOPT with all derivatives given."""
        cost, rows = self._values
        return ca.nlpsol(
            "motion", "ipopt", {"x": self._x, "p": self._p, "f": cost, "g": rows}, self.derivatives | options
        )

    @cached_property
    def lagrangian_gradient(self) -> ca.Function:
        """``(x, p, lam_f, lam_g) -> gradient of lam_f cost + lam_g rows``."""
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.row_count)
        gradient = self._gradient(self._lagrangian(lam_f, lam_g))
        return ca.Function("gradient", [self._x, self._p, lam_f, lam_g], [gradient])

    @cached_property
    def evaluate(self) -> ca.Function:
        """``(x, p) -> (cost, rows)``."""
        return ca.Function("program", [self._x, self._p], list(self._values), ["x", "p"], ["f", "g"])

    # --- values and derivatives --------------------------------------------------------------
    def _mapped(
        self, piece: MappedBlock, data: ca.MX, results: list[ca.SX], extra: list[tuple[ca.SX, ca.MX]]
    ) -> list[ca.MX]:
        """Results of a piece for all copies, side by side."""
        copies = piece.index.shape[1]
        arguments = [piece.variables, piece.data, piece.parameters, *[symbol for symbol, _ in extra]]
        function = ca.Function("piece", arguments, results).map(copies)
        gathered = ca.reshape(self._x[piece.index.T.ravel().tolist()], piece.variables.numel(), copies)
        shared = ca.repmat(self._shared, 1, copies)
        return list(function.call([gathered, data, shared, *[value for _, value in extra]]))

    @cached_property
    def _values(self) -> tuple[ca.MX, ca.MX]:
        costs, rows = [], []
        for piece, data in zip(self.pieces, self._data, strict=True):
            cost, block = self._mapped(piece, data, [piece.cost, ca.densify(piece.rows)], [])
            costs.append(ca.sum2(cost))
            rows.append(ca.vec(block))
        return sum(costs[1:], costs[0]), ca.densify(ca.vertcat(*rows))

    def _gradient(self, parts: list[Part]) -> ca.MX:
        """Gradient of the sum of one expression for each piece."""
        places, values = [np.zeros(0, int)], [ca.MX(0, 1)]
        for piece, data, (expression, extra) in zip(self.pieces, self._data, parts, strict=True):
            if expression.is_zero():
                continue
            (gradient,) = self._mapped(piece, data, [ca.densify(ca.gradient(expression, piece.variables))], extra)
            places.append(piece.index.T.ravel())
            values.append(ca.vec(gradient))
        summing = _summing(np.concatenate(places), self.size)
        return ca.densify(ca.mtimes(summing, ca.vertcat(*values)))

    def _lagrangian(self, lam_f: ca.MX, lam_g: ca.MX) -> list[Part]:
        """``lam_f cost + lam_g rows`` of each piece, with the multipliers of its copies."""
        parts, first = [], 0
        for piece in self.pieces:
            copies, count = piece.index.shape[1], piece.rows.numel()
            sigma, lam = ca.SX.sym("sigma"), ca.SX.sym("lam", count)
            block = ca.reshape(lam_g[first : first + count * copies], count, copies)
            extra = [(sigma, ca.repmat(lam_f, 1, copies)), (lam, block)]
            parts.append((sigma * piece.cost + ca.dot(lam, piece.rows), extra))
            first += count * copies
        return parts

    def _jacobian(self) -> ca.MX:
        rows, columns, values, first = [], [], [], 0
        for piece, data in zip(self.pieces, self._data, strict=True):
            jacobian = ca.jacobian(piece.rows, piece.variables)
            local_rows, local_columns = (np.array(x, int) for x in jacobian.sparsity().get_triplet())
            copies, count = piece.index.shape[1], piece.rows.numel()
            (nonzeros,) = self._mapped(piece, data, [ca.vec(jacobian.nz[:])], [])
            rows.append((local_rows[:, None] + first + count * np.arange(copies)[None, :]).T.ravel())
            columns.append(piece.index[local_columns].T.ravel())
            values.append(ca.vec(nonzeros))
            first += count * copies
        row, column, nonzeros = np.concatenate(rows), np.concatenate(columns), ca.vertcat(*values)
        place = column * max(self.row_count, 1) + row
        order = np.argsort(place)
        if np.all(np.diff(place[order])):
            return ca.MX(_pattern(self.row_count, self.size, row[order], column[order]), nonzeros[order.tolist()])
        # a piece that sees a variable twice, as the ends of a phase see its times
        entries, entry = np.unique(place, return_inverse=True)
        sparsity = _pattern(self.row_count, self.size, entries % self.row_count, entries // self.row_count)
        return ca.MX(sparsity, ca.mtimes(_summing(entry, entries.size), nonzeros))

    def _hessian(self, lam_f: ca.MX, lam_g: ca.MX) -> ca.MX:
        rows, columns, values = [], [], []
        parts = self._lagrangian(lam_f, lam_g)
        for piece, data, (lagrangian, extra) in zip(self.pieces, self._data, parts, strict=True):
            hessian = ca.triu(ca.hessian(lagrangian, piece.variables)[0])
            local_rows, local_columns = (np.array(x, int) for x in hessian.sparsity().get_triplet())
            (nonzeros,) = self._mapped(piece, data, [ca.vec(hessian.nz[:])], extra)
            one, other = piece.index[local_rows].T.ravel(), piece.index[local_columns].T.ravel()
            rows.append(np.minimum(one, other))
            columns.append(np.maximum(one, other))
            values.append(ca.vec(nonzeros))
        row, column = np.concatenate(rows), np.concatenate(columns)
        entries, entry = np.unique(column * self.size + row, return_inverse=True)
        sparsity = _pattern(self.size, self.size, entries % self.size, entries // self.size)
        return ca.MX(sparsity, ca.mtimes(_summing(entry, entries.size), ca.vertcat(*values)))


def derivatives_for_ipopt(
    symbols: tuple[ca.MX, ...], cost: tuple[ca.MX, ca.MX], rows: tuple[ca.MX, ca.MX], hessian: ca.MX
) -> dict[str, ca.Function]:
    """Return functions of ``(x, p, lam_f, lam_g)`` as IPOPT takes them.

    `cost` comes with its gradient, `rows` with their Jacobian, `hessian` is the upper triangle of that of the
    Lagrangian.
    """
    names = ["x", "p", "lam_f", "lam_g"]
    return {
        "grad_f": ca.Function("nlp_grad_f", symbols[:2], cost, names[:2], ["f", "grad_f_x"]),
        "jac_g": ca.Function("nlp_jac_g", symbols[:2], rows, names[:2], ["g", "jac_g_x"]),
        "hess_lag": ca.Function("nlp_hess_l", symbols, [hessian], names, ["triu_hess_gamma_x_x"]),
    }


def _pattern(rows: int, columns: int, row: np.ndarray, column: np.ndarray) -> ca.Sparsity:
    """Sparsity of distinct entries, which stand column by column, and in each from the first row to the last."""
    starts = np.searchsorted(column, np.arange(columns + 1))
    return ca.Sparsity(rows, columns, starts.tolist(), row.tolist())


def _summing(places: np.ndarray, size: int) -> ca.DM:
    """Constant sparse matrix that adds up values by their place."""
    return ca.DM(_pattern(size, places.size, places, np.arange(places.size)), np.ones(places.size))
