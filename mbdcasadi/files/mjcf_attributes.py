"""Attributes of the elements of MJCF: those that are read, and those that change no equation of motion."""

from __future__ import annotations

from .markup import XmlElement

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_CONSTRAINT = "name class active solref solimp"
_ACTUATOR = "name class group user joint gear ctrllimited ctrlrange forcelimited forcerange lengthrange"
_KNOWN = {
    "compiler": "angle eulerseq inertiafromgeom autolimits settotalmass coordinate strippath meshdir texturedir "
    "assetdir discardvisual convexhull usethread fusestatic fitaabb alignfree saveinertial conflict exactmeshinertia",
    "option": "gravity density viscosity wind magnetic timestep apirate integrator cone jacobian solver iterations "
    "tolerance ls_iterations ls_tolerance noslip_iterations noslip_tolerance mpr_iterations mpr_tolerance "
    "ccd_iterations ccd_tolerance sdf_iterations sdf_initpoints impratio o_margin o_solref o_solimp o_friction "
    "sleep_tolerance collision",
    "body": f"name childclass mocap user sleep {_FRAME}",
    "inertial": f"mass diaginertia fullinertia {_FRAME}",
    "joint": "name class type group user pos axis ref damping stiffness springref armature limited range frictionloss "
    "margin solreflimit solimplimit solreffriction solimpfriction actuatorfrclimited actuatorfrcrange",
    "geom": f"name class type size fromto mass density contype conaffinity condim group priority friction solmix "
    f"solref solimp margin gap rgba material user mesh hfield fitscale fluidshape fluidcoef {_FRAME}",
    "connect": f"{_CONSTRAINT} body1 body2 anchor site1 site2",
    "weld": f"{_CONSTRAINT} body1 body2 anchor site1 site2 torquescale",
    "coupling": f"{_CONSTRAINT} joint1 joint2 polycoef",
    "motor": _ACTUATOR,
    "position": f"{_ACTUATOR} kp kv",
    "velocity": f"{_ACTUATOR} kv",
    "general": f"{_ACTUATOR} dyntype gaintype biastype dynprm gainprm biasprm",
}
_READ = {tag: frozenset(names.split()) for tag, names in _KNOWN.items()}
#: Values with which other attributes change nothing.
_NEUTRAL = {
    "gravcomp": ("0",),
    "shellinertia": ("false",),
    "balanceinertia": ("false",),
    "actuatorgravcomp": ("false",),
    "springdamper": ("0 0",),
    "timeconst": ("0",),
    "dampratio": ("0",),
    "inheritrange": ("0",),
    "actlimited": ("false",),
    "relpose": ("0 1 0 0 0 0 0",),
}
#: Attributes whose defaults actuators of all kinds share.
SHARED_BY_ACTUATORS = ("gear", "ctrllimited", "ctrlrange", "forcelimited", "forcerange")
#: Forces that flags turn off, and flags that change no force of a model without contacts and limits.
FLAGS = ("gravity", "spring", "damper", "passive")
_HARMLESS_FLAGS = (
    "contact", "limit", "frictionloss", "clampctrl", "warmstart", "filterparent", "refsafe", "sensor", "midphase",
    "nativeccd", "eulerdamp", "autoreset", "island", "multiccd", "override", "energy", "fwdinv", "invdiscrete", "sleep",
)  # fmt: skip


def refuse_unread(element: XmlElement, kind: str | None = None) -> None:
    """Raise for an attribute that may change the motion and is not read."""
    known = _READ[kind or element.tag]
    for name, text in element.attributes.items():
        if name not in known and text not in _NEUTRAL.get(name, ()):
            raise element.refuse(f"has {name} = '{text}', which is not read")


def turned_off(option: XmlElement) -> set[str]:
    """Return the forces that the flags of an option turn off."""
    names = set()
    for flag in option.all("flag"):
        for name, text in flag.attributes.items():
            if name in FLAGS and text == "disable":
                names.add(name)
            elif name not in (*FLAGS, *_HARMLESS_FLAGS) and text != "enable":
                raise flag.refuse(f"has {name} = '{text}', which is not read")
    return names | ({"spring", "damper"} if "passive" in names else set())
