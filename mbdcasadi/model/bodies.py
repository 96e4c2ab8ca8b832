"""Rigid bodies with centroidal frames, points with axes on them, and the ground."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..numerics.lazy import cached_property
from .geometry.shapes import Shape, rotation_matrix
from .immutable import HoldsSymbols, Immutable
from .quantities import HasQuantities, in_radians, quantity, triple
from .rates import time_derivative
from .symbols import Scalar, Vector, as_sx, check_name, register

__all__ = ["Body", "Ground", "Marker", "as_body", "as_marker", "ground", "markers_on_two", "rotation"]


def rotation(angle: Any) -> ca.SX:
    """Return the rotation matrix ``A(angle)`` (2, 2), which takes vectors from the rotated frame to the fixed one."""
    angle = as_sx(angle)
    c, s = ca.cos(angle), ca.sin(angle)
    return ca.blockcat([[c, -s], [s, c]])


class Body(Immutable, HoldsSymbols, HasQuantities):
    """A rigid body in the plane; its frame sits at the centre of mass.

    Parameters
    ----------
    name : str
        Its name, unique in the mechanism.
    mass : float or expression in parameters and states
        Mass, kg; may be zero if the joints determine the translation. One that changes with states has a
        :class:`MassFlow` for what leaves and enters.
    inertia : float or expression in parameters and states
        Moment of inertia ``J'`` about the centre of mass, kg m²; may be zero if the joints determine the rotation.
    pose : (float, float, float), default (0, 0, 0)
        Estimate of ``x, y`` (m) and ``phi`` (rad). A warning is given for an angle that seems to be in degrees.
    velocity : (float, float, float), default (0, 0, 0)
        Estimate of ``vx, vy`` (m/s) and ``omega`` (rad/s).
    shape : Shape, optional
        Outline for pictures, in the body frame.

    Attributes
    ----------
    x, y, phi, vx, vy, omega, ax, ay, alpha : casadi.SX
        Its coordinates and their rates, in the global frame (m, rad, s).
    q, v, a : casadi.SX
        Coordinates and their rates as vectors (3,).
    pose_estimate, velocity_estimate : numpy.ndarray
        The estimates, of the centre of mass.

    Raises
    ------
    ModelError
        For a negative or non-finite mass or inertia, a pose that is not three finite numbers, or the name "ground".

    References
    ----------
    Haug, *Computer Aided Kinematics and Dynamics of Mechanical Systems*, 1989, sections 2.4 and 6.1.
    """

    x: ca.SX
    y: ca.SX
    phi: ca.SX
    vx: ca.SX
    vy: ca.SX
    omega: ca.SX
    ax: ca.SX
    ay: ca.SX
    alpha: ca.SX

    def __init__(
        self,
        name: str,
        mass: Scalar,
        inertia: Scalar,
        pose: Vector = (0.0, 0.0, 0.0),
        velocity: Vector = (0.0, 0.0, 0.0),
        shape: Shape | None = None,
    ):
        self.name = check_name(name, "Body")
        what = self.description
        if name == "ground" and not self.is_ground:
            raise ModelError("body 'ground': the global frame has that name (mbd.ground); give the body another one")
        self.mass = self.read(mass, "mass", at_least=0.0)
        self.inertia = self.read(inertia, "inertia", at_least=0.0)
        self.pose_estimate = triple(pose, what, "pose", "(x, y, phi)")
        in_radians(self.pose_estimate[2], what, "the angle of the pose")
        self.velocity_estimate = triple(velocity, what, "velocity", "(vx, vy, omega)")
        self.shape = None if shape is None else as_shape(shape, what)
        self._shape_centroid = np.zeros(2)
        self._name_coordinates()

    def _name_coordinates(self) -> None:
        names = (("x", "vx", "ax"), ("y", "vy", "ay"), ("phi", "omega", "alpha"))
        roles = []
        for levels, estimate in zip(names, self.pose_estimate.tolist(), strict=True):
            symbols = [ca.SX.sym(f"{self.name}.{level}") for level in levels]
            unit = "rad" if levels[0] == "phi" else "m"
            for kind, level, symbol, rate, per, value in zip(
                ("position", "velocity", "acceleration"),
                levels,
                symbols,
                [*symbols[1:], None],
                ("", "/s", "/s²"),
                (estimate, None, None),
                strict=True,
            ):
                setattr(self, level, symbol)
                roles.append(register(symbol, kind, f"{self.name}.{level}", self, rate, unit + per, value))
        self._roles = tuple(roles)

    @classmethod
    def from_shape(
        cls,
        name: str,
        shape: Shape,
        density: float | None = None,
        mass: float | None = None,
        pose: Any = (0.0, 0.0, 0.0),
        velocity: Any = (0.0, 0.0, 0.0),
    ) -> Body:
        """Return a homogeneous body of a given shape.

        Mass, centre of mass and ``J'`` follow from the shape. The points given
        to :meth:`at`, the pose and the velocity are those of the *shape's own
        frame*; the coordinates ``x, y, phi`` remain those of the centre of mass.

        Parameters
        ----------
        name : str
            Its name.
        shape : Shape
            ``Rectangle``, ``Disc``, ``Polygon``, ``Rod``, or sums and differences of them.
        density : float, optional
            Mass by area, kg/m² (by length for rods, kg/m).
        mass : float, optional
            Mass, kg; exactly one of `density` and `mass` is given.
        pose, velocity : (float, float, float)
            Estimates for the shape's frame.
        """
        as_shape(shape, f"body '{name}'")
        total, centroid, inertia = shape.mass_properties(density=density, mass=mass)
        what = f"body '{name}'"
        x, y, phi = triple(pose, what, "pose", "(x, y, phi)")
        vx, vy, omega = triple(velocity, what, "velocity", "(vx, vy, omega)")
        arm = rotation_matrix(phi) @ centroid
        body = cls(
            name,
            total,
            inertia,
            pose=(x + arm[0], y + arm[1], phi),
            velocity=(vx - omega * arm[1], vy + omega * arm[0], omega),
            shape=shape,
        )
        object.__setattr__(body, "_shape_centroid", np.asarray(centroid, float))
        return body

    @cached_property
    def position(self) -> ca.SX:
        """Centre of mass ``r`` (2,), m."""
        return ca.vertcat(self.x, self.y)

    @cached_property
    def velocity(self) -> ca.SX:
        """Velocity of the centre of mass (2,), m/s."""
        return ca.vertcat(self.vx, self.vy)

    @cached_property
    def acceleration(self) -> ca.SX:
        """Acceleration of the centre of mass (2,), m/s²."""
        return ca.vertcat(self.ax, self.ay)

    @cached_property
    def q(self) -> ca.SX:
        """Coordinates ``[x, y, phi]``."""
        return ca.vertcat(self.x, self.y, self.phi)

    @cached_property
    def v(self) -> ca.SX:
        """Velocities ``[vx, vy, omega]``."""
        return ca.vertcat(self.vx, self.vy, self.omega)

    @cached_property
    def a(self) -> ca.SX:
        """Accelerations ``[ax, ay, alpha]``."""
        return ca.vertcat(self.ax, self.ay, self.alpha)

    @cached_property
    def axes(self) -> ca.SX:
        """Matrix ``A`` (2, 2) whose columns are the body's axes."""
        return rotation(self.phi)

    @property
    def description(self) -> str:
        """Kind and name, as messages give it."""
        return f"body '{self.name}'"

    @property
    def is_ground(self) -> bool:
        """True for the global frame."""
        return False

    @property
    def shape_frame(self) -> np.ndarray:
        """Origin of the shape's frame in the body frame (2,), m."""
        return -self._shape_centroid

    def at(self, x: Scalar, y: Scalar | None = None, angle: Scalar = 0.0) -> Marker:
        """Return the marker at a point of the body.

        Parameters
        ----------
        x, y : float or expression
            Coordinates in the body frame (in the shape's frame after :meth:`from_shape`), m. An expression in time is a
            point that moves over the body: ``ground.at(0, 0.1 * mbd.sin(mbd.t))`` is a support that shakes, or a table.
            What joints take from the estimated poses, as the phase of gears, they take at ``t = 0``.
        angle : float or expression, default 0
            Angle of the marker's x axis in that frame, rad.
        """
        what = self.description
        if y is None:
            raise ModelError(f"{what}: a marker needs two coordinates, at(x, y), got {x!r} alone")
        point = [quantity(value, what, f"marker {axis}") for value, axis in ((x, "x"), (y, "y"))]
        if any(isinstance(p, ca.SX) for p in point):
            local = ca.vertcat(*[as_sx(p) for p in point]) - self._shape_centroid
        else:
            local = ca.SX(np.array(point) - self._shape_centroid)
        angle = quantity(angle, what, "marker angle")
        in_radians(angle, what, "the angle of a marker")
        return Marker(self, local, as_sx(angle))

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r}, mass={self.mass}, inertia={self.inertia})"


