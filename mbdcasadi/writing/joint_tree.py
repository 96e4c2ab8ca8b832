"""A tree of joints that carries all bodies, as files of robots describe it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..files.planar import FreeHinge, FreeSlide
from ..model.bodies import Body, Marker, ground, rotation
from ..model.joints.coordinates import RelativeAngle
from ..model.joints.lower_pairs import PointOnLine, Revolute, Translational, Weld
from ..model.mechanism import Mechanism
from ..results.state import State

#: Joints of a tree, those first that no equation of a loop replaces.
_KINDS = (Weld, Translational, PointOnLine, FreeSlide, Revolute)


@dataclass(eq=False)
class TreeJoint:
    """A hinge or slide with which a body moves relative to the one that carries it.

    Attributes
    ----------
    kind : str
        ``"hinge"`` or ``"slide"``.
    reference : float
        Its coordinate in the pose of the tree, rad or m.
    direction : numpy.ndarray
        Of a slide in the axes of the body (2,); of a hinge its sense (1,), positive counter-clockwise.
    place : numpy.ndarray
        Of a hinge in the body (2,), m.
    """

    name: str
    kind: str
    body: Body
    reference: float
    direction: np.ndarray
    place: np.ndarray = field(default_factory=lambda: np.zeros(2))


class JointTree:
    """The bodies of a mechanism in terms of the coordinates of a tree of joints.

    Slides and welds are in the tree before pins, which remain for loops; a body that no joint of the tree carries is
    free: two slides and a hinge.

    Parameters
    ----------
    mechanism : Mechanism
        It.
    state : State
        Its pose in the file.
    what : str
        Caller, for messages.

    Attributes
    ----------
    bodies : list of Body
        Those that carry others first.
    carrier : dict of Body to Body
        Body that carries each.
    joints : list of TreeJoint
        In the order of their coordinates.
    elements : set
        Joints of the mechanism that are in the tree.
    q, positions : casadi.SX
        Coordinates (n,), and ``x, y, phi`` of all bodies of the mechanism in terms of them.
    """

    def __init__(self, mechanism: Mechanism, state: State, what: str):
        self.mechanism, self.state, self.what = mechanism, state, what
        self.bodies: list[Body] = []
        self.carrier: dict[Body, Body] = {}
        self.joints: list[TreeJoint] = []
        self.elements: set[Any] = set()
        self._symbols: list[ca.SX] = []
        self._poses: dict[Body, tuple[ca.SX, ca.SX]] = {ground: (ca.SX.zeros(2), ca.SX(0))}
        while len(self.bodies) < len(mechanism.bodies):
            joint = min(self._at_border(), key=self._rank, default=None)
            if joint is None:
                body = next(body for body in mechanism.bodies if body not in self._poses)
                self._free(ground, body, [], None)
            else:
                self._attach(joint)
        self.q = ca.vertcat(*self._symbols)
        self.positions = ca.vertcat(*[ca.vertcat(*self._poses[body]) for body in mechanism.bodies])

    def joints_of(self, body: Body) -> list[TreeJoint]:
        """Return the joints with which a body moves."""
        return [joint for joint in self.joints if joint.body is body]

    def local(self, marker: Marker) -> np.ndarray:
        """Place of a marker in its body (2,), m."""
        return np.atleast_1d(self.state[marker.local])

    def _rank(self, joint: Any) -> tuple[int, bool]:
        """Order in which joints are taken: by their kinds, and those first that bring the line of another one."""
        added = joint.b.body if joint.a.body in self._poses else joint.a.body
        brings = any(isinstance(each, PointOnLine) and each.a.body is added for each in self.mechanism.joints)
        return [isinstance(joint, kind) for kind in _KINDS].index(True), not brings

    def _at_border(self) -> Iterator[Any]:
        """Joints between a body of the tree and one that is not in it."""
        for joint in self.mechanism.joints:
            if isinstance(joint, _KINDS) and (joint.a.body in self._poses) != (joint.b.body in self._poses):
                if joint.a.body in self._poses or isinstance(joint, Weld | Translational | Revolute):
                    yield joint

    def _attach(self, joint: Any) -> None:
        forward = joint.a.body in self._poses
        above, below = (joint.a, joint.b) if forward else (joint.b, joint.a)
        if isinstance(joint, FreeSlide):
            between = [each for each in self.mechanism.joints if isinstance(each, FreeSlide | FreeHinge)
                       and {each.a.body, each.b.body} == {above.body, below.body}]  # fmt: skip
            slides = [each for each in between if isinstance(each, FreeSlide) and each.a.body is above.body]
            hinges = [each for each in between if isinstance(each, FreeHinge)]
            self._free(above.body, below.body, slides, hinges[0] if hinges else None)
            return
        self.elements.add(joint)
        angle = self._angle(above.body, below.body)
        point, _ = self._point(above)
        if isinstance(joint, Revolute):
            angle += self._hinge(joint.name, above.body, below, joint, 1 if forward else -1)
        elif not isinstance(joint, Weld):
            guide, sense = joint.a, 1 if forward else -1
            turned = self._rotation(guide.body, angle)
            offset = float(self.state[ca.dot(guide.y_axis, joint.b.position - guide.position)])
            moved = self._slide(joint.name, below.body, joint, sense * guide.x_axis)
            point += sense * turned @ (moved * self._axis(guide) + offset * self._axis(guide, 1))
            if isinstance(joint, PointOnLine):
                turns = [each for each in self.mechanism.joints if isinstance(each, FreeHinge)
                         and {each.a.body, each.b.body} == {above.body, below.body}]  # fmt: skip
                hinge = turns[0] if turns else None
                sense = 1 if hinge is None or hinge.a.body is above.body else -1
                angle += self._hinge(hinge.name if hinge else f"{joint.name} turn", above.body, below, hinge, sense)
        self._add(above.body, below.body, point - rotation(angle) @ self.local(below), angle)

    def _free(self, above: Body, below: Body, slides: list[FreeSlide], hinge: FreeHinge | None) -> None:
        """Add a body with two slides and a hinge."""
        angle = self._angle(above, below)
        if len(slides) == 2:
            marker = slides[0].b
            duals = np.array([slide.dual for slide in slides])
            axes = self.state[slides[0].a.axes]
            axes = np.asarray(axes)
            origins = [slide.displacement for slide in slides]
            directions = axes @ np.linalg.inv(duals)
            point, _ = self._point(Marker(above, self._from(above, marker), ca.SX(0)))
            turned = self._rotation(above, angle) @ (np.asarray(self.state[above.axes]).T @ directions)
            for k, slide in enumerate(slides):
                moved = self._slide(slide.name, below, slide, ca.SX(directions[:, k]))
                point += turned[:, k] * (moved - float(self.state[origins[k]]))
        else:
            marker = Marker(below, ca.SX.zeros(2), ca.SX(0))
            point = ca.SX.zeros(2)
            for k, letter in enumerate("xy"):
                point[k] = self._slide(f"{below.name} {letter}", below, None, ca.SX(np.eye(2)[:, k]),
                                       float(self.state[below.position[k]]))  # fmt: skip
        held = [each for each in self.mechanism.joints if isinstance(each, RelativeAngle) and slides
                and {each.a.body, each.b.body} == {above, below}]  # fmt: skip
        if held and hinge is None:
            self.elements.add(held[0])
        else:
            sense = 1 if hinge is None or hinge.a.body is above else -1
            angle += self._hinge(hinge.name if hinge else f"{below.name} angle", above, marker, hinge, sense)
        self._add(above, below, point - rotation(angle) @ self.local(marker), angle)

    def _from(self, above: Body, marker: Marker) -> ca.SX:
        """Place of a marker of another body in the axes of a body, in the pose of the file (2,), m."""
        return ca.SX(np.asarray(self.state[above.axes.T @ (marker.position - above.position)]))

    def _add(self, above: Body, below: Body, place: ca.SX, angle: ca.SX) -> None:
        self.bodies.append(below)
        self.carrier[below] = above
        self._poses[below] = place, angle

    def _angle(self, above: Body, below: Body) -> ca.SX:
        """Angle of a body that does not turn against the one that carries it."""
        return self._poses[above][1] + float(self.state[below.phi - above.phi])

    def _rotation(self, body: Body, angle: ca.SX) -> ca.SX:
        """Axes of a body of the tree, or of the one that is added, which has an angle."""
        return rotation(self._poses[body][1] if body in self._poses else angle)

    def _axis(self, marker: Marker, which: int = 0) -> np.ndarray:
        """Axis of a marker in its body (2,)."""
        turn = float(self.state[marker.local_angle]) + which * np.pi / 2
        return np.array([np.cos(turn), np.sin(turn)])

    def _point(self, marker: Marker) -> tuple[ca.SX, ca.SX]:
        place, angle = self._poses[marker.body]
        return place + rotation(angle) @ self.local(marker), angle

    def _coordinate(self, joint: TreeJoint) -> ca.SX:
        if any(joint.name == other.name for other in self.joints):
            raise ModelError(f"{self.what}: a joint of the tree would have the name '{joint.name}' of another one")
        self.joints.append(joint)
        self._symbols.append(ca.SX.sym(joint.name))
        return self._symbols[-1]

    def _hinge(self, name: str, above: Body, marker: Marker, element: Any, sense: int) -> ca.SX:
        """Add a hinge; return by how much it turns the body."""
        reference = float(self.state[marker.body.phi - above.phi if element is None else element.angle])
        added = TreeJoint(name, "hinge", marker.body, reference, np.array([float(sense)]), self.local(marker))
        return sense * (self._coordinate(added) - reference)

    def _slide(self, name: str, body: Body, element: Any, direction: ca.SX, reference: float | None = None) -> ca.SX:
        """Add a slide along a direction in the global axes; return its coordinate."""
        if element is not None:
            reference = float(self.state[element.displacement])
        own = np.asarray(self.state[body.axes.T @ direction])
        return self._coordinate(TreeJoint(name, "slide", body, float(reference or 0.0), own))
