"""A sparse nonlinear program made of one function mapped over the intervals and one for the ends.

Derivatives are taken of these two small functions as ``SX``; the nonzeros of
all intervals are gathered into the whole by constant index vectors. Building
stays linear in the number of intervals, and nothing is differentiated twice.

Rows and cost of an interval see its variables through the states at a few
points alone. Derivatives by these states, and the chain rule, take half of the
operations of derivatives by the variables.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np

from ...numerics.graph import operands, operations
from ...numerics.lazy import cached_property
from ...numerics.operations import OPERATIONS

#: Operations that bend or jump as their operands become equal, or the only one passes zero.
BENT = frozenset(op for op, known in OPERATIONS.items() if known.at_border and known.rounded)
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
    #: symbols in rows and cost that stand for states at points of an interval, and these states in the variables
    symbols: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    states: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    def in_variables(self, expressions: list[ca.SX]) -> list[ca.SX]:
        """Return expressions with the states in place of the symbols that stand for them."""
        return list(ca.substitute(expressions, [self.symbols], [self.states]))

    def jacobian(self, expression: ca.SX) -> ca.SX:
        """Jacobian of an expression by the variables."""
        own = ca.jacobian(expression, self.variables)
        return own + ca.jacobian(expression, self.symbols) @ self._slopes

    def hessian(self, expression: ca.SX) -> ca.SX:
        """Upper triangle of the Hessian of an expression by the variables."""
        n = self.variables.numel()
        of_all = ca.hessian(expression, ca.vertcat(self.variables, self.symbols))[0]
        own, mixed, inner = of_all[:n, :n], of_all[:n, n:] @ self._slopes, of_all[n:, n:]
        whole = own + mixed + mixed.T + self._slopes.T @ (inner @ self._slopes)
        # states are linear in the variables but for free times and parameters
        weights = ca.SX.sym("w", self.symbols.numel())
        curved = ca.hessian(ca.dot(weights, self.states), self.variables)[0]
        if curved.nnz():
            whole += ca.substitute(curved, weights, ca.gradient(expression, self.symbols))
        return ca.triu(whole)

    @cached_property
    def used_parameters(self) -> list[int]:
        """Places of the parameters that occur."""
        occur = {x.element_hash() for x in ca.symvar(ca.vertcat(self.rows, self.cost, self.states))}
        return [k for k, x in enumerate(ca.vertsplit(self.parameters)) if x.element_hash() in occur]

    @cached_property
    def _slopes(self) -> ca.SX:
        """Jacobian of the states by the variables."""
        return ca.jacobian(self.states, self.variables)

    @cached_property
    def kinks(self) -> list[tuple[int, ca.SX]]:
        """Operations that bend or jump as the variables change, by kind, operands before the operations on them."""
        bent = list(operations([self.rows, self.cost], BENT))
        if not bent:
            return []
        unknown = ca.vertcat(self.variables, self.symbols)
        squares = [ca.sumsqr(ca.vertcat(*operands(node))) for _, node in bent]  # nothing in them cancels
        depend = ca.which_depends(ca.vertcat(*squares), unknown, 1, True)
        return [kink for kink, moved in zip(bent, depend, strict=True) if moved]

    def without_repetitions(self) -> MappedBlock:
        """Return the same with what occurs several times computed once.

        Up to a sixth of the operations of rows, and of the derivatives that follow from them, are repetitions.
        """
        rows, cost = ca.cse([self.rows, self.cost])
        return replace(self, rows=rows, cost=cost)


class SparseProgram:
    """Cost, rows and derivatives of a program made of pieces, in the order of their rows."""

    def __init__(self, size: int, pieces: list[MappedBlock], parameters: ca.SX):
        self.size = size
        self.pieces, self.parameters = [piece.without_repetitions() for piece in pieces], parameters
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
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.row_count)
        symbols = self._x, self._p, lam_f, lam_g
        hessian = self._hessian(lam_f, lam_g)
        return derivatives_for_ipopt(symbols, self._cost_and_gradient(), self._rows_and_jacobian(), hessian)

    def solver(self, options: dict) -> ca.Function:
        """IPOPT with all derivatives given."""
        nlp = {"x": self._x, "p": self._p, "f": self._cost, "g": self._rows}
        return ca.nlpsol("motion", "ipopt", nlp, self.derivatives | options)

    @cached_property
    def evaluate(self) -> ca.Function:
        """``(x, p) -> (cost, rows)``."""
        return ca.Function("program", [self._x, self._p], [self._cost, self._rows], ["x", "p"], ["f", "g"])

    @cached_property
    def is_kinked(self) -> bool:
        """True if there are operations that bend or jump as the variables change."""
        return any(piece.kinks for piece in self.pieces)

    # --- values and derivatives --------------------------------------------------------------
    def _mapped(
        self, piece: MappedBlock, data: ca.MX, results: list[ca.SX], extra: list[tuple[ca.SX, ca.MX]]
    ) -> list[ca.MX]:
        """Results of a piece for all copies, side by side."""
        copies = piece.index.shape[1]
        used = piece.used_parameters
        arguments = [piece.variables, piece.data, piece.parameters[used], *[symbol for symbol, _ in extra]]
        function = ca.Function("piece", arguments, piece.in_variables(results)).map(copies)
        gathered = _in_shape(self._x[piece.index.T.ravel().tolist()], piece.variables.numel(), copies)
        shared = ca.repmat(self._shared[used], 1, copies)
        return list(function.call([gathered, data, shared, *[value for _, value in extra]]))

    @cached_property
    def _cost(self) -> ca.MX:
        costs = [ca.MX(0)]
        for piece, data in zip(self.pieces, self._data, strict=True):
            if not piece.cost.is_zero():
                costs.append(ca.sum2(self._mapped(piece, data, [piece.cost], [])[0]))
        return sum(costs[2:], costs[1]) if len(costs) > 1 else costs[0]

    @cached_property
    def _rows(self) -> ca.MX:
        rows = [ca.MX(0, 1)]
        for piece, data in zip(self.pieces, self._data, strict=True):
            rows.append(_in_shape(self._mapped(piece, data, [ca.densify(piece.rows)], [])[0]))
        return ca.densify(ca.vertcat(*rows))

    def _cost_and_gradient(self) -> tuple[ca.MX, ca.MX]:
        total, places, values = ca.MX(0), [np.zeros(0, int)], [ca.MX(0, 1)]
        for piece, data in zip(self.pieces, self._data, strict=True):
            if piece.cost.is_zero():
                continue
            slopes = ca.densify(piece.jacobian(piece.cost).T)
            value, gradient = self._mapped(piece, data, [piece.cost, slopes], [])
            total += ca.sum2(value)
            places.append(piece.index.T.ravel())
            values.append(_in_shape(gradient))
        return total, _summed(ca.vertcat(*values), np.concatenate(places), self.size)

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

    def _rows_and_jacobian(self) -> tuple[ca.MX, ca.MX]:
        rows, columns, values, nonzeros, first = [], [], [ca.MX(0, 1)], [ca.MX(0, 1)], 0
        for piece, data in zip(self.pieces, self._data, strict=True):
            jacobian = piece.jacobian(piece.rows)
            local_rows, local_columns = (np.array(x, int) for x in jacobian.sparsity().get_triplet())
            copies, count = piece.index.shape[1], piece.rows.numel()
            block, slopes = self._mapped(piece, data, [ca.densify(piece.rows), ca.vec(jacobian.nz[:])], [])
            rows.append((local_rows[:, None] + first + count * np.arange(copies)[None, :]).T.ravel())
            columns.append(piece.index[local_columns].T.ravel())
            values.append(_in_shape(block))
            nonzeros.append(_in_shape(slopes))
            first += count * copies
        matrix = _matrix(self.row_count, self.size, np.concatenate(rows), np.concatenate(columns), nonzeros)
        return ca.densify(ca.vertcat(*values)), matrix

    def _hessian(self, lam_f: ca.MX, lam_g: ca.MX) -> ca.MX:
        rows, columns, values = [], [], []
        parts = self._lagrangian(lam_f, lam_g)
        for piece, data, (lagrangian, extra) in zip(self.pieces, self._data, parts, strict=True):
            hessian = piece.hessian(lagrangian)
            if not hessian.nnz():
                continue
            local_rows, local_columns = (np.array(x, int) for x in hessian.sparsity().get_triplet())
            (nonzeros,) = self._mapped(piece, data, [ca.vec(hessian.nz[:])], extra)
            one, other = piece.index[local_rows].T.ravel(), piece.index[local_columns].T.ravel()
            rows.append(np.minimum(one, other))
            columns.append(np.maximum(one, other))
            values.append(_in_shape(nonzeros))
        if not values:
            return ca.MX(self.size, self.size)
        return _matrix(self.size, self.size, np.concatenate(rows), np.concatenate(columns), values)


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


def _in_shape(values: ca.MX, rows: int | None = None, columns: int = 1) -> ca.MX:
    """Values in another shape, a column if none is given; ``reshape`` looks at every entry and takes longer."""
    # a function that is zero whatever its arguments returns no entries
    dense = values if values.is_dense() else ca.densify(values)
    return ca.sparsity_cast(dense, ca.Sparsity.dense(values.numel() if rows is None else rows, columns))


def _matrix(rows: int, columns: int, row: np.ndarray, column: np.ndarray, values: list[ca.MX]) -> ca.MX:
    """Sparse matrix of values by row and column; those of one place are added up."""
    place = column * max(rows, 1) + row
    order = np.argsort(place, kind="stable")
    ordered, nonzeros = place[order], ca.vertcat(*values)
    begins = np.r_[True, ordered[1:] != ordered[:-1]][: order.size]
    entries = ordered[begins]
    sparsity = _pattern(rows, columns, entries % max(rows, 1), entries // max(rows, 1))
    if entries.size == order.size:
        return ca.MX(sparsity, nonzeros[order.tolist()])
    # a variable that several copies see, or one copy twice, as the ends of a phase see its times
    entry = np.empty(order.size, int)
    entry[order] = np.cumsum(begins) - 1
    return ca.MX(sparsity, _summed(nonzeros, entry, entries.size))


def _pattern(rows: int, columns: int, row: np.ndarray, column: np.ndarray) -> ca.Sparsity:
    """Sparsity of distinct entries, which stand column by column, and in each from the first row to the last."""
    starts = np.searchsorted(column, np.arange(columns + 1))
    return ca.Sparsity(rows, columns, starts.tolist(), row.tolist())


def _summed(values: ca.MX, places: np.ndarray, size: int) -> ca.MX:
    """Column of a size that has the sums of values by their places."""
    column = ca.MX.sym("column", size)
    # the transpose of a gather is a scatter that adds; a product with a sparse matrix takes far longer to build
    return ca.densify(ca.jtimes(column[places.tolist()], column, values, True))
