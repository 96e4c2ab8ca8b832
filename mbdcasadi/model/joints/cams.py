"""Cams with their followers, and points on curves.

The parameter of the contact point on the outline is a coordinate without inertia, solved with the others.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import cross
from ..events import Event
from ..expressions import norm
from ..geometry.cam_outlines import CamOutline
from ..geometry.curves import Curve
from ..symbols import Coordinate, Scalar, values_of
from ..validity import ValidityCondition
from .base import Joint
from .outline_contact import (
    as_outline,
    convex,
    fitting,
    nearest_place,
    positive_radius,
    touching_place,
    touching_places,
    wide_enough,
)


class Pressed(Joint):
    """Base class of contacts along an outline: the parameter of the contact, its force, and its lift-off."""

    parameter: Coordinate
    #: what would lift off, for messages
    part = "follower"

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        rows: ca.SX,
        row_labels: tuple[str, ...],
        velocity_rows: ca.SX | None = None,
    ):
        super().__init__(name, a, b, rows, row_labels, velocity_rows)
        lifted = (
            f"the contact force is negative: the {self.part} would lift off, but the joint pulls it; "
            "press it on by a spring, or stop at the event that lift_off() returns"
        )
        self.validity_conditions = (ValidityCondition(self.normal_force, f"{self.description}: {lifted}"),)

    @property
    def normal_force(self) -> ca.SX:
        """Force that presses the two together, N; negative if they would separate."""
        raise NotImplementedError

    def lift_off(self, terminal: bool = True) -> Event:
        """Return the event at which the contact would open: its force passes through zero."""
        return Event(f"lift-off at {self.name}", self.normal_force, direction=-1, terminal=terminal)


class CamFlatFollower(Pressed):
    """Cam against a flat face, the x axis of a marker.

    ``Phi = [y_b · (r^c - r^b), y_b · A_a g']`` (2 rows, m and m/rad): the contact
    point ``r^c = r^a + A_a s'(alpha)`` lies on the face, and the tangent
    ``g' = ds'/dalpha`` of the outline (for a profile made for a flat face,
    its unit direction) is parallel to it. One coordinate ``alpha``.

    Parameters
    ----------
    name : str
        Its name.
    cam : Marker
        Frame of the outline on the cam.
    face : Marker
        Point and x axis of the face on the follower. The cam may lie on either side;
        it touches at the point nearer to the face at the estimated poses.
    outline : CamOutline
        Convex outline: a flat face cannot reach into a hollow.

    Attributes
    ----------
    parameter : Coordinate
        Parameter of the contact point on the outline.
    contact_point : casadi.SX
        The contact point (2,), global, m.

    Raises
    ------
    ModelError
        For an outline with a hollow or a straight piece; the message gives the point and its curvature.

    References
    ----------
    Haug 1989, section 3.4 (cam–flat-faced follower).
    """

    def __init__(self, name: str, cam: Marker, face: Marker, outline: CamOutline):
        a, b = self.pair(name, cam, face, ("cam", "face"))
        what = self.description
        self.outline = as_outline(outline, what)
        self.limits = (*positive_radius(what, self.outline), *convex(what, self.outline))
        self.parameter = Coordinate(f"{name}.parameter", touching_place(self.outline, a, b), self.outline.span)
        self.coordinates = (self.parameter,)
        self.contact_point = a.position + a.axes @ self.outline.point(self.parameter)
        on_face = ca.dot(b.y_axis, self.contact_point - b.position)
        along_face = ca.dot(b.y_axis, a.axes @ self.outline.direction(self.parameter))
        super().__init__(name, a, b, ca.vertcat(on_face, along_face), ("contact", "tangent"))

    @cached_property
    def normal_force(self) -> ca.SX:
        """Force that presses cam and face together, N; negative if they would separate."""
        outward = self.a.axes @ self.outline.normal(self.parameter)
        return self.multipliers[0] * ca.dot(self.b.y_axis, outward)


class CamPointFollower(Pressed):
    """Cam against a point (a knife edge) or a roller.

    ``Phi = r^a + A_a (s'(alpha) + R n'(alpha)) - r^b`` (2 rows, m): the centre of
    the roller of radius R lies at that distance outside the outline, along its
    normal n'. One coordinate ``alpha``. The roller has no mass and turns freely.

    Parameters
    ----------
    name : str
        Its name.
    cam : Marker
        Frame of the outline on the cam.
    point : Marker
        Knife edge, or centre of the roller, on the follower.
    outline : CamOutline
        Outline, with hollows wider than the roller.
    roller_radius : float or expression in parameters, default 0
        R, m; zero for a knife edge.

    Attributes
    ----------
    parameter : Coordinate
        Parameter of the contact point on the outline.
    contact_point : casadi.SX
        The contact point (2,), global, m.

    Raises
    ------
    ModelError
        For a hollow too narrow for the roller; the message gives the point and its radius of curvature.
    """

    def __init__(self, name: str, cam: Marker, point: Marker, outline: CamOutline, roller_radius: Scalar = 0.0):
        a, b = self.pair(name, cam, point, ("cam", "point"))
        what = self.description
        self.outline = as_outline(outline, what)
        self.roller_radius = self.read(roller_radius, "roller_radius", at_least=0.0, fixed=True)
        wide = wide_enough(what, self.outline, self.roller_radius)
        self.limits = (*self.limits, *positive_radius(what, self.outline), *wide)
        radius = float(values_of(self.roller_radius)[0, 0])
        start = nearest_place(self.outline, a, b, radius)
        self.parameter = Coordinate(f"{name}.parameter", start, self.outline.span)
        self.coordinates = (self.parameter,)
        self.contact_point = a.position + a.axes @ self.outline.point(self.parameter)
        centre = a.position + a.axes @ self.outline.beside(self.parameter, self.roller_radius)
        super().__init__(name, a, b, centre - b.position, ("x", "y"))

    @cached_property
    def normal_force(self) -> ca.SX:
        """Force that presses cam and follower together, N; negative if they would separate."""
        return ca.dot(self.multipliers, self.a.axes @ self.outline.normal(self.parameter))

    @cached_property
    def pressure_angle(self) -> ca.SX:
        """Angle from the outward normal to the velocity of the follower's point, rad; undefined at rest."""
        outward = self.a.axes @ self.outline.normal(self.parameter)
        return ca.atan2(cross(outward, self.b.velocity), ca.dot(outward, self.b.velocity))


class CamCam(Pressed):
    """Two outlines that touch from outside and slide on each other.

    ``Phi = [r^a + A_a s'_a - r^b - A_b s'_b, (R A_a g'_a) · A_b g'_b / c]`` (3 rows, m): one
    point of each coincide, and the tangents are parallel. Two coordinates, the
    parameters on both; c is the size of outline b, a constant.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Frames of the outlines on two bodies.
    outline_a, outline_b : CamOutline
        Outlines; a hollow of one must be wider than some part of the other.

    Attributes
    ----------
    parameter, parameter_b : Coordinate
        Parameters of the contact point on the outlines.
    contact_point : casadi.SX
        (2,), global, m.

    Raises
    ------
    ModelError
        For a hollow into which no part of the other outline fits.
    """

    def __init__(self, name: str, a: Marker, b: Marker, outline_a: CamOutline, outline_b: CamOutline):
        a, b = self.pair(name, a, b)
        what = self.description
        self.outline, self.outline_b = as_outline(outline_a, what), as_outline(outline_b, what)
        fitting(what, self.outline, self.outline_b)
        self.limits = positive_radius(what, self.outline, self.outline_b)
        places = touching_places(self.outline, self.outline_b, a, b)
        self.parameter = Coordinate(f"{name}.parameter", places[0], self.outline.span)
        self.parameter_b = Coordinate(f"{name}.parameter_b", places[1], self.outline_b.span)
        self.coordinates = (self.parameter, self.parameter_b)
        self.contact_point = a.position + a.axes @ self.outline.point(self.parameter)
        other = b.position + b.axes @ self.outline_b.point(self.parameter_b)
        g_a, g_b = a.axes @ self.outline.direction(self.parameter), b.axes @ self.outline_b.direction(self.parameter_b)
        parallel = cross(g_a, g_b) / self.outline_b.size
        rows = ca.vertcat(self.contact_point - other, parallel)
        super().__init__(name, a, b, rows, ("x", "y", "tangent"))
        gap = self.outline.curvature(self.parameter) + self.outline_b.curvature(self.parameter_b)
        crossing = "the outlines cross at the contact: a hollow of one is narrower than the other"
        self.validity_conditions = (
            *self.validity_conditions,
            ValidityCondition(gap, f"{self.description}: {crossing}"),
        )

    @cached_property
    def normal_force(self) -> ca.SX:
        """Force that presses the outlines together, N; negative if they would separate."""
        return ca.dot(self.multipliers[:2], self.a.axes @ self.outline.normal(self.parameter))


class PointOnCurve(Joint):
    """Pin in a curved slot, or a point on a rail: a point of b stays on a curve of a.

    ``Phi = r^a + A_a s'(alpha) - r^b`` (2 rows, m), in both directions. One
    coordinate ``alpha`` without inertia.

    Parameters
    ----------
    name : str
        Its name.
    a : Marker
        Frame of the curve.
    b : Marker
        The point.
    curve : Curve
        Open or closed curve. Analyses warn if the point leaves the ends of an open one.

    Attributes
    ----------
    parameter : Coordinate
        Parameter of the point on the curve.

    Notes
    -----
    Friction in it acts on the parameter, so that its reaction holds the friction; that of a :class:`PointOnLine`, as of
    all other joints, is the normal force alone, and ``force`` of the friction comes on top.
    """

    def __init__(self, name: str, a: Marker, b: Marker, curve: Curve):
        a, b = self.pair(name, a, b)
        self.curve = as_curve(curve, self.description)
        self.parameter = Coordinate(f"{name}.parameter", nearest_place(curve, a, b, 0.0), curve.span)
        self.coordinates = (self.parameter,)
        rows = a.position + a.axes @ curve.point(self.parameter) - b.position
        super().__init__(name, a, b, rows, ("x", "y"))
        self.validity_conditions = within_ends(self.description, curve, self.parameter, "point")

    @property
    def sliding(self) -> Any:
        """The parameter of the point, and the length of the tangent."""
        return ((self.parameter, norm(self.curve.tangent(self.parameter))),)

    @cached_property
    def normal_force(self) -> ca.SX:
        """Force of the curve on the point along the normal, to the right of the tangent, N."""
        return ca.dot(self.multipliers, self.a.axes @ self.curve.normal(self.parameter))


def as_curve(curve: Any, what: str) -> Curve:
    """Return a curve, or raise an error for something else."""
    if not isinstance(curve, Curve):
        raise ModelError(f"{what}: curve must be a Curve, got {curve!r}")
    return curve


def within_ends(what: str, curve: Curve, parameter: Coordinate, part: str) -> tuple[ValidityCondition, ...]:
    """Return the condition that a place is between the ends of an open curve; none for a closed one."""
    if curve.closed:
        return ()
    left = ca.fmin(parameter - curve.lower, curve.upper - parameter)
    return (ValidityCondition(left, f"{what}: the {part} has left the curve at one of its ends"),)
