"""Closed loops of constraints: without them constraints are regular in every pose, and a mechanism has one branch."""

from __future__ import annotations

from .derivation import Equations


def has_loops(eom: Equations) -> bool:
    """True if constraints close loops: only then they can become dependent in particular poses.

    A tree of pins, slides and welds is regular in every pose.
    """
    return eom.mechanism.cache.get_or_create("has loops", lambda: _closes_loops(eom))


def _closes_loops(eom: Equations) -> bool:
    parent: dict[int, int] = {}

    def root(key: int) -> int:
        while parent.setdefault(key, key) != key:
            key = parent[key]
        return key

    for element in eom.mechanism.constraints:
        if getattr(element, "is_lower_pair", False) and len(element.bodies) == 2:
            a, b = (root(id(body)) for body in element.bodies)
            if a == b:
                return True
            parent[a] = b
        else:
            return True
    return False
