"""Actuators of MJCF, each as the general one that it stands for.

The kinds of actuators of a class share their defaults: each kind sets some of the values of one general actuator, and
those that come later start from them.
"""

from __future__ import annotations

from collections.abc import Mapping

from .markup import XmlElement
from .mjcf_format import OTHER_ACTUATORS

_VALUES = {"gaintype": "fixed", "biastype": "none", "dyntype": "none", "gainprm": "1", "biasprm": "0 0 0"}
#: Attributes that only shape a servo, whose force a motor does not have.
_SERVO = ("timeconst", "dampratio", "inheritrange")


def as_general(element: XmlElement, above: Mapping[str, str]) -> dict[str, str]:
    """Return the attributes of an actuator as those of a general one, with defaults that are so already."""
    own = dict(element.attributes)
    for name in ("gainprm", "biasprm"):
        if name in own:  # numbers that are not given stay
            given = own[name].split()
            own[name] = " ".join([*given, *above.get(name, _VALUES[name]).split()[len(given) :]])
    values = {**_VALUES, **above, **{name: text for name, text in own.items() if name not in ("kp", "kv")}}
    bias = values["biasprm"].split()
    gain = values["gainprm"].split()[0]
    if element.tag == "motor":
        linear = {"gainprm": "1", "biastype": "none", "dyntype": "none"}
    elif element.tag == "position":
        gain = own.get("kp", gain)
        linear = {"gainprm": gain, "biastype": "affine"}
        rate = _negative(own["kv"]) if "kv" in own else bias[2]
        linear["biasprm"] = " ".join([bias[0], _negative(gain), rate])
    elif element.tag == "velocity":
        gain = own.get("kv", gain)
        linear = {"gainprm": gain, "biastype": "affine", "biasprm": f"0 0 {_negative(gain)}", "dyntype": "none"}
    elif element.tag in OTHER_ACTUATORS:
        return values | dict.fromkeys(("dyntype", "gaintype", "biastype"), element.tag)
    else:
        return values
    if element.tag in ("motor", "velocity"):
        values = {name: text for name, text in values.items() if name not in _SERVO}
    return values | linear | {"gaintype": "fixed"}


def _negative(text: str) -> str:
    return text[1:] if text.startswith("-") else f"-{text}"


def gains_of(actuator: XmlElement) -> tuple[float, float, float, float]:
    """Factors of the input, of the coordinate and of its rate in the force of a general actuator, and its constant."""
    for attribute, known in (("dyntype", ("none",)), ("gaintype", ("fixed",)), ("biastype", ("none", "affine"))):
        if actuator.get(attribute) not in known:
            raise actuator.refuse(f"has the {attribute} '{actuator.get(attribute)}'; it must be {' or '.join(known)}")
    gain = float(actuator.numbers("gainprm")[0])
    if actuator.get("biastype") == "none":
        return gain, 0.0, 0.0, 0.0
    constant, stiffness, damping = (float(x) for x in actuator.numbers("biasprm")[:3])
    if damping > 0 and stiffness == -gain:
        raise actuator.refuse(
            f"has the damping ratio {damping:g} in biasprm, which is not read; give the damping itself, as kv"
        )
    return gain, stiffness, damping, constant
