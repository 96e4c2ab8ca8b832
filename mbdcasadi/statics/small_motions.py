"""Small motions about an equilibrium: ``M ẍ + C ẋ + K x = B z``, ``ż = …``, in the free directions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Imaginary part, relative to the eigenvalue, that is rounding.
TURNING = 1e-7
#: Rounding of an eigenvalue, relative to the largest and its condition number.
EIGENVALUE_TOLERANCE = 1e-14
#: Inertia of a free direction, relative to the largest, below which it has none.
NO_INERTIA = 1e-14


@dataclass(frozen=True)
class SmallMotions:
    """Eigenvalues of the linearised equations of motion.

    Attributes
    ----------
    eigenvalues : numpy.ndarray
        (k,), rad/s, those of :func:`linearize` at the equilibrium; fastest growing first.
    shapes : numpy.ndarray
        Displacement over q that belongs to each (n, k), complex.
    uncertainty : numpy.ndarray
        Rounding of each (k,), rad/s: much if two meet, as at the onset of undamped flutter.
    """

    eigenvalues: np.ndarray
    shapes: np.ndarray
    uncertainty: np.ndarray

    @classmethod
    def of(cls, force: np.ndarray, rate: np.ndarray, basis: np.ndarray) -> SmallMotions:
        """Small motions from the linearised forces and rates.

        Parameters
        ----------
        force : numpy.ndarray
            Force along the free directions (f, 3 f + k) by displacements, velocities and accelerations along them,
            and by first-order states.
        rate : numpy.ndarray
            Rates of the first-order states by the same (k, 3 f + k).
        basis : numpy.ndarray
            Free directions (n, f).
        """
        f, k = force.shape[0], rate.shape[0]
        inertia, states = slice(2 * f, 3 * f), slice(3 * f, 3 * f + k)
        place = [*range(2 * f), *range(states.start, states.stop)]
        size = 2 * f + k
        right, left = np.zeros((size, size)), np.eye(size)
        right[:f, f : 2 * f] = np.eye(f)
        right[f : 2 * f], right[2 * f :] = force[:, place], rate[:, place]
        left[f : 2 * f, f : 2 * f] = -force[:, inertia]
        left[2 * f :, f : 2 * f] = -rate[:, inertia]
        values, vectors, uncertainty = _eigen(right, left, f)
        order = np.argsort(-values.real, kind="stable")
        return cls(values[order], basis @ vectors[:f, order], uncertainty[order])

    @property
    def growth(self) -> float:
        """Largest growth rate, 1/s; negative if all small motions decay."""
        return float(np.max(self.eigenvalues.real, initial=-np.inf))

    @property
    def _growing(self) -> np.ndarray:
        return self.eigenvalues.real > self.uncertainty

    @property
    def _turning(self) -> np.ndarray:
        return np.abs(self.eigenvalues.imag) > TURNING * np.abs(self.eigenvalues)

    @property
    def grow(self) -> bool:
        """True if a small motion grows."""
        return bool(np.any(self._growing))

    @property
    def flutter(self) -> bool:
        """True if an oscillation grows."""
        return bool(np.any(self._growing & self._turning))

    @property
    def fastest_growing(self) -> np.ndarray:
        """Displacement over q of the oscillation that grows fastest (n,): its real part at its largest."""
        turning = np.flatnonzero(self._turning)
        shape = self.shapes[:, turning[0] if turning.size else 0]
        largest = shape[np.argmax(np.abs(shape))]
        return np.real(shape / largest)


def _eigen(right: np.ndarray, left: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Finite eigenvalues of ``right y = s left y``, their vectors, and how uncertain the values are.

    The first `count` unknowns are displacements, whose rates follow. What has no inertia follows without delay.
    """
    if not right.size:
        return np.zeros(0, complex), np.zeros((0, 0), complex), np.zeros(0)
    inertia = np.linalg.svd(left, compute_uv=False)
    if inertia[-1] <= NO_INERTIA * inertia[0]:
        from scipy.linalg import eig

        (above, below), vectors = eig(right, left, homogeneous_eigvals=True)
        finite = np.abs(below) > NO_INERTIA * np.abs(above)
        values = above[finite] / below[finite]
        return values, vectors[:, finite], np.full(values.size, 1e-7) * np.abs(values)
    matrix = np.linalg.solve(left, right)
    # displacements count by the velocities that they have at the fastest frequency
    speed = float(np.max(np.abs(np.linalg.eigvals(matrix)))) or 1.0
    unit = np.where(np.arange(len(matrix)) < count, speed, 1.0)
    values, vectors = np.linalg.eig(matrix * unit[:, None] / unit)
    # the left eigenvectors, also if two of the right ones are all but the same
    rows = np.linalg.pinv(vectors, rcond=1e-15)
    condition = np.linalg.norm(rows, axis=1) * np.linalg.norm(vectors, axis=0)
    shapes = vectors * np.where(np.arange(len(matrix)) < count, 1.0, speed)[:, None]
    return values.astype(complex), shapes.astype(complex), EIGENVALUE_TOLERANCE * speed * condition
