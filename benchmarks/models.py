"""The models that are timed, described once: the mechanism and its copies for other packages come from the same data.

A model is a list of bodies, pins, springs and torques in numbers
(:class:`Model`). :meth:`Model.mechanism` makes the mechanism of mbdcasadi;
``peers.py`` makes the models of the other packages from the same lists.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import mbdcasadi as mbd

#: Acceleration of gravity, m/s².
GRAVITY = 9.81


@dataclass(frozen=True)
class BodyData:
    """A body: name, mass (kg), inertia (kg m²), pose (m, m, rad)."""

    name: str
    mass: float
    inertia: float
    pose: tuple[float, float, float]


@dataclass(frozen=True)
class Pin:
    """A revolute joint: index of each body (None for the ground) and the point on it, m."""

    name: str
    a: int | None
    at_a: tuple[float, float]
    b: int
    at_b: tuple[float, float]


@dataclass(frozen=True)
class Spring:
    """A translational spring: bodies and points as in :class:`Pin`, stiffness N/m, free length m."""

    name: str
    a: int | None
    at_a: tuple[float, float]
    b: int
    at_b: tuple[float, float]
    stiffness: float
    free_length: float


@dataclass(frozen=True)
class Model:
    """A model in numbers.

    Attributes
    ----------
    name : str
        Its name.
    bodies, pins, springs : tuple
        What it is made of.
    torques : tuple of (int, float)
        Body and constant couple on it, N m.
    duration : float
        Time span, s.
    outputs : int
        Number of output intervals.
    gravity : float
        Downwards, m/s².
    speeds : dict of int to float
        Angular velocity at the start of some bodies, rad/s; the rest follows from the joints.
    goal : float
        Position error at which methods are compared, m.
    exact : callable, optional
        ``times -> (n_t, 2 n)`` centres of mass (m) of a motion that is known, or follows from one differential
        equation; without it the reference is computed.
    folds : bool
        True if it passes poses in which it could fold.
    """

    name: str
    bodies: tuple[BodyData, ...]
    pins: tuple[Pin, ...]
    duration: float
    springs: tuple[Spring, ...] = ()
    torques: tuple[tuple[int, float], ...] = ()
    outputs: int = 200
    gravity: float = GRAVITY
    speeds: dict[int, float] = field(default_factory=dict)
    goal: float = 1e-6
    exact: Callable[[np.ndarray], np.ndarray] | None = None
    folds: bool = False

    @property
    def times(self) -> np.ndarray:
        """Output times (outputs + 1,), s."""
        return np.linspace(0.0, self.duration, self.outputs + 1)

    def mechanism(
        self,
        drivers: Callable[[list[mbd.Body]], list] = lambda bodies: [],
        motors: Mapping[int, mbd.Input] | None = None,
    ) -> mbd.Mechanism:
        """Make the mechanism; called again it makes a new one on new symbols.

        Parameters
        ----------
        drivers : callable, optional
            ``bodies -> list of Driver``.
        motors : mapping, optional
            Index of a body to the input that is the couple on it.
        """
        motors = motors or {}
        bodies = [mbd.Body(b.name, mass=b.mass, inertia=b.inertia, pose=b.pose) for b in self.bodies]

        def marker(index: int | None, point: tuple[float, float]) -> mbd.Marker:
            return (mbd.ground if index is None else bodies[index]).at(*point)

        joints = [mbd.Revolute(pin.name, marker(pin.a, pin.at_a), marker(pin.b, pin.at_b)) for pin in self.pins]
        forces: list = [mbd.Gravity((0, -self.gravity))] if self.gravity else []
        forces += [
            mbd.TSDA(s.name, marker(s.a, s.at_a), marker(s.b, s.at_b), stiffness=s.stiffness, free_length=s.free_length)
            for s in self.springs
        ]
        forces += [mbd.Torque(f"torque on {bodies[k].name}", bodies[k], value) for k, value in self.torques]
        forces += [mbd.Torque(f"motor of {bodies[k].name}", bodies[k], couple) for k, couple in motors.items()]
        return mbd.Mechanism(
            bodies=bodies,
            joints=joints,
            drivers=drivers(bodies),
            forces=forces,
            inputs=list(motors.values()),
            name=self.name,
        )

    def start(self, mechanism: mbd.Mechanism) -> list:
        """Conditions at the start: the angular velocities that are stated."""
        return [mechanism.bodies[k].omega == speed for k, speed in self.speeds.items()]

    @staticmethod
    def compared(mechanism: mbd.Mechanism) -> ca.SX:
        """Compared quantities: the centre of mass of every body (2 n,), m."""
        return ca.vertcat(*[body.position for body in mechanism.bodies])


# --- the models ----------------------------------------------------------------------------
def _bar(name: str, mass: float, start: np.ndarray, end: np.ndarray) -> BodyData:
    """A uniform bar between two points."""
    x, y = (start + end) / 2
    dx, dy = end - start
    return BodyData(name, mass, mass * (dx**2 + dy**2) / 12, (float(x), float(y), math.atan2(dy, dx)))


def four_bar(duration: float = 10.0) -> Model:
    """A crank-rocker under gravity; the crank starts at 20 rad/s and turns over."""
    a, b, c, d, theta = 0.10, 0.28, 0.24, 0.30, 0.5
    o2, o4 = np.zeros(2), np.array([d, 0.0])
    pin_a = a * np.array([math.cos(theta), math.sin(theta)])
    # the pin between coupler and rocker is where two circles meet
    across = o4 - pin_a
    distance = float(np.hypot(*across))
    along = (b**2 - c**2 + distance**2) / (2 * distance)
    height = math.sqrt(b**2 - along**2)
    e = across / distance
    pin_b = pin_a + along * e + height * np.array([-e[1], e[0]])
    bodies = (_bar("crank", 0.3, o2, pin_a), _bar("coupler", 0.8, pin_a, pin_b), _bar("rocker", 0.7, o4, pin_b))
    pins = (
        Pin("O2", None, (0, 0), 0, (-a / 2, 0)),
        Pin("A", 0, (a / 2, 0), 1, (-b / 2, 0)),
        Pin("B", 1, (b / 2, 0), 2, (c / 2, 0)),
        Pin("O4", None, (d, 0), 2, (-c / 2, 0)),
    )
    return Model("four-bar", bodies, pins, duration, speeds={0: 20.0}, outputs=500)


def chain(links: int, duration: float = 1.0, length: float = 0.1, angle: float = -math.pi / 4) -> Model:
    """An open chain of equal uniform bars (0.1 kg each), straight, released from rest at an angle to the horizontal."""
    along = length * np.array([math.cos(angle), math.sin(angle)])
    bodies = tuple(_bar(f"link {k + 1}", 0.1, k * along, (k + 1) * along) for k in range(links))
    pins = tuple(
        Pin(f"pin {k + 1}", k - 1 if k else None, (length / 2, 0) if k else (0, 0), k, (-length / 2, 0))
        for k in range(links)
    )
    return Model(f"chain of {links}", bodies, pins, duration, outputs=100)


def double_pendulum(duration: float = 5.0) -> Model:
    """Two uniform bars of 1 m and 1 kg, released from rest, the first horizontal, the second upright."""
    points = (np.zeros(2), np.array([1.0, 0.0]), np.array([1.0, 1.0]))
    bodies = tuple(_bar(name, 1.0, a, b) for name, a, b in zip(("upper", "lower"), points, points[1:], strict=False))
    pins = (Pin("pivot", None, (0, 0), 0, (-0.5, 0)), Pin("elbow", 0, (0.5, 0), 1, (-0.5, 0)))
    return Model("double pendulum", bodies, pins, duration)


def andrews_squeezer(duration: float = 0.03) -> Model:
    """Andrews' squeezing mechanism: seven bodies, ten pins, one spring, a constant torque.

    References
    ----------
    IFToMM library of computational benchmarks, A03; IVP Test Set, "andrews";
    Hairer and Wanner, Solving Ordinary Differential Equations II, chapter VII.
    """
    m = (0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498)
    inertia = (2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
    a, b, c = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), (0.014, 0.072)
    d, da, e, ea = 0.028, 0.0115, 0.02, 0.01421
    rr, ra, ss, sa, sb, sc, sd = 0.007, 0.00092, 0.035, 0.01874, 0.01043, 0.018, 0.02
    ta, tb, u, ua, ub, zf, zt, fa = 0.02308, 0.00916, 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    beta, theta, gamma, phi = -0.0617138900142764496, 0.0, 0.455279819163070380, 0.222668390165885885
    delta, omega, epsilon = 0.487364979543842550, -0.222668390165885885, 1.23054744454982120

    def turned(angle: float, x: float, y: float) -> np.ndarray:
        return np.array([math.cos(angle) * x - math.sin(angle) * y, math.sin(angle) * x + math.cos(angle) * y])

    # each body: angle, a reference point on the global frame, its centre of mass from there in its own axes
    k1 = turned(beta, rr, 0)
    frames = (
        (beta, np.zeros(2), (ra, 0.0)),
        (beta + theta, k1, (-da, 0.0)),
        (gamma, b, (sb, -sa)),
        (phi + delta, a + turned(delta, zt, 0), (0.0, -(e - ea))),
        (delta, a, (ta, tb)),
        (omega + epsilon, a + turned(epsilon, 0, -u), (zf - fa, 0.0)),
        (epsilon, a, (-ub, -ua)),
    )
    bodies, centres = [], []
    for k, (angle, origin, centre) in enumerate(frames):
        x, y = origin + turned(angle, *centre)
        bodies.append(BodyData(f"K{k + 1}", m[k], inertia[k], (float(x), float(y), angle)))
        centres.append(centre)

    def at(k: int, x: float, y: float) -> tuple[float, float]:
        """Point of body K(k + 1), from its reference point, seen from its centre of mass."""
        return x - centres[k][0], y - centres[k][1]

    ground = ((0.0, 0.0), (float(b[0]), float(b[1])), (float(a[0]), float(a[1])))
    # the point P where K2, K3, K4 and K6 meet, by body
    common = {1: at(1, -d, 0), 2: at(2, 0, -ss), 3: at(3, 0, -e), 5: at(5, zf, 0)}
    pins = (
        Pin("O", None, ground[0], 0, at(0, 0, 0)),
        Pin("K1-K2", 0, at(0, rr, 0), 1, at(1, 0, 0)),
        Pin("B", None, ground[1], 2, at(2, 0, 0)),
        Pin("P-K3", 1, common[1], 2, common[2]),
        Pin("P-K4", 1, common[1], 3, common[3]),
        Pin("K4-K5", 3, at(3, 0, 0), 4, at(4, zt, 0)),
        Pin("A-K5", None, ground[2], 4, at(4, 0, 0)),
        Pin("P-K6", 1, common[1], 5, common[5]),
        Pin("K6-K7", 5, at(5, 0, 0), 6, at(6, 0, -u)),
        Pin("A-K7", None, ground[2], 6, at(6, 0, 0)),
    )
    spring = Spring("spring", None, c, 2, at(2, sd, -sc), 4530.0, 0.07785)
    return Model(
        "Andrews' squeezer",
        tuple(bodies),
        pins,
        duration,
        springs=(spring,),
        torques=((0, 0.033),),
        gravity=0.0,
        outputs=100,
        goal=1e-7,
    )


def four_bars(loops: int, duration: float = 10.0) -> Model:
    """Windows in a row: upright bars of 1 m and 1 kg on the ground, joined at their tops by equal ones.

    In the pose in which all bars lie on a line the mechanism could fold. The first bar begins at 1 rad/s. All
    upright bars turn alike and all others move in circles, so that one equation gives the motion.

    References
    ----------
    IFToMM library of computational benchmarks, A02, N-four-bar mechanism.
    """
    bodies, pins = [], []
    for k in range(loops + 1):
        bodies.append(_bar(f"upright {k}", 1.0, np.array([float(k), 0.0]), np.array([float(k), 1.0])))
        pins.append(Pin(f"ground {k}", None, (float(k), 0.0), k, (-0.5, 0)))
    for k in range(loops):
        place = len(bodies)
        bodies.append(_bar(f"top {k}", 1.0, np.array([float(k), 1.0]), np.array([k + 1.0, 1.0])))
        pins += [Pin(f"left {k}", k, (0.5, 0), place, (-0.5, 0)), Pin(f"right {k}", k + 1, (0.5, 0), place, (0.5, 0))]

    def exact(times: np.ndarray) -> np.ndarray:
        from scipy.integrate import solve_ivp  # first runs must not wait for it

        uprights, places = np.arange(loops + 1.0), np.arange(loops) + 0.5
        inertia, moment = (loops + 1) / 3 + loops, ((loops + 1) / 2 + loops) * GRAVITY
        angle = solve_ivp(
            lambda _t, y: [y[1], moment / inertia * np.sin(y[0])],
            (times[0], times[-1]),
            [0.0, -1.0],
            method="DOP853",
            t_eval=times,
            rtol=3e-14,
            atol=1e-15,
        ).y[0][:, None]
        x = np.hstack([uprights - np.sin(angle) / 2, places - np.sin(angle)])
        y = np.hstack([np.tile(np.cos(angle) / 2, loops + 1), np.tile(np.cos(angle), loops)])
        return np.stack([x, y], axis=2).reshape(times.size, -1)

    return Model(
        f"{loops} four-bars",
        tuple(bodies),
        tuple(pins),
        duration,
        speeds={0: -1.0},
        outputs=100,
        exact=exact,
        folds=True,
    )


#: Every model by its name on the command line.
MODELS: dict[str, Callable[[], Model]] = {
    "four_bar": four_bar,
    "double_pendulum": double_pendulum,
    "chain10": lambda: chain(10),
    "chain40": lambda: chain(40),
    "chain100": lambda: chain(100),
    "chain500": lambda: chain(500, duration=0.2),
    "squeezer": andrews_squeezer,
    "four_bars40": lambda: four_bars(40),
}
