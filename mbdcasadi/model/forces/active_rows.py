"""Rows of an element that hold in one of its modes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

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
        Work of its forces.
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
