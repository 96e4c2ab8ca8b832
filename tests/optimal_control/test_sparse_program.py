"""The gathered derivatives of a sparse program equal those of the whole expression."""

import casadi as ca
import numpy as np

from mbdcasadi.optimal_control.nlp.sparse_program import MappedBlock, SparseProgram


def small_program(copies=6):
    """A chain of rows that share variables, a global variable, data, and rows at both ends."""
    w, d, p = ca.SX.sym("w", 3), ca.SX.sym("d", 1), ca.SX.sym("p", 1)
    chain = np.array([np.arange(copies), np.arange(1, copies + 1), np.full(copies, copies + 1)])
    inner = MappedBlock(
        w,
        d,
        p,
        ca.vertcat(w[1] - w[0] - w[2] * ca.sin(w[0]) * d, w[0] * w[1] * w[2]),
        (w[0] - 1) ** 2 * w[2] * p * ca.exp(w[1]),
        chain,
    )
    e = ca.SX.sym("e", 3)
    ends = MappedBlock(
        e,
        ca.SX(0, 1),
        p,
        ca.vertcat(e[0] - 0.3, e[1] * e[2] - 1),
        e[1] ** 2 * e[2],
        np.array([[0], [copies], [copies + 1]]),
    )
    return SparseProgram(copies + 2, [inner, ends], p), copies


def test_derivatives_equal_those_of_the_whole():
    """Gradient, Jacobian and Hessian of the Lagrangian against CasADi's own on the whole program."""
    program, copies = small_program()
    rng = np.random.default_rng(3)
    x, p = rng.uniform(-1, 1, program.size), np.r_[2.0, rng.uniform(0.5, 2, copies)]
    lam = rng.standard_normal(program.row_count)
    symbol = ca.MX.sym("x", program.size)
    cost, rows = program.evaluate(symbol, p)
    whole = ca.Function(
        "whole",
        [symbol],
        [
            ca.gradient(cost, symbol),
            ca.jacobian(rows, symbol),
            ca.triu(ca.hessian(1.7 * cost + ca.dot(lam, rows), symbol)[0]),
        ],
    )(x)
    given = program.derivatives
    gathered = [given["grad_f"](x, p)[1], given["jac_g"](x, p)[1], given["hess_lag"](x, p, 1.7, lam)]
    for mine, theirs in zip(gathered, whole, strict=True):
        assert np.allclose(mine.full(), theirs.full(), atol=1e-13)
