"""Mechanisms with exact dry friction in one mode: each friction sticks, slides one way or the other, or is free."""

from __future__ import annotations

from typing import Any

from ...mechanism import Mechanism

#: Sense in which each friction of a mechanism slides ("forth", "back"), that it "sticks", that it is "free", or in
#: which sense it is pulled at its limit while something else holds it ("pulled forth", "pulled back").
Senses = tuple[str, ...]


def switches(element: Any) -> bool:
    """True for an element that sticks and slides exactly."""
    return getattr(element, "switches_modes", False) is True


def switching(mechanism: Mechanism) -> tuple[Any, ...]:
    """Elements with exact dry friction."""
    if not isinstance(mechanism, Mechanism):  # which is refused by the caller
        return ()
    return mechanism.cache.get_or_create(
        "exact friction", lambda: tuple(element for element in mechanism.elements if switches(element))
    )


def variant_in(mechanism: Mechanism, senses: Senses) -> Mechanism:
    """The mechanism with every exact friction in a mode; made once."""
    frictions = switching(mechanism)

    def make() -> Mechanism:
        place = {f: f.in_mode(one) for f, one in zip(frictions, senses, strict=True)}
        joints, forces = ([place.get(f, f) for f in parts] for parts in (mechanism.joints, mechanism.forces))
        return mechanism.replace(joints=joints, forces=forces)

    return mechanism.cache.get_or_create(("stick and slip", senses), make)


def without_exact_friction(mechanism: Mechanism) -> Mechanism:
    """The mechanism with nothing that sticks or slides; itself if there is no exact friction."""
    frictions = switching(mechanism)
    return variant_in(mechanism, ("free",) * len(frictions)) if frictions else mechanism
