"""The closed curve of poses on which a linkage of one degree of freedom moves."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import minimize_scalar

from ..equations import equations
from ..equations.reduced import reduced_equations
from ..model.bodies import Body
from ..model.joints.lower_pairs import Revolute
from ..model.mechanism import Mechanism
from ..numerics.evaluation import Evaluator
from ..numerics.solution_curve import CORRECTION, SolutionCurve, closed_curve
from ..numerics.symbolic import symbolic

#: Turn of a body over a circuit, less than a whole one by rounding, rad.
WHOLE = 2 * np.pi - 1e-6
#: Distance of places on a circuit that are the same but for rounding, in points of its curve.
SAME_PLACE = 1e-6
#: Newton steps from a chord of the curve to the curve.
CLOSING_STEPS = 4


class Poses:
    """Functions of the poses of a mechanism and the values of its parameters: those that all linkages of a list share.

    Parameters
    ----------
    mechanism : Mechanism
        Without drivers.
    """

    @symbolic
    def __init__(self, mechanism: Mechanism):
        self.mechanism, eom = mechanism, equations(mechanism)
        reduced = reduced_equations(eom)
        self.independent = reduced.independent
        self.turning = np.array([bool(eom.angles[k]) for k in reduced.independent])
        y, p, at_rest = reduced.q, eom.p, ca.SX(0)
        rows, q = (ca.substitute(x, eom.t, at_rest) for x in (reduced.Phi, reduced.of(eom.q)[0]))
        self._rows = Evaluator(ca.Function("rows", [y, p], [ca.densify(rows), ca.densify(ca.jacobian(rows, y))]))
        self._q = Evaluator(ca.Function("coordinates", [y, p], [ca.densify(q)]))
        self.turns = [joint for joint in mechanism.joints if _pinned(joint) is not None]
        angles = ca.vertcat(ca.SX(0, 1), *[_of_pinned(joint) for joint in self.turns])
        points = ca.SX(0, 1)
        self.couplers = [self._coupler(joint) for joint in self.turns]
        for chain in self.couplers:
            if chain is not None:
                points = ca.vertcat(points, *[pin.a.position for pin in chain])
        angles, points = (ca.substitute(x, eom.t, at_rest) for x in reduced.of(angles, points))
        self._angles = Evaluator(ca.Function("angles", [y, p], [ca.densify(angles), ca.densify(points)]))

    def rows(self, y: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows that close the linkage, and their slopes."""
        rows, slopes = self._rows(y, p)
        return rows.ravel(), slopes

    def coordinates(self, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """All coordinates (k, n) of poses (k, m)."""
        return self._q.rows(y, p)[0]

    def angles(self, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Angles of the bodies that are pinned to the ground (k, pins) at poses (k, m)."""
        return self._angles.rows(y, p)[0]

    def transmission(self, pin: int, y: np.ndarray, p: np.ndarray) -> np.ndarray | None:
        """Angles between coupler and follower of a crank (k,), up to a right one, rad; None without these."""
        if self.couplers[pin] is None:
            return None
        first = 6 * sum(chain is not None for chain in self.couplers[:pin])
        crank, joint, ground = self._angles.rows(y, p)[1][:, first : first + 6].reshape(-1, 3, 2).transpose(1, 0, 2)
        along, across = crank - joint, ground - joint
        turned = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
        return np.arctan2(np.abs(turned), np.abs(np.sum(along * across, axis=1)))

    def _coupler(self, pin: Revolute) -> tuple[Revolute, Revolute, Revolute] | None:
        """Pins of a coupler with crank and follower, and of that with the ground; None if there are several."""
        crank, pins = _pinned(pin), [joint for joint in self.mechanism.joints if isinstance(joint, Revolute)]
        chains = []
        for first in pins:
            coupler = _other(first, crank)
            if coupler is None or coupler.is_ground:
                continue
            for second in pins:
                follower = _other(second, coupler)
                if second is first or follower is None or follower.is_ground or follower is crank:
                    continue
                chains += [(first, second, x) for x in self.turns if x is not pin and _pinned(x) is follower]
        return chains[0] if len(chains) == 1 else None


@dataclass(frozen=True, eq=False)
class Circuit:
    """The circuit through a pose, and the places of others on it.

    Attributes
    ----------
    curve : SolutionCurve
        Its points.
    places : numpy.ndarray
        Numbers of the points before the poses, with the share of the way to the next (k,); NaN of one that is not on it
    """

    curve: SolutionCurve
    places: np.ndarray

    @property
    def in_order(self) -> bool:
        """True if all poses are passed in their order, one way or the other, in one round."""
        if np.isnan(self.places).any():
            return False
        return min(self._way(1), self._way(-1)) <= len(self.curve.points) + SAME_PLACE

    @property
    def sense(self) -> int:
        """1 if poses are passed in their order along the curve, -1 if against it."""
        return 1 if self._way(1) <= self._way(-1) else -1

    def _way(self, sense: int) -> float:
        """Points of the curve that are passed from the first pose over the others to the last one."""
        count = len(self.curve.points)
        gaps = sense * np.diff(self.places) % count
        return float(np.sum(np.where(gaps > count - SAME_PLACE, 0.0, gaps)))

    def least_transmission(self, poses: Poses, pin: int, p: np.ndarray) -> float | None:
        """Least angle between coupler and follower of a crank, between the points of the curve too, rad."""
        points, period = self.curve.points, self.curve.period
        angles = poses.transmission(pin, points, p)
        if angles is None:
            return None
        least = int(np.argmin(angles))
        near = np.vstack([points[-1:] - period, points, points[:1] + period])[least : least + 3]

        def angle(place: float) -> float:
            y = np.array([np.interp(place, (-1, 0, 1), column) for column in near.T])
            for _ in range(CLOSING_STEPS):
                rows, slopes = poses.rows(y, p)
                y = y - np.linalg.lstsq(slopes, rows, rcond=None)[0]
            found = poses.transmission(pin, y[None], p)
            assert found is not None
            return float(found[0])

        return float(minimize_scalar(angle, bounds=(-1, 1), method="bounded", options={"xatol": SAME_PLACE}).fun)


def circuit_through(poses: Poses, y: np.ndarray, p: np.ndarray, sizes: np.ndarray) -> Circuit | None:
    """The circuit through the first of some poses (k, m); None if it is singular somewhere, or no closed curve."""
    curve = closed_curve(lambda x: poses.rows(x, p), y[0], sizes, poses.turning)
    return None if curve is None else Circuit(curve, np.array([_place(curve, one, sizes, poses.turning) for one in y]))


def _place(curve: SolutionCurve, pose: np.ndarray, sizes: np.ndarray, turning: np.ndarray) -> float:
    """Place of a pose on a curve; NaN if it is not on it."""
    points = np.vstack([curve.points, curve.points[:1] + curve.period]) / sizes
    steps = np.diff(points, axis=0)
    apart = pose / sizes - points[:-1]
    turn = 2 * np.pi / sizes
    apart = np.where(turning, apart - turn * np.round(apart / turn), apart)
    lengths = np.linalg.norm(steps, axis=1)
    shares = np.sum(apart * steps, axis=1) / lengths**2
    aside = np.linalg.norm(apart - np.clip(shares, 0, 1)[:, None] * steps, axis=1)
    nearest = int(np.argmin(aside / lengths))
    return nearest + float(np.clip(shares[nearest], 0, 1)) if aside[nearest] < CORRECTION * lengths[nearest] else np.nan


def turning_pins(poses: Poses, circuit: Circuit, p: np.ndarray) -> list[int]:
    """Numbers of the pins on the ground whose bodies turn fully, and always one way."""
    points = np.vstack([circuit.curve.points, circuit.curve.points[:1] + circuit.curve.period])
    angles = poses.angles(points, p)
    change = np.diff(angles, axis=0)
    one_way = np.all(change > 0, axis=0) | np.all(change < 0, axis=0)
    return np.flatnonzero(one_way & (np.abs(angles[-1] - angles[0]) > WHOLE)).tolist()


def _pinned(joint: object) -> Body | None:
    """The body that a pin holds on the ground; None for other joints."""
    if not isinstance(joint, Revolute) or not (joint.a.body.is_ground or joint.b.body.is_ground):
        return None
    return joint.b.body if joint.a.body.is_ground else joint.a.body


def _of_pinned(joint: Revolute) -> ca.SX:
    """Angle of the body that a pin holds on the ground."""
    return joint.b.body.phi if joint.a.body.is_ground else joint.a.body.phi


def _other(joint: Revolute, body: Body | None) -> Body | None:
    """The body that a pin joins with another one; None if that is not one of its two."""
    if joint.a.body is body:
        return joint.b.body
    return joint.a.body if joint.b.body is body else None