def _component(vector: str, place: int, meaning: str) -> Any:
    """Return the property that is a component of a vector."""
    return property(lambda self: getattr(self, vector)[place], doc=meaning)


class Marker(Immutable):
    """A point with axes, fixed in the frame of a body.

    Made by :meth:`Body.at`. All attributes are expressions in the global frame.

    Attributes
    ----------
    body : Body
        The body that carries it.
    local : casadi.SX
        ``s'`` (2,), coordinates in the centroidal frame of the body, m.
    local_angle : casadi.SX
        Angle of its x axis in the body frame, rad.
    """

    def __init__(self, body: Body, local: ca.SX, local_angle: ca.SX):
        self.body = body
        self.local = local
        self.local_angle = local_angle

    @cached_property
    def position(self) -> ca.SX:
        """``r^P = r + A s'`` (2,), m."""
        return self.body.position + self.body.axes @ self.local

    @cached_property
    def velocity(self) -> ca.SX:
        """Velocity (2,), m/s."""
        return time_derivative(self.position)

    @cached_property
    def acceleration(self) -> ca.SX:
        """Acceleration (2,), m/s²."""
        return time_derivative(self.velocity)

    x: ca.SX = _component("position", 0, "First coordinate, m.")
    y: ca.SX = _component("position", 1, "Second coordinate, m.")
    vx: ca.SX = _component("velocity", 0, "First component of the velocity, m/s.")
    vy: ca.SX = _component("velocity", 1, "Second component of the velocity, m/s.")
    ax: ca.SX = _component("acceleration", 0, "First component of the acceleration, m/s².")
    ay: ca.SX = _component("acceleration", 1, "Second component of the acceleration, m/s².")

    @property
    def angle(self) -> ca.SX:
        """Angle of the marker's x axis, rad."""
        return self.body.phi + self.local_angle

    @cached_property
    def angular_velocity(self) -> ca.SX:
        """Rate of :attr:`angle`, rad/s."""
        return time_derivative(self.angle)

    @cached_property
    def axes(self) -> ca.SX:
        """Matrix (2, 2) whose columns are the marker's axes."""
        return rotation(self.angle)

    @property
    def x_axis(self) -> ca.SX:
        """Unit vector (2,) along the marker's x axis."""
        return self.axes[:, 0]

    @property
    def y_axis(self) -> ca.SX:
        """Unit vector (2,) along the marker's y axis."""
        return self.axes[:, 1]

    def __repr__(self) -> str:
        return f"Marker({self.body.name!r}, {self.local[0]}, {self.local[1]}, angle={self.local_angle})"


