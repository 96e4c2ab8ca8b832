"""Mechanisms with exact dry friction and rigid contacts in one mode: what is open, what sticks, and what slides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...mechanism import Mechanism
from ..active_rows import HeldRows

#: Mode of each such element: the sense in which a friction slides ("forth", "back"), that it "sticks", that it is
#: "free", or in which sense it is pulled at its limit while something else holds it ("pulled forth", "pulled back");
#: of a contact the statuses of its places.
Senses = tuple[Any, ...]


def switches(element: Any) -> bool:
    """True for an element that sticks and slides, or opens and closes, exactly."""
    return getattr(element, "switches_modes", False) is True


def switching(mechanism: Mechanism) -> tuple[Any, ...]:
    """Elements with exact dry friction, and rigid contacts."""
    if not isinstance(mechanism, Mechanism):  # which is refused by the caller
        return ()
    return mechanism.cache.get_or_create(
        "exact friction", lambda: tuple(element for element in mechanism.elements if switches(element))
    )


def modes_by_element(elements: Sequence[Any], senses: Senses) -> dict[Any, Any]:
    """Modes of elements with exact dry friction, from those of all that sticks and slides in them."""
    rest = iter(senses)
    modes = {element: tuple(next(rest) for _ in element.frictions) for element in elements}
    return {element: mode if isinstance(element.free_mode, tuple) else mode[0] for element, mode in modes.items()}


def variant_in(mechanism: Mechanism, senses: Senses) -> Mechanism:
    """The mechanism with every such element in a mode; made once."""
    elements = switching(mechanism)

    def make() -> Mechanism:
        place = {e: e.in_mode(one) for e, one in zip(elements, senses, strict=True)}
        joints, forces = ([place.get(f, f) for f in parts] for parts in (mechanism.joints, mechanism.forces))
        holding = [f for f in forces if f.rows.numel()]  # a force has no rows at the level of positions
        return mechanism.replace(joints=[*joints, *holding], forces=[f for f in forces if f not in holding])

    return mechanism.cache.get_or_create(("modes", senses), make)


def held_at(variant: Mechanism, mechanism: Mechanism, q: ca.SX, v: ca.SX, pose: np.ndarray) -> Mechanism:
    """The mechanism in one mode with what sticks held where it is at a pose, by rows of positions."""
    own = (*mechanism.joints, *mechanism.forces)
    joints, forces = list(variant.joints), list(variant.forces)
    for part in (*variant.joints, *variant.forces):
        if part in own or not part.velocity_rows.numel():
            continue
        held = HeldRows(part, q, v, pose)
        if part in joints:
            joints[joints.index(part)] = held
        else:  # a force has no rows at the level of positions
            forces.remove(part)
            joints.append(held)
    return variant.replace(joints=joints, forces=forces)


def without_exact_friction(mechanism: Mechanism) -> Mechanism:
    """The mechanism in which nothing sticks, slides or touches; itself if it has no such elements."""
    elements = switching(mechanism)
    return variant_in(mechanism, tuple(e.free_mode for e in elements)) if elements else mechanism
