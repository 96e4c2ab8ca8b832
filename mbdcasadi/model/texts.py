"""Expressions as text in the words of the model: loads of constraints as a user asks for them."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..printing import LIMIT, to_text
from .symbols import role_of, symbols_of


def text_of(expression: Any, limit: int = LIMIT) -> str:
    """Return a scalar expression as text, see :func:`to_text`; reactions and impulses have the names of their elements.

    ``norm(pin.reaction_on(rod).force) <= 40`` in place of the multipliers of the pin, for reactions that have been
    asked for; other multipliers are entries of ``pin.multipliers``.
    """
    expression = ca.SX(expression)
    return to_text(expression, limit, _named_parts(expression) if expression.is_scalar() else {})


def _named_parts(expression: ca.SX) -> dict[int, tuple[float, str]]:
    """Sign and name of operations and symbols by their hashes: a part is the sign times what has the name.

    A sign is lost in a square, so that what an operation changes the sign of has the same name.
    """
    roles = {s.element_hash(): role for s in symbols_of(expression) if (role := role_of(s)) is not None}
    loads = {key: role for key, role in roles.items() if role.kind in ("multiplier", "impulse")}
    names: dict[int, tuple[float, str]] = {}
    negated: dict[int, tuple[float, str]] = {}
    for element in dict.fromkeys(role.owner for role in loads.values()):
        for name, value in getattr(element, "named_loads", ()):
            parts = ca.vertsplit(value)
            for k, part in enumerate(parts):
                text = f"{name}[{k}]" if len(parts) > 1 else name
                if part.is_constant():
                    continue
                names.setdefault(part.element_hash(), (1.0, text))
                if part.n_dep() == 1 and part.op() == ca.OP_NEG:
                    negated.setdefault(part.dep(0).element_hash(), (-1.0, text))
    return {key: (1.0, role.label) for key, role in loads.items()} | negated | names
