"""Mechanisms from the JSON model files of the ME451 course (``.adm``), which are not files of MSC Adams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ..errors import FileError, MechanismError
from ..model.bodies import Body
from ..model.drivers import Driver
from ..model.element import Element
from ..model.forces.field import GRAVITY, Gravity
from ..model.geometry.shapes import Rectangle, Shape
from ..model.mechanism import Mechanism
from .elements import CONSTRAINTS, FORCES, Bodies, Builder, FileForces, Part, circle_on_ground, matlab_name
from .fields import Fields, objects
from .text import JsonObject, read_json


def read_adm(path: str | Path, forces: FileForces | None = None) -> Mechanism:
    """Read a mechanism from a JSON model file of the ME451 course.

    A model file is a JSON object with ``name``, ``gravity`` ``[gx, gy]`` and
    the lists ``bodies`` (``name, id, mass, jbar, q0, qd0``), ``constraints``
    and ``forces`` (``name, type, body1, sP1, …``) and ``contacts``. The files of
    MSC Adams, which have the same ending, are not read. Bodies are referred to by
    ``id``; 0, or no id, is the ground. ``fun`` is arithmetic in ``t``; an
    absolute or relative constraint whose ``fun`` depends on ``t`` becomes a
    :class:`~mbdcasadi.Driver` of the same name. A ``RackPinion`` becomes two
    constraints: the rolling, under its name, and ``… centre distance``. A contact
    (``name, body, sP1, r, kn, cn, kt, ct``) is that of a circle with the ground
    ``y <= 0``: the normal force is ``max(kn δ + cn δ̇, 0)`` with the penetration δ,
    and a spring and damper ``-(kt u + ct v)`` hold the point of contact along the
    ground, without sliding. Errors in the drawing part ``vis`` are ignored.

    Parameters
    ----------
    path : str or Path
        The file.
    forces : dict of str to callable, optional
        Functions in place of the Matlab files that ``PointForceFile`` names (``mfile``), which are never run:
        ``function(t, q, v)`` returns the components (2,), N, in the force's frame, as expressions in time, s, and
        coordinates and velocities of the body (3,), m, rad, s.

    Returns
    -------
    Mechanism
        The poses ``q0`` and velocities ``qd0`` are its estimates.

    Raises
    ------
    FileError
        With the file, the element, the field and its value.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.read_adm("examples/models/slider_crank.adm")
    Mechanism(slider crank: 3 bodies, 6 joints, 3 forces)

    A piston force in ``pistonForce.m``, which pushes against the motion to the right:

    >>> piston = lambda t, q, v: (mbd.if_else(v[0] > 0, -1000.0, 0.0), 0.0)
    >>> engine = mbd.read_adm("engine.adm", forces={"pistonForce": piston})  # doctest: +SKIP
    """
    data = read_json(path)
    file = Path(path).name
    model = Fields(data, file, "")
    name = model.text("name", Path(path).stem)
    _refuse_other_parts(model)
    file_forces = _file_forces(forces, data, file)
    try:
        bodies = _read_bodies(data, file)
        constraints = list(_read_elements(data, file, "constraint", CONSTRAINTS, bodies, file_forces))
        loads = list(_read_elements(data, file, "force", FORCES, bodies, file_forces))
        loads += _read_elements(data, file, "contact", circle_on_ground, bodies, file_forces)
        if any(gravity := model.numbers("gravity", 2, GRAVITY)):
            loads.insert(0, Gravity(gravity, name=_name_of_gravity([*constraints, *loads])))
        return Mechanism(
            bodies=list(bodies.values()),
            joints=[c for c in constraints if not isinstance(c, Driver)],
            drivers=[c for c in constraints if isinstance(c, Driver)],
            forces=loads,
            name=name,
        )
    except FileError:
        raise
    except MechanismError as error:
        raise FileError(f"{file}: {error}") from error


def _refuse_other_parts(model: Fields) -> None:
    known = ("name", "gravity", "bodies", "constraints", "forces", "contacts", "vis", "comment")
    unknown = [key for key in model.data if key not in known]
    if unknown:
        raise model.refuse(f"unknown part {', '.join(map(repr, unknown))}; a model holds {', '.join(known)}")


def _file_forces(forces: FileForces | None, data: JsonObject, file: str) -> FileForces:
    """Return the functions that the user gives for Matlab files, if the model has these."""
    if forces is not None and not isinstance(forces, Mapping):
        raise FileError(f'{file}: forces= takes functions by name, as {{"pistonForce": function}}, got {forces!r}')
    functions = {str(name).removesuffix(".m"): function for name, function in (forces or {}).items()}
    known = [matlab_name(f) for f in _entries(data, file, "forces", "force") if f.get("type", None) == "PointForceFile"]
    if strange := [name for name in functions if name not in known]:
        has = f"; it has {', '.join(known)}" if known else ""
        raise FileError(f"{file}: forces= gives {', '.join(strange)}, and no force of the model is in such a file{has}")
    return functions


def _name_of_gravity(elements: list[Element]) -> str:
    """A name that no other element has."""
    taken = {element.name for element in elements}
    return next(name for k in range(1, 1000) if (name := "gravity" if k == 1 else f"gravity {k}") not in taken)


# --- bodies --------------------------------------------------------------------------
def _read_bodies(data: JsonObject, file: str) -> dict[int, Body]:
    bodies: dict[int, Body] = {}
    for fields in _entries(data, file, "bodies", "body"):
        identity = fields.whole("id")
        if identity == 0:
            raise fields.refuse("id = 0 is the ground; give it another one")
        if identity in bodies:
            raise fields.refuse(f"id = {identity} is already that of body '{bodies[identity].name}'")
        bodies[identity] = Body(
            fields.text("name", f"body {identity}"),
            mass=fields.number("mass", at_least=0.0),
            inertia=fields.number("jbar", at_least=0.0),
            pose=fields.numbers("q0", 3),
            velocity=fields.numbers("qd0", 3, (0.0, 0.0, 0.0)),
            shape=_shape(fields.get("vis", None)),
        )
        fields.done()
    if not bodies:
        raise FileError(f"{file}: the model has no bodies; 'bodies' must be a list with at least one")
    return bodies


def _shape(drawing: Any) -> Shape | None:
    """Valid rectangles of the drawing part, as one outline."""
    shape: Shape | None = None
    shapes = drawing.get("shapes", []) if isinstance(drawing, dict) else []
    for entry in shapes if isinstance(shapes, list) else [shapes]:
        try:
            width, height = map(float, entry["size"])
            x, y = map(float, entry.get("loc", (0, 0)))
            rectangle: Shape = Rectangle(width, height, center=(x, y))
        except (MechanismError, TypeError, KeyError, ValueError, AttributeError, IndexError, OverflowError):
            continue
        shape = rectangle if shape is None else shape + rectangle
    return shape


def _entries(data: JsonObject, file: str, part: str, word: str) -> Iterator[Fields]:
    """Fields of the entries of a list, each called by its name or else by its place."""
    for number, entry in enumerate(objects(data, part, file), 1):
        name = entry.get("name") if isinstance(entry, dict) else None
        yield Fields(entry, file, f"{word} '{name}'" if name else f"{word} number {number}")


def _read_elements(
    data: JsonObject,
    file: str,
    word: str,
    builders: Mapping[str, Builder] | Builder,
    bodies: Bodies,
    file_forces: FileForces,
) -> Iterator[Element]:
    """Read one list of a file: by the types of its entries, or all of one kind."""
    seen: set[str] = set()
    for number, fields in enumerate(_entries(data, file, f"{word}s", word), 1):
        build, kind = (builders, word) if callable(builders) else _builder(fields, builders)
        name = fields.text("name", f"{kind} {number}")
        if name in seen:
            raise fields.refuse("the name occurs twice; each needs another one")
        seen.add(name)
        elements = build(Part(fields, name, bodies, file_forces))
        fields.done()
        yield from elements


def _builder(fields: Fields, builders: Mapping[str, Builder]) -> tuple[Builder, str]:
    kind = fields.text("type")
    if kind not in builders:
        raise fields.refuse(f"the type '{kind}' is not known; known are {', '.join(builders)}")
    return builders[kind], kind
