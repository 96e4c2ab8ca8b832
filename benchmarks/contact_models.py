"""Bouncing balls and a stick–slip belt: numbers and exact solutions, without any package for multibody dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

G = 9.81


@dataclass(frozen=True)
class Balls:
    """Balls of equal mass that fall onto an elastic floor, ``F = k δ``, and bounce for ever.

    Attributes
    ----------
    heights : tuple of float
        Of the lowest points at the start, m.
    mass, stiffness, radius : float
        kg, N/m, m.
    duration : float
        s.
    outputs : int
        Intervals of the output grid.
    goal : float
        Error that is asked for, m.
    """

    heights: tuple[float, ...] = (0.4, 0.5, 0.6, 0.7, 0.8)
    mass: float = 0.6
    stiffness: float = 1.0e5
    radius: float = 0.1
    duration: float = 5.0
    outputs: int = 500
    goal: float = 1e-3
    title: str = "bouncing balls"

    @property
    def times(self) -> np.ndarray:
        """Output grid, s."""
        return np.linspace(0, self.duration, self.outputs + 1)

    def exact(self, weight_in_contact: bool = True) -> np.ndarray:
        """Heights of the lowest points (n_t, n).

        MuJoCo's contact sets the acceleration: its spring carries the weight besides
        (``weight_in_contact=False``), so that it is compared with another exact solution.
        """
        return np.column_stack([self._bounces(h, G if weight_in_contact else 0.0) for h in self.heights])

    def _bounces(self, height: float, weight: float) -> np.ndarray:
        """Flight from the top and contact in turn, each known in closed form."""
        frequency = np.sqrt(self.stiffness / self.mass)
        fall = np.sqrt(2 * height / G)
        speed, sag = G * fall, weight / frequency**2
        # in contact y = -sag + sag cos ωτ - (v/ω) sin ωτ, until it is zero again
        touch = 2 * (np.pi - np.arctan2(speed / frequency, sag)) / frequency
        period = 2 * fall + touch
        phase = np.mod(self.times + fall + touch, period)  # from the start of a contact on
        contact = sag * (np.cos(frequency * phase) - 1) - speed / frequency * np.sin(frequency * phase)
        since = phase - touch - fall
        return np.where(phase < touch, contact, height - G * since**2 / 2)


@dataclass(frozen=True)
class Belt:
    """A block on a running belt, held by a spring: it sticks up to ``μ_s m g`` and slides under ``μ m g``.

    Attributes
    ----------
    mass, stiffness, speed : float
        kg, N/m, m/s.
    sliding, static : float
        Coefficients.
    duration : float
        s.
    outputs : int
        Intervals of the output grid.
    goal : float
        Error that is asked for, m.
    """

    mass: float = 1.2
    stiffness: float = 150.0
    speed: float = 0.08
    sliding: float = 0.25
    static: float = 0.4
    duration: float = 5.0
    outputs: int = 500
    goal: float = 1e-4
    title: str = "stick–slip belt"

    @property
    def times(self) -> np.ndarray:
        """Output grid, s."""
        return np.linspace(0, self.duration, self.outputs + 1)

    def exact(self) -> np.ndarray:
        """Places of the block (n_t, 1) from the first stretch of sticking on, which starts at 0."""
        frequency = np.sqrt(self.stiffness / self.mass)
        middle = self.sliding * self.mass * G / self.stiffness
        excess = (self.static - self.sliding) * self.mass * G / self.stiffness
        slip = (2 * np.pi - 2 * np.arctan(excess * frequency / self.speed)) / frequency
        period = slip + 2 * excess / self.speed
        first = (middle + excess) / self.speed
        phase = np.mod(self.times - first, period)
        slides = middle + excess * np.cos(frequency * phase) + self.speed / frequency * np.sin(frequency * phase)
        sticks = middle - excess + self.speed * (phase - slip)
        later = np.where(phase < slip, slides, sticks)
        return np.where(self.times < first, self.speed * self.times, later)[:, None]


MODELS = {"balls": Balls(), "belt": Belt()}
