"""Robots in space whose motion is planar, as planar mechanisms.

The formats of robots describe bodies in space. If all hinges are parallel, and all slides lie in the plane across
them, the bodies move in parallel planes; the data of a body that matter are then its mass, its centre of mass in the
plane, and its moment of inertia about the normal.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..errors import FileError, MechanismError, warn
from ..model.bodies import Body, Marker, ground
from ..model.element import Element, at_poses
from ..model.forces.applied import Force
from ..model.forces.field import Gravity
from ..model.forces.friction.joint_friction import LoadIndependentFriction
from ..model.forces.laws import HuntCrossley
from ..model.forces.stops import EndStop
from ..model.joints.base import AlongLine, Joint
from ..model.joints.constraints import Constraint
from ..model.joints.coordinates import RelativeAngle
from ..model.joints.lower_pairs import PointOnLine, Revolute, Translational, Weld
from ..model.mechanism import Mechanism
from ..model.rates import time_derivative
from ..model.symbols import symbols_of, values_of
from ..numerics.lazy import cached_property
from .robot_contacts import RobotContacts, Yielding
from .robots import Coordinate, CoordinateForce, CoordinateStop, Link, Loop, Robot, SpatialJoint, Tendon
from .tendons import strand_length

#: Angle by which axes that are meant to be parallel may differ, rad: files give angles to a few digits.
PARALLEL = 1e-3


class Plane:
    """The plane of a motion of a robot with at least one joint.

    A hinge that is not parallel to others, and a slide across the plane, are refused by name and line.
    """

    def __init__(self, robot: Robot):
        moving = robot.joints
        hinges = [(joint, link.rotation @ joint.axis) for link, joint in moving if joint.kind == "hinge"]
        slides = [(joint, link.rotation @ joint.axis) for link, joint in moving if joint.kind == "slide"]
        if not moving:
            raise robot.source.refuse("has no joint that moves")
        normal = self.normal_of([axis for _, axis in hinges], [axis for _, axis in slides], robot)
        for joint, axis in hinges:
            if np.linalg.norm(np.cross(axis, normal)) > PARALLEL:
                raise joint.source.refuse(
                    f"turns about the axis {_triple(axis)}, and '{hinges[0][0].name}' about {_triple(normal)}: the "
                    "motion is not planar; hinges must be parallel"
                )
        for joint, axis in slides:
            if abs(axis @ normal) > PARALLEL:
                raise joint.source.refuse(
                    f"slides along {_triple(axis)}, out of the plane across {_triple(normal)}: the motion is not planar"
                )
        down = robot.gravity - (robot.gravity @ normal) * normal
        size = float(np.linalg.norm(down))
        up = -down / size if size > PARALLEL * float(np.linalg.norm(robot.gravity)) else _across(normal)
        up = _along_axis(up, normal)
        across = np.cross(up, normal)
        # to the right is where the axes of the world point
        if across[np.argmax(np.abs(across))] < 0:
            normal, across = -normal, -across
        #: horizontal and vertical axis of the plane, and its normal, by row (3, 3)
        self.axes = np.array([across, up, normal])

    @staticmethod
    def normal_of(hinges: Sequence[np.ndarray], slides: Sequence[np.ndarray], robot: Robot) -> np.ndarray:
        """Return the normal: that of the hinges, else across two of the slides, gravity, and the axes of the world."""
        if len(hinges) > 0:
            return hinges[0]
        directions = [*slides, *([robot.gravity] if np.any(robot.gravity) else []), *np.eye(3)]
        for second in directions[1:]:
            across = np.cross(directions[0], second)
            if np.linalg.norm(across) > PARALLEL * max(float(np.linalg.norm(second)), 1e-12):
                normal: np.ndarray = across / np.linalg.norm(across)
                return normal
        raise robot.source.refuse("has no plane")

    @property
    def normal(self) -> np.ndarray:
        """Normal (3,)."""
        return self.axes[2]

    def place(self, point: np.ndarray) -> np.ndarray:
        """Point in the plane (2,)."""
        return self.axes[:2] @ point


def _across(normal: np.ndarray) -> np.ndarray:
    """A direction across a normal: that of the axis of the world that is most nearly so."""
    axis = np.eye(3)[np.argmin(np.abs(normal[::-1]))][::-1]
    projected = axis - (axis @ normal) * normal
    return projected / np.linalg.norm(projected)


def _along_axis(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The axis of the world in the plane along which a direction nearly points, or the direction."""
    place = np.argmax(np.abs(direction))
    axis = np.sign(direction[place]) * np.eye(3)[place]
    axis = axis - (axis @ normal) * normal
    axis /= np.linalg.norm(axis)
    return axis if np.linalg.norm(axis - direction) < PARALLEL else direction


