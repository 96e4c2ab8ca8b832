"""Positive parts and magnitudes in running costs, split without kinks by inputs that occur in no force."""

from __future__ import annotations

import casadi as ca

from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import Input
from .placeholders import PARTS, Placeholder, placeholders_in, with_values


def split_parts(
    mechanism: Mechanism, path: tuple[Condition, ...], cost: ca.SX
) -> tuple[Mechanism, tuple[Condition, ...], ca.SX]:
    """Return mechanism, path conditions and running cost with an input for each part of an expression in the cost.

    Parameters
    ----------
    mechanism : Mechanism
        Model of the phase.
    path : tuple of Condition
        Conditions that hold throughout.
    cost : casadi.SX
        Running cost, which may contain :func:`positive_part` and :func:`absolute`.
    """
    inputs: dict[int, Input] = {}
    limits = []
    for part in placeholders_in(cost):
        if part.kind in PARTS and not placeholders_in(part.expression):
            slack = inputs[part.node.element_hash()] = Input(part.label)
            other = 0 if part.kind == "positive_part" else -part.expression
            limits += [slack >= part.expression, slack >= other]
    if not inputs:
        return mechanism, path, cost

    def value(part: Placeholder) -> ca.SX:
        return inputs.get(part.node.element_hash(), part.node)

    extended = mechanism.replace(inputs=[*mechanism.inputs, *inputs.values()])
    return extended, (*path, *read_conditions(limits)), with_values(cost, value)