class Ground(Body):
    """The global frame as a body that does not move."""

    def __init__(self) -> None:
        super().__init__("ground", 0.0, 0.0)

    def _name_coordinates(self) -> None:
        for level in ("x", "y", "phi", "vx", "vy", "omega", "ax", "ay", "alpha"):
            setattr(self, level, ca.SX(0))
        self._roles = ()

    @property
    def is_ground(self) -> bool:
        return True

    def __repr__(self) -> str:
        return "ground"


#: The global frame.
ground = Ground()


def as_shape(value: Any, what: str) -> Shape:
    """Return the shape; raise an error that names the body if it is something else."""
    if not isinstance(value, Shape):
        raise ModelError(f"{what}: shape must be a Disc, Rectangle, Polygon, Rod or a sum of them, got {value!r}")
    return value


def as_body(value: Any, what: str, argument: str) -> Body:
    """Return the body; raise an error that names the element if it is something else."""
    if not isinstance(value, Body):
        raise ModelError(f"{what}: {argument} must be a body, got {value!r}")
    return value


def bodies_of_couple(body: Any, opposite: Any, what: str) -> tuple[Body, Body]:
    """Check the body on which a couple acts and the one that takes the reaction, which must differ."""
    body, opposite = as_body(body, what, "body"), as_body(opposite, what, "opposite")
    if opposite is body:
        raise ModelError(
            f"{what} acts on '{body.name}', which takes the reaction too: it would do nothing; "
            "body= is the one that moves, opposite= another one"
        )
    return body, opposite


def as_marker(value: Any, what: str, argument: str) -> Marker:
    """Return the marker; raise an error that names the element if it is something else."""
    if isinstance(value, Marker):
        return value
    hint = f"; write {value.name}.at(x, y)" if isinstance(value, Body) else ""
    raise ModelError(f"{what}: {argument} must be a marker, as body.at(x, y) makes it, got {value!r}{hint}")


def markers_on_two(a: Any, b: Any, what: str, names: tuple[str, str] = ("a", "b")) -> tuple[Marker, Marker]:
    """Return the two markers of an element that connects bodies; raise an error if both are on one body.

    The names are those of the arguments by which the user gives them.
    """
    a, b = as_marker(a, what, names[0]), as_marker(b, what, names[1])
    if a.body is b.body:
        raise ModelError(f"{what} connects body '{a.body.name}' with itself; its markers must be on two bodies")
    return a, b
