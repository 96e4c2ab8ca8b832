"""Masses of the geoms of MJCF, which are homogeneous solids."""

from __future__ import annotations

import numpy as np

from .markup import XmlElement
from .mjcf_format import MESH_ADVICE

#: Numbers of size that a solid needs.
NEEDED = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}


def size_along(kind: str, size: np.ndarray, half: float) -> np.ndarray:
    """Return the size of a solid between two points, of which the file gives the first number."""
    return np.r_[size[:1], size[:1], half] if kind in ("box", "ellipsoid") else np.r_[size[:1], half]


def solid(element: XmlElement, kind: str, size: np.ndarray) -> tuple[float, np.ndarray]:
    """Volume of a solid, and its moments of inertia by its mass in its own axes."""
    if kind not in NEEDED:
        raise element.refuse(f"is of the type '{kind}', whose mass is not computed; {MESH_ADVICE}")
    if size.size < NEEDED[kind] or np.any(size[: NEEDED[kind]] <= 0):
        raise element.refuse(f"needs {NEEDED[kind]} positive numbers in size, as a {kind}")
    if kind == "sphere":
        r = size[0]
        return 4 / 3 * np.pi * r**3, np.full(3, 0.4 * r**2)
    if kind == "box":
        squares = size[:3] ** 2
        return 8 * float(np.prod(size[:3])), (np.sum(squares) - squares) / 3
    if kind == "ellipsoid":
        squares = size[:3] ** 2
        return 4 / 3 * np.pi * float(np.prod(size[:3])), (np.sum(squares) - squares) / 5
    r, h = size[0], 2 * size[1]
    tube = np.pi * r**2 * h
    tube_moments = np.array([r**2 / 4 + h**2 / 12, r**2 / 4 + h**2 / 12, r**2 / 2])
    if kind == "cylinder":
        return tube, tube_moments
    caps = 4 / 3 * np.pi * r**3
    across = 0.4 * r**2 + h**2 / 4 + 3 / 8 * r * h
    moments = (tube * tube_moments + caps * np.array([across, across, 0.4 * r**2])) / (tube + caps)
    return tube + caps, moments
