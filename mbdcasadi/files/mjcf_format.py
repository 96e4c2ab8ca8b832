"""Elements of MJCF: those that are read with their attributes, and those that change no equation of motion."""

from __future__ import annotations

from collections.abc import Iterable

from .markup import XmlElement

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_CONSTRAINT = "name class active solref solimp"
_ACTUATOR = "name class group user joint tendon gear ctrllimited ctrlrange forcelimited forcerange lengthrange"
_TENDON = (
    "name class group user limited range stiffness damping springlength frictionloss margin solreflimit solimplimit "
    "solreffriction solimpfriction actuatorfrclimited actuatorfrcrange width material rgba"
)
#: Attributes by element, and by section for those whose names occur in several.
_ATTRIBUTES = {
    "compiler": "angle eulerseq inertiafromgeom autolimits settotalmass coordinate strippath meshdir texturedir "
    "assetdir discardvisual convexhull usethread fusestatic fitaabb alignfree saveinertial conflict exactmeshinertia",
    "option": "gravity density viscosity wind magnetic timestep apirate integrator cone jacobian solver iterations "
    "tolerance ls_iterations ls_tolerance noslip_iterations noslip_tolerance mpr_iterations mpr_tolerance "
    "ccd_iterations ccd_tolerance sdf_iterations sdf_initpoints impratio o_margin o_solref o_solimp o_friction "
    "sleep_tolerance collision",
    "body": f"name childclass mocap user sleep gravcomp {_FRAME}",
    "frame": f"name childclass {_FRAME}",
    "inertial": f"mass diaginertia fullinertia {_FRAME}",
    "joint": "name class type group user pos axis ref damping stiffness springref springdamper armature limited range "
    "frictionloss margin solreflimit solimplimit solreffriction solimpfriction actuatorfrclimited actuatorfrcrange",
    "freejoint": "name group align",
    "geom": f"name class type size fromto mass density contype conaffinity condim group priority friction solmix "
    f"solref solimp margin gap rgba material user mesh hfield fitscale fluidshape fluidcoef {_FRAME}",
    "site": f"name class type group pos size material rgba user mesh {_FRAME}",
    "connect": f"{_CONSTRAINT} body1 body2 anchor site1 site2",
    "weld": f"{_CONSTRAINT} body1 body2 anchor site1 site2 torquescale",
    "equality joint": f"{_CONSTRAINT} joint1 joint2 polycoef",
    "equality tendon": f"{_CONSTRAINT} tendon1 tendon2 polycoef",
    **dict.fromkeys(("fixed", "spatial"), _TENDON),
    "fixed joint": "joint coef",
    "spatial site": "site",
    "spatial geom": "geom sidesite",
    "spatial pulley": "divisor",
    "motor": _ACTUATOR,
    "position": f"{_ACTUATOR} kp kv dampratio",
    "velocity": f"{_ACTUATOR} kv",
    "general": f"{_ACTUATOR} dyntype gaintype biastype dynprm gainprm biasprm input",
}
_READ = {tag: frozenset(names.split()) for tag, names in _ATTRIBUTES.items()}
#: Values with which other attributes change nothing.
_NEUTRAL = {
    "shellinertia": ("false",),
    "balanceinertia": ("false",),
    "boundmass": ("0",),
    "boundinertia": ("0",),
    "actuatorgravcomp": ("false",),
    "timeconst": ("0",),
    "inheritrange": ("0",),
    "actlimited": ("false",),
    "relpose": ("0 1 0 0 0 0 0",),
}
#: Elements for visualisation, sensors or the solver, which change no equation of motion.
IGNORED = ("asset", "visual", "statistic", "size", "sensor", "keyframe", "custom", "extension")
#: Actuators that are read, and others of which defaults may speak.
ACTUATORS = ("motor", "position", "velocity", "general")
OTHER_ACTUATORS = (
    "intvelocity", "orientation", "pid", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "plugin",
)  # fmt: skip
_DEFAULTS = (
    "default", "mesh", "texture", "material", "joint", "geom", "site", "camera", "light", "pair", "equality", "tendon",
    *ACTUATORS, *OTHER_ACTUATORS,
)  # fmt: skip
#: Elements inside others that are read or change nothing; an element that is not listed has none.
_CHILDREN = {
    "mujoco": ("compiler", "option", "default", "worldbody", "equality", "tendon", "actuator", "contact", *IGNORED),
    "default": _DEFAULTS,
    "compiler": ("lengthrange",),
    "option": ("flag",),
    "contact": ("pair", "exclude"),
    "tendon": ("fixed", "spatial"),
    "fixed": ("joint",),
    "spatial": ("site", "geom", "pulley"),
    **dict.fromkeys(
        ("worldbody", "body", "frame"),
        ("body", "frame", "joint", "freejoint", "geom", "site", "inertial", "light", "camera"),
    ),
}
#: What a model that MuJoCo has saved holds in place of these elements and attributes.
_SAVED = (
    "load the model in MuJoCo and read the file that mj_saveLastXML saves, with saveinertial='true' in compiler; "
    "it holds the {} that this leads to"
)
_ADVICE = {
    **dict.fromkeys(("replicate", "attach"), _SAVED.format("bodies and joints")),
    **dict.fromkeys(
        ("boundmass", "boundinertia", "balanceinertia", "inertiagrouprange", "shellinertia"),
        _SAVED.format("masses") + ", so that the attribute can be taken out",
    ),
    "inheritrange": _SAVED.format("range"),
}
MESH_ADVICE = "give the body an inertial, or " + _SAVED.format("masses")
#: What flags turn off, several things by some, and flags that change nothing else.
_PARTS_OF_FLAGS = {"passive": {"spring", "damper"}, "constraint": {"equality", "contact", "limit", "frictionloss"}}
FLAGS = (
    "gravity", "spring", "damper", "contact", "limit", "frictionloss", "equality", "clampctrl", "filterparent",
    *_PARTS_OF_FLAGS,
)  # fmt: skip
_HARMLESS_FLAGS = (
    "warmstart", "refsafe", "sensor", "midphase", "nativeccd", "eulerdamp", "autoreset", "island",
    "multiccd", "override", "energy", "fwdinv", "invdiscrete", "sleep",
)  # fmt: skip


def refuse_unread(element: XmlElement, kind: str | None = None) -> None:
    """Raise for an attribute that may change the motion and is not read, and for an element inside this one."""
    kind = kind or element.tag
    for name, text in element.attributes.items() if kind in _READ else ():
        if name not in _READ[kind] and text not in _NEUTRAL.get(name, ()):
            raise element.refuse(f"has {name} = '{text}', which is not read{_advice(name)}")
    for child in element.children:
        if child.tag not in _CHILDREN.get(kind, ()):
            raise child.refuse(f"is not read in {element.tag}{_advice(child.tag)}")


def _advice(name: str) -> str:
    return f"; {_ADVICE[name]}" if name in _ADVICE else ""


def turned_off(flags: Iterable[XmlElement]) -> set[str]:
    """Return what the flags of options turn off; later ones count."""
    off = set[str]()
    for flag in flags:
        for name in flag.attributes:
            text = flag.word(name, "enable", "disable")
            if name in FLAGS:
                (off.add if text == "disable" else off.discard)(name)
            elif name not in _HARMLESS_FLAGS and text != "enable":
                raise flag.refuse(f"has {name} = '{text}', which is not read")
    return off.union(*(_PARTS_OF_FLAGS[flag] for flag in off & set(_PARTS_OF_FLAGS)))
