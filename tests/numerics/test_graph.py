"""Operations in the graphs of expressions."""

import casadi as ca

from mbdcasadi.numerics.graph import count_of_operations, operands, operations


def test_operations_come_after_their_operands_and_lead_to_the_expression():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    expression = ca.if_else(x > 2, ca.sin(y), 0) + ca.floor(x * y)
    known = {x.element_hash(), y.element_hash()}
    node = x
    for _, node in operations(expression):
        parts = [part for part in operands(node) if not part.is_constant()]
        assert parts and all(part.element_hash() in known for part in parts)
        known.add(node.element_hash())
    assert node.element_hash() == expression.element_hash()


def test_only_operations_of_some_kinds_of_several_expressions():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    found = list(operations([ca.sin(x) + 1, ca.vertcat(ca.cos(x), ca.sin(x * y))], (ca.OP_SIN,)))
    assert [(kind, str(node)) for kind, node in found] == [(ca.OP_SIN, "sin(x)"), (ca.OP_SIN, "sin((x*y))")]


def test_symbols_and_constants_are_no_operations():
    assert list(operations(ca.vertcat(ca.SX.sym("x"), 2.0))) == []


def test_shared_operations_count_once():
    wave = ca.sin(ca.SX.sym("x"))
    assert count_of_operations(ca.vertcat(wave + 1, ca.cos(wave))) == 3
