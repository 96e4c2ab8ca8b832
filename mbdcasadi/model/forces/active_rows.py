"""Rows of an element that hold in one of its modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..element import ConstraintElement, Element


class ActiveRows(ConstraintElement):
    """Some rows of an element, with multipliers that are the element's own, and forces that depend on these.

    Parameters
    ----------
    whole : Element
        The element.
    rows, velocity_rows : casadi.SX
        The rows at the level of positions, and at that of velocities (k,).
    chosen : sequence of int
        Multipliers of the element that belong to them, in this order.
    virtual_work : sequence of pairs, optional
        Work of its forces; shares of the multipliers in it are such of the impulses in an impact, too.
    """

    def __init__(
        self,
        whole: Any,
        *,
        rows: ca.SX,
        velocity_rows: ca.SX,
        chosen: Sequence[int],
        virtual_work: Sequence[tuple[ca.SX, ca.SX]] = (),
    ):
        Element.__init__(self, whole.name)
        self._whole = whole
        self.markers, self.limits, self.virtual_work = whole.markers, whole.limits, tuple(virtual_work)
        self.rows, self.velocity_rows = ca.vec(rows), ca.vec(velocity_rows)
        self.refuse_beyond_coordinates(self.rows)
        self.multipliers = whole.multipliers[list(chosen)]
        names = whole.row_names
        self._row_names = tuple(names[k] for k in chosen)

    @property
    def description(self) -> str:
        return str(self._whole.description)

    @property
    def row_names(self) -> tuple[str, ...]:
        return self._row_names


class HeldRows(ConstraintElement):
    """An element whose rows of velocities hold where it was at a pose: ``∫ S(q) dq = 0`` straight from there.

    What slides along a coordinate, and a place that sticks to something straight, is held exactly; a wheel that rolls
    far on something round turns nearly as it would.

    Parameters
    ----------
    part : Element
        Element with rows ``S(q) v`` of velocities.
    q, v : casadi.SX
        Coordinates and velocities of the mechanism (n,).
    pose : numpy.ndarray
        The pose (n,).
    """

    def __init__(self, part: Any, q: ca.SX, v: ca.SX, pose: np.ndarray):
        Element.__init__(self, part.name)
        self._part = part
        self.markers, self.limits, self.virtual_work = part.markers, part.limits, part.virtual_work
        slopes, way = ca.jacobian(part.velocity_rows, v), q - ca.DM(pose)
        # five points are exact up to the ninth power of the way: to rounding for turns of less than a radian
        nodes = zip(*np.polynomial.legendre.leggauss(5), strict=True)
        slid = sum((w / 2 * ca.substitute(slopes, q, pose + (1 + s) / 2 * way) for s, w in nodes), ca.SX(0)) @ way
        self.rows = ca.vertcat(part.rows, slid)
        self.multipliers = part.multipliers

    @property
    def description(self) -> str:
        return str(self._part.description)

    @property
    def row_names(self) -> tuple[str, ...]:
        return tuple(self._part.row_names)
