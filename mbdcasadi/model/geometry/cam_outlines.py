"""Outlines of cams: polar functions, points, and profiles made for a follower motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ExpressionError, ModelError
from ..quantities import function_of, quantity, value_of, yes_or_no
from ..symbols import Numbers, describe, number, varying_in
from .curves import SAMPLES, Curve, checked_points, chord_lengths, crossing, values_over
from .motion_programs import MotionProgram
from .splines import closed_spline

TURN = 2 * np.pi


class CamOutline(Curve):
    """Closed outline of a cam in the cam marker's frame, run through counter-clockwise.

    Parameters
    ----------
    radius : float, callable or sequence of float
        Polar radius, m, above 0: a number (a disc about the marker), ``radius(angle)``
        of an angle from 0 to 2π, or values that a periodic spline of degree five joins (C4). Numbers and
        functions may contain parameters.
    angles : sequence of float, optional
        Angles (rad) of the values, increasing, within one turn; evenly spread from 0 by default.

    Raises
    ------
    ModelError
        For a radius that is not positive, and an outline that does not close.

    See Also
    --------
    through : an outline through points.
    for_flat_follower, for_roller_follower : profiles that make a follower move by a program.

    Examples
    --------
    An egg, and an eccentric disc with the axis of its body 10 mm off the centre::

        CamOutline(lambda angle: 0.03 + 0.004 * mbd.cos(angle))
        CamFlatFollower("tappet", cam.at(0, 0), face.at(0, 0), CamOutline(0.03))
        Revolute("shaft", ground.at(0, 0), cam.at(-0.010, 0))
    """

    _called = "CamOutline"

    #: The polar radius that was given, over the parameter.
    _radius: ca.SX | None = None

    def __init__(self, radius: Any, angles: Numbers | None = None):
        law = polar_law(radius, angles)

        def point(alpha: ca.SX) -> ca.SX:
            r = ca.SX(quantity(law(alpha), "CamOutline", "radius"))
            return r * ca.vertcat(ca.cos(alpha), ca.sin(alpha))

        super().__init__(point, 0.0, TURN, closed=True)
        self._radius = ca.dot(self._point, ca.vertcat(ca.cos(self._symbol), ca.sin(self._symbol)))
        smallest, place = _least(self._radius, self._symbol)
        if smallest <= 0:
            raise ModelError(f"CamOutline: radius must be above 0, got {smallest:.6g} at {place:.4g} rad")

    def radius(self, parameter: Any) -> ca.SX:
        """Return the distance of the outline from the marker, m; if the radius was given, that radius with its sign."""
        return ca.norm_2(self.point(parameter)) if self._radius is None else self._at(self._radius, parameter)

    @classmethod
    def through(cls, points: Any, closed: bool = True) -> Curve:
        """Return the outline through points by periodic splines of degree five (C4).

        Parameters
        ----------
        points : sequence of (float, float)
            (k, 2), m, at least five in order, in either sense; the first one is not repeated. The
            parameter runs from 0 to 2π in proportion to the length of the chords.
        closed : bool, default True
            Must be True: an outline is closed.
        """
        if not yes_or_no(closed, "CamOutline.through", "closed"):
            raise ModelError("CamOutline.through: an outline closes; an open curve is Curve.through(points)")
        return _Splined(points)

    @classmethod
    def for_flat_follower(cls, program: Any, base_radius: Any, direction: float = np.pi / 2) -> CamOutline:
        """Return the profile that moves a flat-faced follower by a program.

        The face is perpendicular to the motion of the follower. The outline's
        distance from the axis along its normal is ``base_radius + lift``.

        Parameters
        ----------
        program : MotionProgram or callable
            Lift (m) over the angle by which the cam has turned counter-clockwise, from 0 to 2π.
        base_radius : float or expression in parameters
            Distance of the face from the cam marker at no lift, m.
        direction : float, default π/2
            Direction in which the follower is lifted, against the cam marker at angle zero, rad.

        Raises
        ------
        ModelError
            If the profile would be undercut; the message gives the least base radius.
        """
        return _FlatProfile(program, base_radius, direction)

    @classmethod
    def for_roller_follower(
        cls,
        program: Any,
        base_radius: Any,
        roller_radius: float = 0.0,
        offset: float = 0.0,
        direction: float = np.pi / 2,
    ) -> CamOutline:
        """Return the profile that moves a roller (or a knife edge) on a straight guide by a program.

        Parameters
        ----------
        program : MotionProgram or callable
            Lift (m) over the angle by which the cam has turned counter-clockwise, from 0 to 2π.
        base_radius : float or expression in parameters
            Smallest radius of the cam, m (with an offset: distance of the roller surface from the marker at no lift).
        roller_radius : float, default 0
            m; zero for a knife edge.
        offset : float, default 0
            Distance of the guide from the cam marker, to the left of the direction, m.
        direction : float, default π/2
            Direction in which the follower is lifted, against the cam marker at angle zero, rad.

        Raises
        ------
        ModelError
            If the profile would be undercut; the message gives the angle of the cam.
        """
        return _RollerProfile(program, base_radius, roller_radius, offset, direction)


class _Splined(CamOutline):
    """Outline through points."""

    def __init__(self, points: Any):
        points = checked_points(points, "CamOutline", least_points=5)
        x, y = points.T
        if np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) < 0:
            points = np.vstack([points[:1], points[:0:-1]])
        knots, points = chord_lengths(points, closed=True)
        knots = knots * (TURN / knots[-1])
        symbol = ca.SX.sym("alpha")
        point = ca.vertcat(*[closed_spline(symbol, knots, c) for c in points.T])
        self._define(symbol, point, ca.jacobian(point, symbol), 0.0, TURN, True)
        place = crossing(self.points_and_normals(self.samples[::2])[0].T)
        if place is not None:
            raise ModelError(
                f"CamOutline.through: the outline crosses itself near ({place[0]:.4g}, {place[1]:.4g}) m; give the "
                "points in the order in which the outline runs through them"
            )


class _FlatProfile(CamOutline):
    """Profile for a flat face: the lift gives the support function, and the parameter is the angle of the normal."""

    def __init__(self, program: Any, base_radius: Any, direction: float):
        lift, alpha = lift_law(program), ca.SX.sym("alpha")
        base = quantity(base_radius, "CamOutline", "base_radius", above=0.0)
        turned = number(direction, "CamOutline", "direction") - alpha
        support = base + lift(turned)
        slope = ca.jacobian(support, alpha)
        self._bend = support + ca.jacobian(slope, alpha)
        self._out, self._along = ca.vertcat(ca.cos(alpha), ca.sin(alpha)), ca.vertcat(-ca.sin(alpha), ca.cos(alpha))
        bend, place = _least(self._bend, alpha)
        if bend <= 0:
            raise ModelError(
                f"CamOutline: the profile is undercut where the cam has turned by {(direction - place) % TURN:.4g}"
                f" rad: its radius of curvature would be {bend:.6g} m; make base_radius larger by more than "
                f"{-bend:.6g} m, or the program gentler"
            )
        point = support * self._out + slope * self._along
        self._define(alpha, point, self._bend * self._along, 0.0, TURN, True)

    def _direction_at_symbol(self) -> ca.SX:
        # a unit vector, without the second derivative of the lift, which may have kinks
        return self._along

    def _normal_at_symbol(self) -> ca.SX:
        return self._out

    def _curvature_at_symbol(self) -> ca.SX:
        return 1 / self._bend


class _RollerProfile(CamOutline):
    """Profile for a roller: the curve parallel to the path of its centre, inside it at the roller radius."""

    def __init__(self, program: Any, base_radius: Any, roller_radius: float, offset: float, direction: float):
        what = "CamOutline"
        lift, alpha = lift_law(program), ca.SX.sym("alpha")
        base = quantity(base_radius, what, "base_radius", above=0.0)
        roller, aside = number(roller_radius, what, "roller_radius"), number(offset, what, "offset")
        if roller < 0:
            raise ModelError(f"{what}: roller_radius must be at least 0, got {roller}")
        reach = (base + roller) ** 2 - aside**2
        if not ca.SX(reach).is_constant() or float(reach) > 0:
            along = ca.sqrt(reach) + lift(-alpha)
        else:
            raise ModelError(f"{what}: the offset {aside:g} m is not less than base_radius + roller_radius")
        angle = alpha + number(direction, what, "direction")
        c, s = ca.cos(angle), ca.sin(angle)
        path = ca.vertcat(c * along - s * aside, s * along + c * aside)
        self.roller_radius = roller
        self._path = Curve(lambda place: ca.substitute(path, alpha, place), 0.0, TURN, closed=True)
        bend = 1 - roller * self._path.curvature(alpha)
        left, place = _least(bend, alpha)
        if left <= 0:
            raise ModelError(
                f"{what}: the profile is undercut where the cam has turned by {-place % TURN:.4g} rad: the path "
                f"of the roller's centre has the radius of curvature {roller / (1 - left):.6g} m there, less than "
                f"the roller's {roller:g} m; take a smaller roller or a larger base_radius"
            )
        normal = self._path.normal(alpha)
        point = path - roller * normal if roller else path
        self._define(alpha, point, bend * self._path.tangent(alpha), 0.0, TURN, True)

    def _direction_at_symbol(self) -> ca.SX:
        return self._path.tangent(self._symbol)

    def _normal_at_symbol(self) -> ca.SX:
        return self._path.normal(self._symbol)

    def _curvature_at_symbol(self) -> ca.SX:
        of_path = self._path.curvature(self._symbol)
        return of_path / (1 - self.roller_radius * of_path)

    def beside(self, parameter: Any, distance: Any) -> ca.SX:
        """Return the point at a distance from the outline: on the path of the centre for the roller radius."""
        if not isinstance(distance, ca.SX):
            return self._path.beside(parameter, distance - self.roller_radius)
        return super().beside(parameter, distance)


def polar_law(radius: Any, angles: Any) -> Callable[[ca.SX], Any]:
    if callable(radius):
        if angles is not None:
            raise ModelError("CamOutline: angles= goes with values of the radius, not with a function")
        return every_turn(radius, "radius")
    if isinstance(radius, ca.SX) or np.ndim(radius) == 0:
        value = quantity(radius, "CamOutline", "radius", above=0.0)
        return lambda _angle: value
    try:
        radii = np.array(radius, dtype=float)
        places = np.linspace(0, TURN, len(radii), endpoint=False) if angles is None else np.array(angles, float)
    except (TypeError, ValueError, RuntimeError):
        raise ModelError(f"CamOutline: radius and angles must be numbers, got {radius!r}") from None
    if places.shape != radii.shape:
        raise ModelError(f"CamOutline: {radii.size} radii do not go with {places.size} angles")
    if places.size and places[-1] - places[0] >= TURN * (1 - 1e-9):
        raise ModelError("CamOutline: the angles go round once or more; leave out the point that repeats the first")
    xs, ys = np.r_[places, places[:1] + TURN], np.r_[radii, radii[:1]]
    _check_data(xs, ys)
    return lambda angle: closed_spline(angle, xs, ys)


def _check_data(xs: np.ndarray, ys: np.ndarray) -> None:
    """Raise an error if values over angles do not give a closed curve."""
    if len(xs) < 6:
        raise ModelError(f"CamOutline: takes at least 5 values of the radius, got {len(xs) - 1}")
    if not np.all(np.isfinite(np.r_[xs, ys])):
        raise ModelError("CamOutline: radii and angles must be finite")
    if np.any(np.diff(xs) <= 0):
        k = int(np.argmax(np.diff(xs) <= 0))
        raise ModelError(f"CamOutline: the angles must increase, got {xs[k]:.6g} and {xs[k + 1]:.6g}")


def lift_law(program: Any) -> Callable[[ca.SX], ca.SX]:
    """Return the lift as a function of the angle of the cam, repeated every turn."""
    if isinstance(program, MotionProgram):
        if abs(program.duration - TURN) > 1e-9:
            raise ModelError(
                f"CamOutline: the program of a cam goes over one turn, 2π = {TURN:.9g} rad, and this one over "
                f"{program.duration:.9g}"
            )
        return program
    if not callable(program):
        raise ModelError(f"CamOutline: program must be a MotionProgram or a function of the angle, got {program!r}")
    return every_turn(program, "program")


def every_turn(law: Callable[[ca.SX], Any], name: str) -> Callable[[ca.SX], ca.SX]:
    """Return a function of an angle from 0 to 2π, repeated every turn; unchanged if it is periodic itself."""
    symbol = ca.SX.sym("angle")
    value = ca.SX(value_of(function_of(law, "CamOutline", name, "the angle"), "CamOutline", name, symbol))
    if varying := varying_in(value, besides=symbol):
        raise ExpressionError(f"CamOutline: {name} may contain parameters only, not {describe(varying[0])}")
    places = np.linspace(0, TURN, 37)
    first_turn, later_turn = (values_over(value, symbol, places + turn) for turn in (0.0, 3 * TURN))
    if np.allclose(first_turn, later_turn, rtol=1e-11, atol=0):
        return lambda angle: ca.substitute(value, symbol, angle)
    ends = values_over(ca.vertcat(value, ca.jacobian(value, symbol)), symbol, np.array([0.0, TURN]))
    if not np.allclose(ends[:, 0], ends[:, 1], rtol=0, atol=1e-6 * np.max(np.abs(first_turn))):
        raise ModelError(
            f"CamOutline: the {name} does not close: it is {ends[0, 0]:.6g} m with the slope {ends[1, 0]:.4g} m/rad "
            f"at 0 and {ends[0, 1]:.6g} m with {ends[1, 1]:.4g} m/rad at 2π"
        )
    return lambda angle: ca.substitute(value, symbol, angle - TURN * ca.floor(angle / TURN))


def _least(expression: ca.SX, symbol: ca.SX) -> tuple[float, float]:
    """Return the least value of an expression over one turn, and the angle of it."""
    places = np.linspace(0, TURN, SAMPLES, endpoint=False)
    values = values_over(expression, symbol, places).ravel()
    k = int(np.argmin(values))
    return float(values[k]), float(places[k])
