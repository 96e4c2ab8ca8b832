"""Eight dominoes and thirty discs in a funnel, in numbers: for this package and for its peers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

G = 9.81


@dataclass(frozen=True)
class Dominoes:
    """Blocks in a row on a floor, of which the first is pushed over.

    Attributes
    ----------
    count : int
        Number of blocks.
    height, width, gap : float
        Of a block, and from one to the next, m.
    mass : float
        kg.
    push : float
        Angular velocity of the first one at the start, rad/s.
    stiffness, damping : float
        Of Hunt and Crossley's law with an exponent of 1.5: N/m^1.5, s/m.
    floor_friction, friction, velocity_tolerance : float
        Coefficients on the floor and among each other; m/s.
    duration, compared, goal : float
        s; up to when motions are compared, since later errors grow a thousandfold with every impact, s; error, rad.
    """

    count: int = 8
    height: float = 0.1
    width: float = 0.015
    gap: float = 0.04
    mass: float = 0.02
    push: float = -2.5
    stiffness: float = 1e6
    damping: float = 0.5
    floor_friction: float = 0.5
    friction: float = 0.2
    velocity_tolerance: float = 1e-3
    duration: float = 1.0
    compared: float = 0.3
    outputs: int = 100
    goal: float = 1e-4
    title: str = "eight dominoes"

    @property
    def inertia(self) -> float:
        """kg m²."""
        return self.mass * (self.height**2 + self.width**2) / 12

    @property
    def corners(self) -> list[tuple[float, float]]:
        """From the middle, m."""
        w, h = self.width / 2, self.height / 2
        return [(-w, -h), (w, -h), (w, h), (-w, h)]

    def start(self, k: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Pose and velocity of a block; the first turns about its lower right corner."""
        w, h = self.width / 2, self.height / 2
        pose = (k * self.gap, h, 0.0)
        return pose, (-h * self.push, -w * self.push, self.push) if k == 0 else (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Funnel:
    """Discs that fall into a wedge of two walls.

    Attributes
    ----------
    count : int
        Number of discs.
    radius, mass : float
        m, kg.
    half_angle : float
        Of the walls with the horizontal, rad.
    stiffness, damping, friction, velocity_tolerance : float
        As for the dominoes.
    duration, compared, goal : float
        s; up to when motions are compared, since later errors grow a thousandfold with every impact, s; error, m.
    """

    count: int = 30
    radius: float = 0.05
    mass: float = 0.1
    half_angle: float = np.pi / 4
    stiffness: float = 1e5
    damping: float = 0.5
    friction: float = 0.3
    velocity_tolerance: float = 1e-3
    duration: float = 2.0
    outputs: int = 200
    compared: float = 0.6
    goal: float = 1e-4
    title: str = "thirty discs in a funnel"

    @property
    def inertia(self) -> float:
        """kg m²."""
        return 0.5 * self.mass * self.radius**2

    @property
    def places(self) -> np.ndarray:
        """Middles of the discs at the start (n, 2), m."""
        rng, columns, pitch = np.random.default_rng(0), 6, 2.6 * self.radius
        k = np.arange(self.count)
        x = (k % columns - (columns - 1) / 2) * pitch + rng.uniform(-0.1, 0.1, self.count) * self.radius
        return np.column_stack([x, 0.75 + (k // columns) * pitch])
