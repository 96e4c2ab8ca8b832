"""Worlds and models of SDF with what they hold, in other files too."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from .drake import CONNECTIONS
from .markup import XmlElement, read_xml, unread
from .sdf_format import BESIDES, TABLE
from .sdf_frames import Frame, Frames, add_joint_frame, flatten, is_true, pose_of, reference_of

#: Version before which axes are given in the frame of the model.
_AXES_OF_JOINTS = (1, 5)


@dataclass(eq=False)
class Scope:
    """A model, or the world, with its full name."""

    element: XmlElement
    name: str
    #: its file, and those that include it
    files: tuple[Path, ...]
    #: True if axes are given in its frame
    has_axes: bool
    is_static: bool = False
    #: True if links in it may touch each other
    collides: bool = True


def read_file(path: Path) -> XmlElement:
    """Read a file, with values as attributes."""
    root = read_xml(path, "sdf")
    flatten(root)
    return root


def _has_axes(root: XmlElement) -> bool:
    """Return True if the version of a file is one of those in which models have the axes of joints."""
    try:
        return tuple(int(part) for part in root.get("version", "1.7").split(".")[:2]) < _AXES_OF_JOINTS
    except ValueError:
        raise root.refuse(f"has version = '{root.get('version')}', which is none") from None


class Models:
    """Links, joints and frames of a file by their full names, each with the model that holds it.

    Parameters
    ----------
    root : XmlElement
        The file.
    path : Path
        Its path.
    """

    def __init__(self, root: XmlElement, path: Path):
        self.frames = Frames()
        self.links: dict[str, tuple[XmlElement, Scope]] = {}
        self.joints: dict[str, tuple[XmlElement, Scope]] = {}
        #: what Drake puts between points
        self.points: list[tuple[XmlElement, Scope]] = []
        self.left_out = unread(root, TABLE)
        waiting = [Scope(root.one("world") or root, "", (path.resolve(),), _has_axes(root))]
        while waiting:
            waiting += self._read(waiting.pop(0))

    def _read(self, scope: Scope) -> list[Scope]:
        """Read what a model or the world holds; return the models in it."""
        inner = []
        known = {*TABLE[scope.element.tag][1], *BESIDES}
        for child in sorted(scope.element.children, key=lambda child: child.tag in ("joint", "drake:joint")):
            if child.tag in BESIDES:
                continue
            if child.tag == "include":
                inner.append(self._included(child, scope))
            elif child.tag == "model":
                inner.append(self._model(child, scope, scope.files, scope.has_axes))
            elif child.tag == "link":
                key = Frames.full(child.get("name"), scope.name)
                self._add_frame(child, scope, key)
                self.links[key] = child, scope
                if is_true(child, "kinematic"):
                    self.left_out.append(f"the motion of link '{key}' by a program (kinematic)")
            elif child.tag == "frame":
                attached = child.get("attached_to", "")
                self._add_frame(child, scope, Frames.full(attached, scope.name) if attached else scope.name)
            elif child.tag in ("joint", "drake:joint"):
                self.joints[add_joint_frame(self.frames, child, scope.name)] = child, scope
            elif child.tag in CONNECTIONS:
                self.points.append((child, scope))
            elif child.tag.startswith("drake:") or (":" not in child.tag and child.tag not in known):
                raise child.refuse("is not read; leave it out, if the motion does not depend on it")
        return inner

    def _add_frame(self, element: XmlElement, scope: Scope, moves_with: str) -> None:
        """Add the frame of a link or a frame."""
        relative = reference_of(element, "pose", "relative_to") or element.get("attached_to", "")
        base = Frames.full(relative, scope.name) if relative else scope.name
        self.frames.add(
            Frames.full(element.get("name"), scope.name), Frame(element, base, *pose_of(element), moves_with)
        )

    def _model(self, element: XmlElement, scope: Scope, files: tuple[Path, ...], has_axes: bool) -> Scope:
        """Add the frame of a model, which moves with its canonical link, or its first one."""
        name = Frames.full(element.get("name"), scope.name)
        first = next((child.get("name") for tag in ("link", "model") for child in element.all(tag)), "")
        main = element.get("canonical_link", first)
        placed = element.get("placement_frame", "")
        base = reference_of(element, "pose", "relative_to")
        frame = Frame(
            element,
            Frames.full(base, scope.name) if base else scope.name,
            *pose_of(element),
            Frames.full(main, name) if main else "",
            Frames.full(placed, name) if placed else "",
        )
        self.frames.add(name, frame)
        is_static = scope.is_static or is_true(element, "static")
        collides = is_true(element, "self_collide", str(scope.collides and scope.name != ""))
        return Scope(element, name, files, has_axes, is_static, collides)

    def _included(self, include: XmlElement, scope: Scope) -> Scope:
        """Read the model of another file, with the name and the place that it is given."""
        if is_true(include, "merge"):
            raise include.refuse("is to be merged, which is not read; leave 'merge' out, and name what is in it")
        path = _found(include, scope.files[0].parent)
        if path.resolve() in scope.files:
            raise include.refuse(f"includes {path.name}, which includes it")
        root = read_file(path)
        models = list(root.all("model"))
        if len(models) != 1:
            raise include.refuse(f"includes {path.name}, which must hold one model and holds {len(models)}")
        self.left_out += [f"{each} in {path.name}" for each in unread(root, TABLE)]
        model = models[0]
        own = {key: include.attributes[key] for key in ("name", "static", "placement_frame") if include.has(key)}
        if include.has("pose"):
            own["pose"] = include.get("pose")
            model.children = [child for child in model.children if child.tag != "pose"] + list(include.all("pose"))
        model.attributes |= own
        return self._model(model, scope, (path.resolve(), *scope.files), _has_axes(root))


def _found(include: XmlElement, folder: Path) -> Path:
    """File that an element includes; of a folder, the newest model in it."""
    uri = include.get("uri").strip()
    kind, _, name = uri.rpartition("://")
    if kind not in ("", "file", "model", "package"):
        raise include.refuse(f"names '{uri}'; load the model, and give its path")
    for place in (folder, *folder.resolve().parents) if kind in ("model", "package") else (folder,):
        path = place / name
        if path.is_dir():
            path = max(path.glob("*.sdf"), default=path / "model.sdf")
        if path.is_file():
            return path
    raise include.refuse(f"names '{uri}', which is not there; give its path from {folder}")
