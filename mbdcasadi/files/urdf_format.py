"""Elements of URDF: those that are read with their attributes, and those that change no equation of motion."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from .markup import XmlElement

#: Attributes and elements inside by element, and by its place if it has another meaning there.
_KNOWN = {
    "robot": ("name version", "link joint transmission material gazebo sensor ros2_control mujoco "
              "verification_properties frame drake:collision_filter_group"),
    "link": ("name type", "inertial visual collision verbose self_collision_checking"),
    "inertial": ("", "origin mass inertia"),
    "origin": ("xyz rpy", ""),
    "mass": ("value", ""),
    "inertia": ("ixx iyy izz ixy ixz iyz", ""),
    "joint": ("name type", "origin parent child axis calibration dynamics limit mimic safety_controller"),
    "parent": ("link", ""),
    "child": ("link", ""),
    "axis": ("xyz", ""),
    "dynamics": ("damping friction", ""),
    "limit": ("lower upper effort velocity", ""),
    "mimic": ("joint multiplier offset", ""),
    "transmission": ("name type", "type joint actuator mechanicalReduction"),
    "transmission joint": ("name", "hardwareInterface role offset mechanicalReduction"),
    "transmission actuator": ("name", "hardwareInterface role mechanicalReduction"),
    "gazebo": ("reference", "material sensor visual collision mu mu1 mu2 kp kd fdir1 maxVel minDepth maxContacts "
               "selfCollide self_collide laserRetro provideFeedback preserveFixedJoint disableFixedJointLumping "
               "static"),
}  # fmt: skip
_TABLE = {place: (frozenset(names.split()), frozenset(inside.split())) for place, (names, inside) in _KNOWN.items()}

#: Elements inside the outermost one; others may hold a part of the robot.
KNOWN_PARTS = _TABLE["robot"][1]


def left_out(root: XmlElement) -> list[str]:
    """Return what of a robot is not in the table, each kind once: elements and attributes, a typo among them.

    Elements that are known but not in the table themselves, such as what is only seen, are not looked into.
    """
    first: dict[str, str] = {}
    times: Counter[str] = Counter()
    for element, name, is_attribute in _strange(root):
        kind = f"{'attribute ' if is_attribute else ''}{name} of {element.tag}"
        owner = element.get("name", element.get("reference", ""))
        first.setdefault(kind, f"{kind}{f' {owner!r}' if owner else ''} (line {element.line})")
        times[kind] += 1
    return [words + (f" and {times[kind] - 1} more" if times[kind] > 1 else "") for kind, words in first.items()]


def _strange(root: XmlElement) -> Iterator[tuple[XmlElement, str, bool]]:
    """Attributes and elements that are not in the table, with the element that has them."""
    waiting = [("robot", root)]
    while waiting:
        place, element = waiting.pop()
        names, inside = _TABLE[place]
        for name in element.attributes:
            if name not in names and not name.startswith("xmlns"):
                yield element, name, True
        for child in element.children:
            if child.tag not in inside:
                shown = child.get("name", "")
                yield element, child.tag + (f" {shown!r}" if shown else ""), False
        for child in reversed(element.children):
            deeper = f"{place} {child.tag}" if f"{place} {child.tag}" in _TABLE else child.tag
            if child.tag in inside and deeper in _TABLE:
                waiting.append((deeper, child))
