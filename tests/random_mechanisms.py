"""Seeded random planar mechanisms that close exactly at a pose that is known.

The true pose comes first, then markers that meet each other there; the bodies
get estimates that are a little off. Joints are added only while the rank of
the constraint Jacobian grows, so the rows are independent, but for every tenth
seed, which repeats one constraint.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

import mbdcasadi as mbd
from mbdcasadi.model.bodies import Body, Marker

#: Least singular value that a new row must leave to the Jacobian.
INDEPENDENT = 0.05


@dataclass(frozen=True)
class RandomCase:
    """A random mechanism and what is known of it.

    ``pose`` (n,) meets ``Phi(q, 0) = 0``; ``degrees_of_freedom`` is ``n - rank``;
    ``redundant`` is the number of rows that depend on others.
    """

    mechanism: mbd.Mechanism
    pose: np.ndarray
    degrees_of_freedom: int
    redundant: int


def random_mechanism(seed: int, driven: bool = False) -> mbd.Mechanism:
    """The mechanism of :func:`random_case`."""
    return random_case(seed, driven).mechanism


@cache
def random_case(seed: int, driven: bool = False) -> RandomCase:
    """A random mechanism with at least one degree of freedom, or none where it is driven."""
    return _Builder(seed).build(driven)


def random_arguments(mechanism: mbd.Mechanism, pose: np.ndarray, rng: np.random.Generator) -> tuple:
    """Numbers ``(t, q, v, a, z, lam, u, p)`` of a random state around a pose."""
    eom = mbd.equations(mechanism)
    return (
        rng.uniform(-1, 1),
        pose + rng.uniform(-0.2, 0.2, pose.size),
        *(rng.normal(size=group.numel()) for group in (eom.v, eom.a, eom.z, eom.lam, eom.u)),
        eom.parameter_values,
    )


class _Builder:
    """Draws the parts one after the other."""

    def __init__(self, seed: int):
        self.seed = seed
        self.rng = np.random.default_rng(seed)
        self.count = int(self.rng.integers(1, 7))
        self.length = mbd.Parameter("length", 0.3)
        self.input = mbd.Input("u", value=0.7)
        self.state = mbd.StateVariable("z", value=0.2)
        self.uses: set[object] = set()
        self.truth: dict[Body, np.ndarray] = {mbd.ground: np.zeros(3)}
        self.joints: list = []
        self.drivers: list = []
        self.jacobian = np.zeros((0, 3 * self.count))
        self._make_bodies()

    def build(self, driven: bool) -> RandomCase:
        for k in range(self.count):
            if self.rng.random() < 0.9:
                earlier = [mbd.ground, *self.bodies[:k]]
                self._try_joint(earlier[self.rng.integers(len(earlier))], self.bodies[k])
        for _ in range(int(self.rng.integers(0, 2 * self.count + 1))):
            first, second = self._two_bodies()
            self._try_joint(first, second)
        if not self.joints:
            self._try_joint(mbd.ground, self.bodies[0], "Revolute")
        free = 3 * self.count - len(self.jacobian)
        if driven:
            self._drive()
            free = 0
        redundant = self._repeat_one() if self.seed % 10 == 9 else 0
        forces = self._forces()
        mechanism = mbd.Mechanism(
            bodies=self.bodies,
            joints=self.joints,
            drivers=self.drivers,
            forces=forces,
            inputs=[self.input] if self.input in self.uses else [],
            parameters=[self.length] if self.length in self.uses else [],
            states={self.state: (self.input - self.state) / 0.05 - 2 * self.bodies[0].omega}
            if self.state in self.uses
            else None,
            name=f"random {self.seed}",
        )
        return RandomCase(mechanism, self.pose, free, redundant)

    # --- bodies ------------------------------------------------------------------------
    def _make_bodies(self) -> None:
        rng = self.rng
        poses = np.column_stack([rng.uniform(-1.5, 1.5, (self.count, 2)), rng.uniform(-np.pi, np.pi, self.count)])
        poses[:, 2] += 2 * np.pi * rng.integers(-1, 2, self.count) * (rng.random(self.count) < 0.2)
        # the constant of a rack is taken at the estimates: two bodies have theirs exact
        self.exact = list(rng.permutation(self.count)[:2]) if rng.random() < 0.4 else []
        self.bodies = []
        for k, pose in enumerate(poses):
            off = rng.uniform(-0.1, 0.1, 3) * (k not in self.exact)
            body = mbd.Body(
                f"body {k}",
                mass=rng.uniform(0.1, 3.0),
                inertia=rng.uniform(0.01, 0.5),
                pose=pose + off,
                velocity=rng.normal(size=3),
            )
            self.bodies.append(body)
            self.truth[body] = pose
        self.pose = poses.ravel()

    def _two_bodies(self) -> tuple[Body, Body]:
        """Two bodies, one of which may be the ground, on either side."""
        all_bodies = [mbd.ground, *self.bodies]
        first, second = self.rng.choice(len(all_bodies), 2, replace=False)
        return all_bodies[first], all_bodies[second]

    # --- points that meet at the true pose ------------------------------------------------
    def _local(self, body: Body, point: np.ndarray) -> np.ndarray:
        x, y, phi = self.truth[body]
        c, s = np.cos(phi), np.sin(phi)
        return np.array([[c, s], [-s, c]]) @ (point - [x, y])

    def marker(self, body: Body, point: np.ndarray, direction: float = 0.0) -> Marker:
        """Marker at a global point with a global direction; its angle is the one within half a turn."""
        angle = np.angle(np.exp(1j * (direction - self.truth[body][2])))
        return body.at(*self._local(body, point), angle=angle)

    def free_marker(self, body: Body) -> Marker:
        x, y = self.truth[body][:2]
        return self.marker(body, np.array([x, y]) + self.rng.uniform(-0.6, 0.6, 2), self.rng.uniform(-3, 3))

    def at_truth(self, expression) -> float:
        """Value at the true pose and t = 0."""
        symbols = [*(b.q for b in self.bodies), mbd.t, self.length]
        return float(ca.Function("f", symbols, [expression])(*(self.truth[b] for b in self.bodies), 0.0, 0.3))

    def wiggle(self, value: float) -> object:
        """The value, sometimes as a function of time that has it at t = 0."""
        return value + 0.1 * mbd.sin(2 * mbd.t) if self.rng.random() < 0.3 else value

    # --- joints ------------------------------------------------------------------------------
    def _try_joint(self, a: Body, b: Body, kind: str | None = None) -> None:
        kinds = [name for name in JOINTS if name != "RackAndPinion" or self._is_exact(a, b)]
        weights = np.array([JOINTS[name][0] for name in kinds], float)
        kind = kind or str(self.rng.choice(kinds, p=weights / weights.sum()))
        joint = JOINTS[kind][1](self, f"{kind} {len(self.joints)}", a, b)
        if joint is not None and self._is_independent(joint, spare=1):
            self.joints.append(joint)

    def _is_exact(self, a: Body, b: Body) -> bool:
        known = [mbd.ground, *(self.bodies[k] for k in self.exact)]
        return any(a is body for body in known) and any(b is body for body in known)

    def _is_independent(self, element, spare: int) -> bool:
        """Whether the rows add to the rank and leave some freedom; their Jacobian is then kept."""
        q = ca.vertcat(*[b.q for b in self.bodies])
        slope = ca.Function("slope", [q, mbd.t, self.length], [ca.densify(ca.jacobian(element.rows, q))])
        stacked = np.vstack([self.jacobian, slope(self.pose, 0.0, 0.3).full()])
        if len(stacked) > 3 * self.count - spare:
            return False
        rows = stacked / np.maximum(np.linalg.norm(stacked, axis=1, keepdims=True), 1e-12)
        if np.linalg.svd(rows, compute_uv=False)[-1] < INDEPENDENT:
            return False
        self.jacobian = stacked
        return True

    def _repeat_one(self) -> int:
        """The first constraint once more, under another name."""
        first = self.joints[0]
        self.joints.append(mbd.Constraint("repeated", first.rows))
        return first.rows.numel()

    def _drive(self) -> None:
        candidates: list[ca.SX] = [j.angle for j in self.joints if hasattr(j, "angle")]
        candidates += [j.displacement for j in self.joints if hasattr(j, "displacement")]
        points = [self.free_marker(b) for b in self.bodies]
        candidates += [e for m in points for e in (m.angle, m.x, m.y)]
        candidates += [m.x + 0.5 * m.angle + w * m.y for m in points for w in (-1.0, 0.4, 2.0)]
        weakest = self.rng.permutation(len(candidates))
        for k in weakest:
            value = self.at_truth(candidates[k]) + 0.1 * mbd.sin(mbd.t)
            driver = mbd.Driver(f"driver {len(self.drivers)}", candidates[k], value)
            if self._is_independent(driver, spare=0):
                self.drivers.append(driver)
        self._drive_the_rest()

    def _drive_the_rest(self) -> None:
        """Drivers along what is left free: combinations of coordinates, normal to all rows."""
        q = ca.vertcat(*[b.q for b in self.bodies])
        while len(self.jacobian) < 3 * self.count:
            direction = np.linalg.svd(self.jacobian)[2][-1]
            expression = ca.dot(ca.DM(direction), q)
            value = self.at_truth(expression) + 0.1 * mbd.sin(mbd.t)
            driver = mbd.Driver(f"driver {len(self.drivers)}", expression, value)
            assert self._is_independent(driver, spare=0)
            self.drivers.append(driver)

    # --- forces ------------------------------------------------------------------------------
    def _forces(self) -> list:
        rng, forces = self.rng, []
        if rng.random() < 0.8:
            forces.append(mbd.Gravity())
        for k in range(int(rng.integers(0, 5))):
            kind = str(rng.choice(list(FORCES)))
            force = FORCES[kind](self, f"{kind} {k}", *self._two_bodies())
            if force is not None:
                forces.append(force)
        return forces

    def use(self, symbol):
        self.uses.add(symbol)
        if symbol is self.state:
            self.uses.add(self.input)
        return symbol


def _revolute(make: _Builder, name: str, a: Body, b: Body):
    point = make.rng.uniform(-1.5, 1.5, 2)
    return mbd.Revolute(name, make.marker(a, point), make.marker(b, point))


def _weld(make: _Builder, name: str, a: Body, b: Body):
    point, direction = make.rng.uniform(-1.5, 1.5, 2), make.rng.uniform(-3, 3)
    return mbd.Weld(name, make.marker(a, point, direction), make.marker(b, point, direction))


def _translational(make: _Builder, name: str, a: Body, b: Body):
    point, direction = make.rng.uniform(-1.5, 1.5, 2), make.rng.uniform(-3, 3)
    along = make.rng.uniform(-0.8, 0.8) * np.array([np.cos(direction), np.sin(direction)])
    return mbd.Translational(name, make.marker(a, point, direction), make.marker(b, point + along, direction))


def _distance(make: _Builder, name: str, a: Body, b: Body):
    first, second = make.free_marker(a), make.free_marker(b)
    length = make.at_truth(mbd.distance(first, second))
    if length < 0.2:
        return None
    if make.rng.random() < 0.3:
        return mbd.Distance(name, first, second, make.use(make.length) + (length - 0.3))
    return mbd.Distance(name, first, second, make.wiggle(length))


def _point_on_line(make: _Builder, name: str, a: Body, b: Body):
    line, point = make.free_marker(a), make.free_marker(b)
    offset = make.at_truth(ca.dot(line.y_axis, point.position - line.position))
    return mbd.PointOnLine(name, line, point, make.wiggle(offset))


def _rack(make: _Builder, name: str, a: Body, b: Body):
    return mbd.RackAndPinion(name, make.free_marker(a), make.free_marker(b), make.rng.uniform(0.1, 0.5))


def _absolute(kind: type, coordinate: Callable) -> Callable:
    def make_it(make: _Builder, name: str, a: Body, b: Body):
        marker = make.free_marker(a if b.is_ground else b)
        return kind(name, marker, make.wiggle(make.at_truth(coordinate(marker))))

    return make_it


def _absolute_distance(make: _Builder, name: str, a: Body, b: Body):
    marker, point = make.free_marker(a if b.is_ground else b), make.rng.uniform(-2, 2, 2)
    length = make.at_truth(mbd.distance(marker, point))
    return mbd.AbsoluteDistance(name, marker, point, make.wiggle(length)) if length > 0.2 else None


def _relative(kind: type, coordinate: Callable) -> Callable:
    def make_it(make: _Builder, name: str, a: Body, b: Body):
        first, second = make.free_marker(a), make.free_marker(b)
        return kind(name, first, second, make.wiggle(make.at_truth(coordinate(second) - coordinate(first))))

    return make_it


def _constraint(make: _Builder, name: str, a: Body, b: Body):
    first, second = make.free_marker(a), make.free_marker(b)
    expression = first.x * mbd.cos(second.angle) + 0.5 * second.y**2 - first.angle + 0.2 * mbd.sin(mbd.t)
    return mbd.Constraint(name, expression - make.at_truth(expression))


def _force(frame: str) -> Callable:
    def make_it(make: _Builder, name: str, a: Body, b: Body):
        at = make.free_marker(b if a.is_ground else a)
        vector = [make.rng.normal(), make.rng.normal() * mbd.cos(mbd.t) - 0.5 * at.vx]
        opposite = b if at.body is a and make.rng.random() < 0.6 else None
        return mbd.Force(name, at, vector, frame=frame, opposite=opposite)

    return make_it


def _torque(make: _Builder, name: str, a: Body, b: Body):
    return mbd.Torque(name, a, make.use(make.input) * 0.3 + make.rng.normal(), opposite=b)


def _actuator(make: _Builder, name: str, a: Body, b: Body):
    return mbd.Torque(name, a, 2.0 * make.use(make.state), opposite=b)


def _tsda(make: _Builder, name: str, a: Body, b: Body):
    first, second = make.free_marker(a), make.free_marker(b)
    length = make.at_truth(mbd.distance(first, second))
    if length < 0.4:
        return None
    stiffness = 20 * make.use(make.length) if make.rng.random() < 0.4 else make.rng.uniform(1, 20)
    free, damping = make.rng.uniform(0.1, 1.0), make.rng.uniform(0, 2)
    return mbd.TSDA(name, first, second, stiffness=stiffness, free_length=free, damping=damping, actuator=0.3)


def _rsda(make: _Builder, name: str, a: Body, b: Body):
    stiffness, free, damping = make.rng.uniform(0.1, 5), make.rng.uniform(-1, 1), make.rng.uniform(0, 1)
    first, second = make.free_marker(a), make.free_marker(b)
    return mbd.RSDA(name, first, second, stiffness=stiffness, free_angle=free, damping=damping)


def _generalized(make: _Builder, name: str, a: Body, b: Body):
    first, second = make.free_marker(a), make.free_marker(b)
    pairs = [(first.x * second.y, 0.4 + mbd.t), (first.angle - 2 * second.angle, -0.1 * (first.vy + second.vx))]
    return mbd.GeneralizedForce(name, pairs)


#: Weight in the draw, and how it is made.
JOINTS: dict[str, tuple[float, Callable]] = {
    "Revolute": (5, _revolute),
    "Translational": (3, _translational),
    "Weld": (0.7, _weld),
    "Distance": (2, _distance),
    "PointOnLine": (2, _point_on_line),
    "RackAndPinion": (4, _rack),
    "AbsoluteX": (0.7, _absolute(mbd.AbsoluteX, lambda m: m.x)),
    "AbsoluteY": (0.7, _absolute(mbd.AbsoluteY, lambda m: m.y)),
    "AbsoluteAngle": (0.7, _absolute(mbd.AbsoluteAngle, lambda m: m.angle)),
    "AbsoluteDistance": (0.7, _absolute_distance),
    "RelativeX": (0.7, _relative(mbd.RelativeX, lambda m: m.x)),
    "RelativeY": (0.7, _relative(mbd.RelativeY, lambda m: m.y)),
    "RelativeAngle": (0.7, _relative(mbd.RelativeAngle, lambda m: m.angle)),
    "Constraint": (0.7, _constraint),
}

FORCES: dict[str, Callable] = {
    "Force": _force("global"),
    "body Force": _force("body"),
    "Torque": _torque,
    "actuator": _actuator,
    "TSDA": _tsda,
    "RSDA": _rsda,
    "GeneralizedForce": _generalized,
}