def _triple(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value + 0.0:.4g}" for value in np.round(values, 6)) + ")"


class FreeSlide(AlongLine, Joint):
    """Slide of a body that another joint of the file moves as well; it constrains nothing and has a coordinate.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Origin of the path, and the point that moves.
    dual : numpy.ndarray
        Vector in the axes of a (2,), whose product with a place is the displacement.
    """

    def __init__(self, name: str, a: Marker, b: Marker, dual: np.ndarray):
        self.dual = tuple(float(x) for x in dual)
        super().__init__(name, a, b, ca.SX(0, 1))

    @cached_property
    def displacement(self) -> ca.SX:
        """Displacement, m."""
        return ca.dot(ca.DM(self.dual), self.a.axes.T @ (self.b.position - self.a.position))


class FreeHinge(Joint):
    """Hinge of a body that slides as well; it constrains nothing and has an angle."""

    def __init__(self, name: str, a: Marker, b: Marker):
        super().__init__(name, a, b, ca.SX(0, 1))

    @cached_property
    def angle(self) -> ca.SX:
        """Angle of b relative to a, rad; whole turns count."""
        return self.b.angle - self.a.angle

    @cached_property
    def angular_velocity(self) -> ca.SX:
        """Rate of :attr:`angle`, rad/s."""
        return time_derivative(self.angle)


