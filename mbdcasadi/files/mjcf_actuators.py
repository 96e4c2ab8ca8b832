"""Actuators of MJCF, each as the general one that it stands for.

The kinds of actuators of a class share their defaults, as MuJoCo 4.0 reads them: each kind sets values of one general
actuator. Force and gear then start from what stands there, the gains of a servo only if a servo of its kind or a
general actuator has given them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ..model.symbols import Input
from .markup import XmlElement
from .mjcf_format import OTHER_ACTUATORS

#: Force of an actuator that nothing is said of: its input.
_PLAIN = {
    "gaintype": "fixed", "biastype": "none", "dyntype": "none", "gainprm": "1", "biasprm": "0 0 0", "input": "",
}  # fmt: skip
#: Inputs of servos, and attributes that only shape these.
_INPUTS = {"position": "pos", "velocity": "vel"}
_OF_SERVOS = ("timeconst", "inheritrange")


def as_general(element: XmlElement, above: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of an actuator as those of a general one, with defaults that are so already."""
    unread = ("kp", "kv", "dampratio") if element.tag == "position" else ("kp", "kv")
    own = {name: text for name, text in element.attributes.items() if name not in unread}
    values = _PLAIN | dict(above)
    if element.tag == "general":
        for name in ("gainprm", "biasprm"):
            given = own.get(name, "").split()  # numbers that are not given stay
            own[name] = " ".join([*given, *values[name].split()[len(given) :]])
        return values | {"input": ""} | own
    if values["input"] not in ("", _INPUTS.get(element.tag)):
        values = {name: text for name, text in values.items() if name not in _OF_SERVOS} | _PLAIN
    values |= own
    if element.tag in OTHER_ACTUATORS:
        return values | dict.fromkeys(("dyntype", "gaintype", "biastype", "input"), element.tag)
    if element.tag == "motor":
        return {name: text for name, text in values.items() if name not in _OF_SERVOS} | _PLAIN
    gain = element.get("kp" if element.tag == "position" else "kv", values["gainprm"].split()[0])
    if element.tag == "position":
        if element.has("kv") and element.has("dampratio"):
            raise element.refuse("has both kv and dampratio; give one of them")
        rate = values["biasprm"].split()[2]  # a ratio, if it is positive
        rate = _negative(element.get("kv")) if element.has("kv") else element.get("dampratio", rate)
        bias = f"0 {_negative(gain)} {rate}"
    else:
        bias, values["dyntype"] = f"0 0 {_negative(gain)}", "none"
    force = {"gaintype": "fixed", "biastype": "affine", "gainprm": gain, "biasprm": bias}
    return values | force | {"input": _INPUTS[element.tag]}


def _negative(text: str) -> str:
    return text[1:] if text.startswith("-") else f"-{text}"


def gains_of(actuator: XmlElement, inertia: Callable[[], float]) -> tuple[float, float, float, float]:
    """Factors of the input, of the coordinate and of its rate in the force of a general actuator, and its constant.

    A servo may give a damping ratio ζ: with the inertia m of its coordinate, ``k_v = -2 ζ √(k m)``.
    """
    for attribute, known in (("dyntype", ("none",)), ("gaintype", ("fixed",)), ("biastype", ("none", "affine"))):
        if actuator.get(attribute) not in known:
            raise actuator.refuse(f"has the {attribute} '{actuator.get(attribute)}'; it must be {' or '.join(known)}")
    gain = float(actuator.numbers("gainprm")[0])
    if actuator.get("biastype") == "none":
        return gain, 0.0, 0.0, 0.0
    constant, stiffness, damping = (float(x) for x in actuator.numbers("biasprm")[:3])
    if damping > 0 and stiffness == -gain:
        damping *= -2 * float(np.sqrt(gain * inertia()))
    return gain, stiffness, damping, constant


#: Limits of what has none.
FREE = (-np.inf, np.inf)


@dataclass(eq=False)
class Actuator:
    """An actuator on a joint: ``f = k u + k_x gear x + k_v gear v + k_0``, and ``gear f`` along the coordinate."""

    source: XmlElement
    name: str
    joint: str
    gear: float
    #: k, k_x, k_v, k_0
    gains: tuple[float, float, float, float]
    #: limits of u, and of f
    inputs: tuple[float, float] = FREE
    force: tuple[float, float] = FREE

    def within(self, lower: float, upper: float) -> None:
        """Limit the force further."""
        self.force = max(self.force[0], lower), min(self.force[1], upper)

    def drive(self) -> tuple[Input, tuple[float, float]]:
        """Return the input, and the limits of the force that those of the input do not hold: those of servos."""
        gain, *servo, constant = self.gains
        if any(servo) or gain == 0 or self.force == FREE:
            return Input(self.name, lower=self.inputs[0], upper=self.inputs[1]), self.force
        ends = sorted((limit - constant) / gain for limit in self.force)
        lower, upper = max(self.inputs[0], ends[0]), min(self.inputs[1], ends[1])
        if lower > upper:
            raise self.source.refuse("has ranges of its input and its force that have nothing in common")
        return Input(self.name, lower=lower, upper=upper), FREE
