"""Curvature of a cost that is not negative: squares by the slopes of what is squared, the rest by its own Hessian."""

from __future__ import annotations

import casadi as ca


def curvature(cost: ca.SX, variables: ca.SX) -> ca.SX:
    """Return a matrix (n, n) for the Hessian of a cost.

    Of a sum ``c e**2 + r`` it is ``2 c e_x^T e_x + r_xx``: the curvature of e, by which it would count as much as e
    is large, is left out, as Gauss and Newton did.
    """
    squares, rest = _squares(cost, variables)
    result = ca.hessian(rest, variables)[0]
    for factor, root in squares:
        slope = ca.jacobian(root, variables)
        result += 2 * factor * (slope.T @ slope)
    return ca.densify(result)


def _squares(cost: ca.SX, variables: ca.SX) -> tuple[list[tuple[ca.SX, ca.SX]], ca.SX]:
    """Squares in a sum with their factors, which do not depend on the variables, and the rest of the sum."""
    squares: list[tuple[ca.SX, ca.SX]] = []
    rest = ca.SX(0)
    terms = [(ca.SX(1), cost)]
    while terms:
        factor, term = terms.pop()
        operands = [term.dep(k) for k in range(term.n_dep())]
        operation = term.op()
        constant = [not ca.depends_on(x, variables) for x in operands]
        if operation in (ca.OP_ADD, ca.OP_SUB):
            terms += [(factor, operands[0]), (factor if operation == ca.OP_ADD else -factor, operands[1])]
        elif operation == ca.OP_NEG:
            terms.append((-factor, operands[0]))
        elif operation == ca.OP_TWICE:
            terms.append((2 * factor, operands[0]))
        elif operation == ca.OP_MUL and any(constant):
            k = constant.index(True)
            terms.append((factor * operands[k], operands[1 - k]))
        elif operation == ca.OP_DIV and constant[1]:
            terms.append((factor / operands[1], operands[0]))
        elif operation == ca.OP_SQ and not (factor.is_constant() and float(factor) < 0):
            squares.append((factor, operands[0]))
        else:
            rest += factor * term
    return squares, rest