class PlanarBuilder:
    """Bodies, joints and forces of a robot, in its plane."""

    def __init__(self, robot: Robot):
        self.robot, self.plane = robot, Plane(robot)
        #: links by the ones that they move with: themselves, or those they are fixed to
        self.moving: dict[Link, Link] = {}
        self.fixed: dict[Link, list[Link]] = {}
        for link in robot.links:
            self.moving[link] = link if link.joints or link.parent is None else self.moving[link.parent]
            self.fixed.setdefault(self.moving[link], []).append(link)
        down = self.plane.axes[:2] @ robot.gravity
        self._down = np.where(np.abs(down) > 1e-12, np.round(down, 12), 0.0)
        mass = sum(part.mass for link in robot.links if self.moving[link].parent for part in link.masses)
        self.laws = Yielding(mass, float(np.hypot(*self._down)))
        self.bodies: dict[Link, Body] = {}
        self.rotors: list[Body] = []
        self.joints: list[Element] = []
        self.forces: list[Element] = []
        self.coordinates: dict[str, Coordinate] = {}
        self._names: set[str] = set()

    def mechanism(self) -> Mechanism:
        """Return the mechanism; parts that are not planar or have no mass are refused by name and line."""
        robot = self.robot
        for link in robot.links:
            if link.joints:
                self.bodies[link] = self._body(link)
        for link in robot.links:
            if link.parent is not None and link.joints:
                self._connect(link.parent, link, link.joints)
        for loop in robot.loops:
            self._close(loop)
        for tendon in robot.tendons:
            self._pull(tendon)
        for link in robot.links:
            self._carry(link)
        weight = [Gravity(tuple(float(x) for x in self._down))] if np.any(self._down) else []
        contacts = RobotContacts(robot, self.plane.axes, self.moving, self._at, self.laws).elements()
        if robot.left_out:
            warn(f"{robot.source.file}: left out {'; '.join(robot.left_out)}")
        try:
            for laws, elements in ((robot.constraints, self.joints), (robot.forces, self.forces)):
                for names, law in laws:
                    element = law([self.coordinates[name] for name in names])
                    if element is not None:
                        elements.append(element)
            return Mechanism(
                bodies=[*self.bodies.values(), *self.rotors],
                joints=self.joints,
                forces=[*weight, *self.forces, *contacts],
                inputs=robot.inputs,
                name=robot.name,
            )
        except MechanismError as error:
            raise FileError(f"{robot.source.file}: {error}") from None

    # --- bodies ---------------------------------------------------------------------------
    def _body(self, link: Link) -> Body:
        parts = [(other, mass) for other in self.fixed[link] for mass in other.masses]
        total = sum(part.mass for _, part in parts)
        origin = self.plane.place(link.position)
        if not parts or total <= 0:
            if total < 0:
                raise link.source.refuse(f"has the mass {total:g}, which must not be negative")
            return Body(link.name, mass=0.0, inertia=0.0, pose=(*map(float, origin), 0.0))
        normal = self.plane.normal
        places = [self.plane.place(other.position + other.rotation @ part.center) for other, part in parts]
        center = np.sum([part.mass * place for (_, part), place in zip(parts, places, strict=True)], axis=0) / total
        inertia = 0.0
        for (other, part), place in zip(parts, places, strict=True):
            axis = other.rotation.T @ normal
            inertia += float(axis @ part.inertia @ axis) + part.mass * float(np.sum((place - center) ** 2))
        try:
            return Body(link.name, mass=float(total), inertia=inertia, pose=(float(center[0]), float(center[1]), 0.0))
        except MechanismError as error:
            raise link.source.refuse(f"is not a valid body: {error}") from None

    def _at(self, link: Link, point: np.ndarray, angle: float = 0.0) -> Marker:
        """Marker of the body of a link at a point of the world, in the pose of the file."""
        place = self.plane.place(point)
        body = self.bodies.get(self.moving[link], ground)
        center = np.zeros(2) if body.is_ground else np.array(body.pose_estimate[:2])
        return body.at(float(place[0] - center[0]), float(place[1] - center[1]), angle)

    # --- joints ----------------------------------------------------------------------------
    def _connect(self, parent: Link, link: Link, joints: Sequence[SpatialJoint]) -> None:
        """Joints between two links, by what moves between them, with the coordinates of the file."""
        hinges = [joint for joint in joints if joint.kind == "hinge"]
        slides = [joint for joint in joints if joint.kind == "slide"]
        if len(hinges) > 1 or len(slides) > 2:
            extra = (hinges[1:] or slides[2:])[0]
            raise extra.source.refuse("is one joint too many between two bodies: one hinge and two slides are planar")
        if slides and hinges and joints[0].kind == "hinge":
            raise slides[0].source.refuse("slides on a body that turns first; give the hinge last, or a body between")
        point = link.position + link.rotation @ (hinges or slides)[0].point
        if len(slides) == 2:
            self._slide_in_plane(parent, link, slides, point)
        elif slides:
            axis = link.rotation @ slides[0].axis
            angle = float(np.arctan2(*(self.plane.axes[:2] @ axis)[::-1]))
            # at the zero of the file the point is at the origin of the guide
            guide = self._at(parent, point - slides[0].reference * axis, angle)
            kind = PointOnLine if hinges else Translational
            self._keep(slides[0], link, kind(slides[0].name, guide, self._at(link, point, angle)))
        if hinges:
            self._turn(parent, link, hinges[0], point, FreeHinge if slides else Revolute)
        elif len(slides) == 2:
            ends = self._at(parent, point), self._at(link, point)
            self.joints.append(RelativeAngle(f"{link.name} angle", *ends, 0.0))

    def _turn(
        self, parent: Link, link: Link, hinge: SpatialJoint, point: np.ndarray, kind: type[FreeHinge | Revolute]
    ) -> None:
        """Add a joint whose angle has the sense and the zero of the file."""
        base, moved = self._at(parent, point), self._at(link, point, hinge.reference)
        if (link.rotation @ hinge.axis) @ self.plane.normal < 0:
            # the angle of the second marker relative to the first grows against the turn of the link
            base, moved = self._at(link, point), self._at(parent, point, hinge.reference)
        self._keep(hinge, link, kind(hinge.name, base, moved))

    def _slide_in_plane(self, parent: Link, link: Link, slides: Sequence[SpatialJoint], point: np.ndarray) -> None:
        """Add two slides, which together constrain no place."""
        directions = np.array([self.plane.axes[:2] @ (link.rotation @ slide.axis) for slide in slides])
        if abs(np.linalg.det(directions)) < PARALLEL:
            raise slides[1].source.refuse("slides along the axis of the other slide")
        # a place is the sum of the slides times their directions: each slide is measured along the dual direction
        for slide, dual in zip(slides, np.linalg.inv(directions).T, strict=True):
            origin = point - slide.reference / (dual @ dual) * (dual @ self.plane.axes[:2])
            ends = self._at(parent, origin), self._at(link, point)
            self._keep(slide, link, FreeSlide(slide.name, *ends, dual))

    def _keep(
        self, joint: SpatialJoint, link: Link, element: FreeSlide | FreeHinge | PointOnLine | Revolute | Translational
    ) -> None:
        """Add a joint with its coordinate, spring, damper, stops, dry friction and rotor."""
        if joint.name in self.coordinates:
            raise joint.source.refuse("has the name of another joint")
        self.joints.append(element)
        if isinstance(element, FreeHinge | Revolute):
            along = Coordinate(element.angle, element.angular_velocity, joint.reference)
        else:
            along = Coordinate(element.displacement, element.speed, joint.reference)
        self.coordinates[joint.name] = along
        force = -joint.damping * along.rate - joint.stiffness * (along.value - joint.rest)
        if joint.damping or joint.stiffness:
            self.forces.append(CoordinateForce(f"{joint.name} spring and damper", along, force))
        self._limit(joint, link, along)
        self._rub(joint, link, element)
        if joint.armature:
            self._add_rotor(joint, element, along.value)

    def _limit(self, joint: SpatialJoint, link: Link, along: Coordinate) -> None:
        """Add stops at the limits of a coordinate."""
        size = self._radius_of_gyration(link, joint) if joint.limits else 0.0
        if joint.limits and size == 0:
            self.robot.left_out.append(f"the limits of joint '{joint.name}', which carries nothing of a size")
        elif joint.limits:
            law = self.laws.law(size, size if joint.kind == "hinge" else 1.0)
            lower, upper = joint.limits
            for side, limit, gap in (("lower", lower, along.value - lower), ("upper", upper, upper - along.value)):
                if np.isfinite(limit):
                    self.forces.append(EndStop(f"{joint.name} {side} stop", gap, law))

    def _rub(
        self, joint: SpatialJoint, link: Link, element: FreeSlide | FreeHinge | PointOnLine | Revolute | Translational
    ) -> None:
        """Add the dry friction of a joint."""
        size = self._radius_of_gyration(link, joint) if joint.dry_friction else 0.0
        if joint.dry_friction and (size == 0 or isinstance(element, FreeSlide | FreeHinge)):
            self.robot.left_out.append(f"the dry friction of joint '{joint.name}', which holds no place")
        elif joint.dry_friction and not isinstance(element, FreeSlide | FreeHinge):
            is_pin = isinstance(element, Revolute)
            load, radius = (joint.dry_friction / size, size) if is_pin else (joint.dry_friction, None)
            law = self.laws.friction(1.0, size)
            self.forces.append(LoadIndependentFriction(f"{joint.name} friction", element, law, load, radius))

    def _radius_of_gyration(self, link: Link, joint: SpatialJoint) -> float:
        """Radius of gyration of what a joint carries, about its hinge, or the centre of mass if it slides, m."""
        carried = {link}
        for other in self.robot.links:  # parents come first
            if other.parent in carried:
                carried.add(other)
        parts = [(other, part) for other in self.robot.links if other in carried for part in other.masses]
        masses = np.array([part.mass for _, part in parts])
        if not np.sum(masses) > 0:
            return 0.0
        places = np.array([self.plane.place(other.position + other.rotation @ part.center) for other, part in parts])
        about = self.plane.place(link.position + link.rotation @ joint.point)
        about = about if joint.kind == "hinge" else masses @ places / np.sum(masses)
        axes = [other.rotation.T @ self.plane.normal for other, _ in parts]
        inertia = sum(axis @ part.inertia @ axis for axis, (_, part) in zip(axes, parts, strict=True))
        inertia += masses @ np.sum((places - about) ** 2, axis=1)
        return float(np.sqrt(inertia / np.sum(masses)))

    def _pull(self, tendon: Tendon) -> None:
        """Add the coordinate of a tendon with its spring, damper and stops."""
        value = sum((factor * self.coordinates[name].value for name, factor in tendon.parts), ca.SX(0))
        value += sum(
            (strand.share * strand_length(strand, self._at, self.plane.normal) for strand in tendon.strands), ca.SX(0)
        )
        reference = float(at_poses(value))
        points = [strand.start for strand in tendon.strands] + [strand.end for strand in tendon.strands[-1:]]
        markers = tuple(self._at(link, point) for link, point in points)
        along = self.coordinates[tendon.key] = Coordinate(value, time_derivative(value), reference, markers)
        lower, upper = tendon.rest or (2 * (self._at_rest(tendon, value),))
        is_linear = lower == upper
        if tendon.damping or (tendon.stiffness and is_linear):
            force = -tendon.damping * along.rate - (tendon.stiffness * (value - lower) if is_linear else 0.0)
            self.forces.append(CoordinateForce(f"{tendon.key} spring and damper", along, force))
        if tendon.stiffness and not is_linear:
            self._hold_within(f"{tendon.key} {{}} spring", tendon, (lower, upper), HuntCrossley(tendon.stiffness, 1))
        if tendon.limits:
            laws = [self.laws.law(tendon.limits[1])] if tendon.strands else self._laws_of_joints(tendon)
            if laws:
                softest = min(laws, key=lambda law: float(law.stiffness))
                self._hold_within(f"{tendon.key} {{}} stop", tendon, tendon.limits, softest)
            else:
                self.robot.left_out.append(f"the range of tendon '{tendon.name}', which moves nothing of a size")

    def _laws_of_joints(self, tendon: Tendon) -> list[HuntCrossley]:
        """Laws of stops on the joints of a tendon, in terms of its value."""
        factors, laws = dict(tendon.parts), []
        for link, joint in self.robot.joints:
            size = self._radius_of_gyration(link, joint) if factors.get(joint.name) else 0.0
            if size > 0:
                lever = size if joint.kind == "hinge" else 1.0
                laws.append(self.laws.law(size, lever / abs(factors[joint.name])))
        return laws

    def _at_rest(self, tendon: Tendon, value: ca.SX) -> float:
        """Value of a tendon with all joints where their springs are free."""
        if not tendon.strands:
            rests = {joint.name: joint.rest for _, joint in self.robot.joints}
            return sum(factor * rests[name] for name, factor in tendon.parts)
        poses, symbols, places = self.robot.at_rest(), ca.SX(0, 1), ca.DM(0, 1)
        for link, body in self.bodies.items():
            turn = self.plane.axes @ poses[link][0] @ link.rotation.T @ self.plane.axes.T
            center = np.array(body.pose_estimate[:2]) - self.plane.place(link.position)
            x, y = self.plane.place(poses[link][1]) + turn[:2, :2] @ center
            symbols = ca.vertcat(symbols, body.q)
            places = ca.vertcat(places, x, y, float(np.arctan2(turn[1, 0], turn[0, 0])))
        return float(ca.substitute(value, symbols, places))

    def _hold_within(self, name: str, tendon: Tendon, limits: tuple[float, float], law: HuntCrossley) -> None:
        """Add stops at limits of a tendon that can move; those at which it would have no length are none."""
        along = self.coordinates[tendon.key]
        if not symbols_of(along.value):
            return
        if limits[0] > 0 or tendon.parts:
            self.forces.append(CoordinateStop(name.format("lower"), along, along.value - limits[0], law))
        self.forces.append(CoordinateStop(name.format("upper"), along, limits[1] - along.value, law))

    def _carry(self, link: Link) -> None:
        """Add the force that carries a share of the weight of a link, at its centre of mass."""
        mass = sum(part.mass for part in link.masses)
        if link.carried and mass > 0 and self.moving[link].parent is not None and np.any(self._down):
            center = np.sum([part.mass * part.center for part in link.masses], axis=0) / mass
            at = self._at(link, link.position + link.rotation @ center)
            x, y = -link.carried * mass * self._down
            self.forces.append(Force(f"{link.name} gravity compensation", at, (float(x), float(y))))

    def _add_rotor(self, joint: SpatialJoint, element: Element, value: ca.SX) -> None:
        """Add a body without mass that turns with a coordinate, on a pin at the hinge or at the origin."""
        pin = element.a if isinstance(element, Revolute) else ground.at(0, 0)
        place = np.ravel(values_of(at_poses(pin.position)))
        rotor = Body(f"{joint.name} rotor", mass=0.0, inertia=joint.armature, pose=(*place, 0))
        self.rotors.append(rotor)
        self.joints.append(Revolute(f"{joint.name} rotor pin", pin, rotor.at(0, 0)))
        self.joints.append(Constraint(f"{joint.name} armature", rotor.phi - (value - joint.reference)))

    def _close(self, loop: Loop) -> None:
        if self.moving[loop.a] is self.moving[loop.b]:
            raise loop.source.refuse("connects a body with itself")
        if loop.joints:
            self._connect(loop.a, loop.b, loop.joints)
            return
        kind = Weld if loop.fixed else Revolute
        end = loop.point if loop.end is None else loop.end
        across = float(self.plane.normal @ (end - loop.point))
        if abs(across) > 1e-3:
            self.robot.left_out.append(f"the {abs(across):g} m across the plane between the ends of '{loop.name}'")
        self.joints.append(kind(loop.name, self._at(loop.a, loop.point), self._at(loop.b, end)))
