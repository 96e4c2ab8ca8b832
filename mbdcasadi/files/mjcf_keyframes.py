"""States that the model files of MuJoCo hold (keyframes)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..errors import FileError, ModelError
from ..model.mechanism import Mechanism
from ..model.symbols import Input
from .markup import XmlElement
from .mjcf import robot_of


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A state of a file, for the arguments of analyses.

    Attributes
    ----------
    name : str
        Its name; ``key 1``, … of those without.
    time : float
        s.
    initial : tuple of relations
        Coordinates of all joints and their rates, for ``initial=``.
    inputs : dict of Input to float
        Values of the actuators, for ``inputs=``.
    """

    name: str
    time: float
    initial: tuple[ca.SX, ...]
    inputs: dict[Input, float]


def read_keyframes(path: str | Path, mechanism: Mechanism) -> dict[str, Keyframe]:
    """Read the keyframes of a file of MuJoCo by their names.

    What a keyframe does not give is that of the pose of the file: coordinates at their references, at rest, inputs
    zero.

    Parameters
    ----------
    path : str or Path
        The file.
    mechanism : Mechanism
        What :func:`read_mjcf` made of it; joints and inputs are known by their names.

    Returns
    -------
    dict of str to Keyframe

    Raises
    ------
    FileError
        For a keyframe with other numbers than joints and actuators, one of bodies that a program moves, and a mechanism
        without the joints of the file.

    Examples
    --------
    ::

        robot = mbd.read_mjcf("robot.xml")
        home = mbd.read_keyframes("robot.xml", robot)["home"]
        motion = mbd.simulate(robot, duration=2.0, initial=home.initial, inputs=home.inputs)
    """
    robot = robot_of(path, contacts=False)
    coordinates = [_coordinate(mechanism, joint.name, robot.source) for _, joint in robot.joints]
    labels = [drive.label for drive in robot.inputs]
    known = {drive.label: drive for drive in mechanism.inputs}
    if missing := [label for label in labels if label not in known]:
        raise robot.source.refuse(f"has the actuator '{missing[0]}', of which the mechanism has no input")
    references = np.array([joint.reference for _, joint in robot.joints])
    frames: dict[str, Keyframe] = {}
    for element in (key for keyframe in robot.source.all("keyframe") for key in keyframe.all("key")):
        name = element.get("name", f"key {len(frames) + 1}")
        if name in frames:
            raise element.refuse("has the name of another keyframe")
        for moved in ("mpos", "mquat", "act"):
            if element.has(moved):
                raise element.refuse(f"has {moved}, which is not read: bodies that a program moves, and activations")
        place = _values(element, "qpos", references)
        rate = _values(element, "qvel", 0 * references)
        drives = _values(element, "ctrl", np.zeros(len(labels)))
        pairs = [(q, x) for (q, _), x in zip(coordinates, place, strict=True)]
        pairs += [(v, x) for (_, v), x in zip(coordinates, rate, strict=True)]
        frames[name] = Keyframe(
            name,
            element.number("time", "0"),
            tuple(q == float(x) for q, x in pairs),
            {known[label]: float(x) for label, x in zip(labels, drives, strict=True)},
        )
    return frames


def _coordinate(mechanism: Mechanism, name: str, source: XmlElement) -> tuple[Any, Any]:
    """Coordinate of a joint, and its rate."""
    try:
        joint = mechanism.joint(name)
    except ModelError as error:
        raise FileError(f"{source.file}: {error}; the mechanism is not that of the file") from None
    return (joint.angle, joint.angular_velocity) if hasattr(joint, "angle") else (joint.displacement, joint.speed)


def _values(element: XmlElement, name: str, usual: np.ndarray) -> np.ndarray:
    return element.numbers(name, None, (usual.size,)) if element.has(name) else usual
