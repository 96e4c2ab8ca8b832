"""From the graph of an expression to forms; without recursion, however deep it is."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from ..numerics.graph import components_of_norm, operands
from ..numerics.operations import operation_name, traits
from .forms import Forms, Operation, Scaled, Symbol

_TURNED = {"<": ">", "<=": ">=", "==": "==", "!=": "!="}
_POWERS = (ca.OP_POW, ca.OP_CONSTPOW)

#: Nodes at the end of a chain of sums or products, each with its sign or exponent.
_Chain = list[tuple[ca.SX, int]]


#: Sign and name of parts that are written as a sign times a name, by the hash of the element.
Names = Mapping[int, tuple[float, str]]
NO_NAMES: Names = {}


def is_short(expression: ca.SX, limit: int, names: Names = NO_NAMES) -> bool:
    """Return True if the expression, with its shared parts written out, has at most `limit` nodes."""
    stack, count = [expression], 0
    while stack:
        node = stack.pop()
        count += 1
        # nodes that wait count too: the walk ends after `limit` steps, however often parts are shared.
        if count + len(stack) > limit:
            return False
        if node.element_hash() not in names:
            stack.extend(operands(node))
    return True


def forms_of(expression: ca.SX, names: Names = NO_NAMES) -> tuple[Forms, Scaled]:
    """Table of the forms of a scalar expression, and the whole."""
    forms = Forms()
    done: dict[int, Scaled] = {}
    chains: dict[int, _Chain] = {}
    stack = [expression]
    while stack:
        node = stack[-1]
        key = node.element_hash()
        if key in done:
            stack.pop()
            continue
        if key in names:
            sign, name = names[key]
            done[key] = sign, forms.of(Symbol(name, 0))[1]
            continue
        if key not in chains:
            chains[key] = _chain(node, names)
        missing = [part for part, _ in chains[key] if part.element_hash() not in done]
        if missing:
            stack.extend(reversed(missing))
        else:
            parts = [(done[part.element_hash()], n) for part, n in chains[key]]
            done[key] = _form(node, parts, forms)
    return forms, done[expression.element_hash()]


def _kind(node: ca.SX) -> str:
    """Return the kind of a node: ``sum``, ``product``, ``choice``, ``norm``, or ``other``."""
    if node.n_dep() == 0:
        return "other"
    op = node.op()
    if components_of_norm(node) is not None:
        return "norm"
    if op == ca.OP_IF_ELSE_ZERO or (op == ca.OP_ADD and _branches(node)):
        return "choice"
    if op in _POWERS:
        return "product" if _whole(node.dep(1)) else "other"
    known = traits(op)
    return "sum" if known.summands else "product" if known.factors else "other"


def _chain(node: ca.SX, names: Names) -> _Chain:
    """Nodes from which the form of a node is made: summands, factors, branches or arguments."""
    kind = _kind(node)
    if kind == "choice":
        return [(part, 1) for part in _branches(node) or _zero_branch(node)]
    if kind == "norm":
        return [(part, 1) for part in components_of_norm(node) or ()]
    if kind == "other":
        return [(part, 1) for part in operands(node)]
    chain, stack = [], [(node, 1)]
    while stack:
        part, n = stack.pop()
        inner = _kind(part)
        if kind == "product" and inner == "sum" and part.op() == ca.OP_NEG:
            chain.append((ca.SX(-1), n))
            stack.append((part.dep(0), n))
        elif inner != kind or part.element_hash() in names or (part is not node and _closes(part, n)):
            chain.append((part, n))
        else:
            stack.extend(reversed(_summands(part, n) if kind == "sum" else _factors(part, n)))
    return chain


def _closes(part: ca.SX, exponent: int) -> bool:
    """Return True if a quotient stays together, as one that is raised to a power."""
    return abs(exponent) != 1 and part.op() in (ca.OP_DIV, ca.OP_INV)


def _summands(node: ca.SX, sign: int) -> _Chain:
    return [(part, sign * factor) for part, factor in zip(operands(node), traits(node.op()).summands, strict=True)]


def _factors(node: ca.SX, exponent: int) -> _Chain:
    op = node.op()
    if op in _POWERS:
        return [(node.dep(0), exponent * int(float(node.dep(1))))]
    if op == ca.OP_TWICE:
        return [(ca.SX(2), exponent), (node.dep(0), exponent)]
    return [(part, exponent * power) for part, power in zip(operands(node), traits(op).factors, strict=False)]


def _whole(exponent: ca.SX) -> bool:
    """Return True if an exponent is a whole number other than zero."""
    return exponent.is_constant() and float(exponent).is_integer() and float(exponent) != 0


def _branches(node: ca.SX) -> list[ca.SX] | None:
    """Condition and branches of ``if_else``, which CasADi writes as ``(c ? x : 0) + (!c ? y : 0)``."""
    if node.op() != ca.OP_ADD:
        return None
    a, b = operands(node)
    for first, second in ((a, b), (b, a)):
        if first.n_dep() == second.n_dep() == 2 and first.op() == second.op() == ca.OP_IF_ELSE_ZERO:
            opposite = second.dep(0)
            if opposite.n_dep() == 1 and opposite.op() == ca.OP_NOT:
                if opposite.dep(0).element_hash() == first.dep(0).element_hash():
                    return [first.dep(0), first.dep(1), second.dep(1)]
    return None


def _zero_branch(node: ca.SX) -> list[ca.SX]:
    """Condition and branches, one of which is zero."""
    condition, value = operands(node)
    if condition.n_dep() == 1 and condition.op() == ca.OP_NOT:
        return [condition.dep(0), ca.SX(0.0), value]
    return [condition, value, ca.SX(0.0)]


def _whole_vector(components: tuple[Scaled, ...], forms: Forms) -> tuple[Scaled, ...]:
    """The vector in place of its components, whatever their signs, if these have names and are all of it."""
    symbols = [forms.table[place] for value, place in components if abs(value) == 1]
    texts = [form.name for form in symbols if isinstance(form, Symbol)]
    vector = texts[0].removesuffix("[0]") if texts else ""
    if texts != [f"{vector}[{k}]" for k in range(len(components))]:
        return components
    return (forms.of(Symbol(vector, 0)),)


def _form(node: ca.SX, parts: list[tuple[Scaled, int]], forms: Forms) -> Scaled:
    """Form of a node from those of its chain."""
    if node.is_constant():
        return forms.number(float(node))
    if node.is_symbolic():
        return forms.of(Symbol(node.name(), node.element_hash()))
    kind, op = _kind(node), node.op()
    if kind == "sum":
        return forms.sum((sign * value, place) for (value, place), sign in parts)
    if kind == "product":
        return forms.product(parts)
    arguments = tuple(scaled for scaled, _ in parts)
    if kind == "choice":
        return forms.of(Operation("choice", "if_else", arguments))
    if kind == "norm":
        return forms.of(Operation("call", "norm", _whole_vector(arguments, forms)))
    form, name = traits(op).form
    if form == "comparison" and node.dep(0).is_constant():
        # CasADi turns x > 0 into 0 < x: what varies is better read on the left.
        name, arguments = _TURNED[name], arguments[::-1]
    if form != "call":
        return forms.of(Operation(form, name, arguments))
    if op == ca.OP_PRINTME and node.dep(1).is_symbolic():
        # an expression with a mark, such as at_end(x): see optimal_control/placeholders.py
        return forms.of(Operation("call", node.dep(1).name(), arguments[:1]))
    if node.is_call():
        return forms.of(Operation("call", node.which_function().name(), arguments, node.element_hash()))
    if node.is_output():
        return forms.of(Operation("call", f"output_{node.which_output()}", arguments, node.element_hash()))
    return forms.of(Operation("call", operation_name(op), arguments))
