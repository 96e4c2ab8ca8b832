"""Cables that do not stretch, over pulleys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import BEYOND_COORDINATES, ConstraintElement, Element, refuse_kinds
from ..forces.friction.laws import Resistance
from ..joints.base import from_estimate
from ..rates import time_derivative
from ..switching import Switching
from ..symbols import Scalar, check_name
from ..validity import Smoothing, ValidityCondition
from .path import RopePath
from .pulleys import Drum, Pulley


class Cable(Switching, ConstraintElement):
    """Rope that does not stretch, over any number of pulleys: ``Phi_k = l_k - L_k`` (1 row for each section, m).

    A section reaches from an end, or a pulley that grips, to the next one; ``l_k`` is the sum of its strands, of
    its wraps, and of what has wound up at its ends. Its multiplier is the tension. Each strand pulls the bodies at its
    ends, so that bearings carry it. A cable has no mass, and a run warns if it would have to push. A strand may turn by
    up to 135° from its direction at the estimated poses, relative to ``carrier=`` of the drum or pulley on which it
    winds up; bodies turn by any angle.

    If it rubs on a pulley, the tensions before and after differ by at most
    ``|T_2 - T_1| <= (T_1 + T_2) tanh(μ θ/2)`` with the angle θ of the wrap: if it slips, ``T_2/T_1 = exp(±μ θ)``.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker or Drum
        Its ends.
    over : sequence of Pulley, optional
        What it runs over, on the way from `a` to `b`. It may rub on one of them.
    length : float or expression in time and parameters, optional
        Length of strands and wraps together at the estimated poses, m, also on pulleys that grip, without what is on
        drums there; by default what it is there. Sections share what is not on pulleys that grip as their lengths at
        these poses are.

    Attributes
    ----------
    tensions : casadi.SX
        Tension of each strand, from `a` to `b`, N.
    path : RopePath
        Its strands, wraps and sections.
    sliding_speed, friction_force : casadi.SX
        Speed at which it slips over the pulley on which it rubs, towards `a`, m/s; tension after that pulley less
        that before it, N.

    Raises
    ------
    ModelError
        For what is no marker, drum or pulley, ends inside pulleys, and friction on more than one pulley.

    See Also
    --------
    Rope : elastic, and slack instead of pushing.

    References
    ----------
    Euler, "Remarques sur l'effet du frottement dans l'équilibre", Mém. Acad. Berlin 18 (1762) 265.

    Examples
    --------
    Atwood's machine, whose wheel has inertia::

        wheel = mbd.Pulley(disc.at(0, 0), 0.1, turn="clockwise", grips=True)
        cable = mbd.Cable("cable", left.at(0, 0), right.at(0, 0), over=[wheel])
    """

    kind = "cable"

    def __init__(
        self,
        name: str,
        a: Marker | Drum,
        b: Marker | Drum,
        over: Sequence[Pulley] = (),
        length: Scalar | None = None,
    ):
        self.name = check_name(name, type(self).__name__)
        what = self.description
        self.path = path = RopePath(what, a, b, over)
        self.length = None if length is None else self.read(length, "length", above=0.0)
        if length is not None:
            refuse_kinds(self.length, ("position", *BEYOND_COORDINATES), what, "its length depends on time only")
        rubbing = [k for k, pulley in path.pulleys if pulley.friction is not None]
        if len(rubbing) > 1:
            raise ModelError(
                f"{what} rubs on {len(rubbing)} pulleys, and may on one; let it grip or run freely on others"
            )
        self._post = rubbing[0] if rubbing else None
        if length is None:
            rows = ca.vertcat(*[from_estimate(section) for section in path.sections])
        else:
            shares, between = zip(path.sections, path.shares(), strict=True), self.length - path.gripped
            rows = ca.vertcat(*[section - between * share for section, share in shares])
        rows *= path.known
        labels = tuple(f"section {k}" for k in range(rows.numel())) if rows.numel() > 1 else ()
        self.switches_modes = self._law is not None and self._law.exact
        slip = None
        if self.switches_modes:
            slip, labels = self.sliding_speed, (*(labels or ("length",)), "slip")
        super().__init__(name, rows, labels, path.markers, velocity_rows=slip)
        self.validity_conditions = (*path.validity_conditions(), *self._pulls())
        self.limits = (*self.limits, *path.limits)
        if self._law is not None:
            self.limits, self.resolved_laws = (*self.limits, *self._law.limits), (self._law,)
            if not self.switches_modes:
                self.rates: Mapping[Any, ca.SX] = self._resistance.rates
                self.virtual_work = ((self._slip, self.friction_force),)

    def _pulls(self) -> tuple[ValidityCondition, ...]:
        pushes = f"{self.description}: a strand would have to push; a Rope is slack instead"
        return tuple(ValidityCondition(tension, pushes, unit="N") for tension in ca.vertsplit(self.tensions))

    @cached_property
    def tensions(self) -> ca.SX:
        """Tension of each strand, N."""
        by_section = [self.multipliers[k] for k in range(len(self.path.sections))]
        tensions = [by_section[k] for k in self.path.section_of]
        if self._post is not None:
            for strand, section in enumerate(self.path.section_of):
                if section == self._section:
                    tensions[strand] += self.friction_force / 2 * (1 if strand >= self._post else -1)
        return ca.vertcat(*tensions)

    # --- friction on a pulley -----------------------------------------------------------------------
    @property
    def _law(self) -> Any:
        return None if self._post is None else self.path.nodes[self._post].friction

    @property
    def _section(self) -> int:
        """Section that rubs."""
        return self.path.section_of[self._post]  # type: ignore[index]

    @cached_property
    def _slip(self) -> ca.SX:
        """Half of what is longer before the pulley on which it rubs than after it, m."""
        if self._post is None:
            raise ModelError(f"{self.description} rubs on no pulley; give one a friction=")
        strands = [k for k, section in enumerate(self.path.section_of) if section == self._section]
        return (self.path.piece(strands[0], self._post) - self.path.piece(self._post, strands[-1] + 1)) / 2

    @cached_property
    def sliding_speed(self) -> ca.SX:
        """Speed at which it slips over the pulley on which it rubs, towards its first end, m/s."""
        return time_derivative(self._slip)

    def grip(self, coefficient: Any) -> ca.SX:
        """Largest difference of the tensions at the pulley on which it rubs, N, with a coefficient of friction."""
        both = 2 * ca.fabs(self.multipliers[self._section])
        return both * ca.tanh(coefficient * self.path.wraps[self._post] / 2)  # type: ignore[index]

    @cached_property
    def _resistance(self) -> Resistance:
        """Friction by a smoothed law, whose part for each newton of load is a coefficient of friction."""
        load = ca.SX.sym("load")
        unit = self._law.resistance(self.name, self.sliding_speed, load)
        if not ca.substitute(unit.force, load, 0).is_zero() or ca.depends_on(ca.gradient(unit.force, load), load):
            raise ModelError(f"{self.description}: {self._law!r} is not proportional to the load of the pulley")
        coefficient = ca.substitute(unit.force, load, 1)
        return Resistance(self.grip(coefficient), unit.rates, unit.smoothed)

    @cached_property
    def friction_force(self) -> ca.SX:
        """Tension after the pulley on which it rubs less that before it, N."""
        _ = self._slip  # without friction there is none
        return -self.multipliers[-1] if self.switches_modes else self._resistance.force

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the smoothed sign of the friction."""
        smoothed = () if self._law is None or self.switches_modes else self._resistance.smoothed
        return tuple(Smoothing(s, 2.0, "its change of direction", self._law.remedy) for s in smoothed)

    # --- exact friction ----------------------------------------------------------------------------
    @property
    def sticking_limit(self) -> ca.SX:
        """Largest friction at rest, N."""
        return self.grip(self._law.static_coefficient)

    @property
    def falls(self) -> bool:
        """True if friction in motion may be below that at rest."""
        return bool(self._law.falls)

    @property
    def sticking_row(self) -> str:
        """Name of the row that is active while it sticks."""
        return f"{self.name}.slip"

    def in_mode(self, mode: str) -> Element:
        """Return the cable in one mode: with a row if it sticks, with a force if it slides or is at its limit."""
        if mode == "sticks":
            return _CableInMode(self, None)
        coefficient = self._law.static_coefficient if mode.startswith("pulled") else self._law.coefficient
        sign = 0 if mode == "free" else 1 if mode.endswith("back") else -1
        return _CableInMode(self, sign * self.grip(coefficient))


class _CableInMode(Element):
    """A cable that sticks on a pulley, or slips with a given friction; its multipliers are those of the cable."""

    kind = "cable"

    def __init__(self, cable: Cable, force: ca.SX | None):
        super().__init__(cable.name)
        self.cable, self.markers, self.limits = cable, cable.markers, cable.limits
        self.rows = cable.rows
        self.multipliers = cable.multipliers if force is None else cable.multipliers[:-1]
        self.row_names = cable.row_names if force is None else cable.row_names[:-1]
        if force is None:
            self.velocity_rows = cable.sliding_speed
        else:
            self.force, self.virtual_work = force, ((cable._slip, force),)

    @property
    def bodies(self) -> tuple[Any, ...]:
        """Bodies on which it acts."""
        return self.cable.bodies
