"""Cables that do not stretch, over pulleys."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import BEYOND_COORDINATES, ConstraintElement, Element, refuse_kinds
from ..joints.base import from_estimate
from ..switching import Switching
from ..symbols import Scalar, check_name
from ..validity import ValidityCondition
from .path import RopePath
from .pulleys import Drum, Pulley
from .rubbing import CableInMode, Rubbing, differences


class Cable(Switching, ConstraintElement):
    """Rope that does not stretch, over any number of pulleys: ``Phi_k = l_k - L_k`` (1 row for each section, m).

    A section reaches from an end, or a pulley that grips, to the next one; ``l_k`` is the sum of its strands, of
    its wraps, and of what has wound up at its ends. Its multiplier is the tension. Each strand pulls the bodies at its
    ends, so that bearings carry it. A cable has no mass, and a run warns if it would have to push. A strand may turn by
    up to 135° from its direction at the estimated poses, relative to ``carrier=`` of the drum or pulley on which it
    winds up; bodies turn by any angle.

    If it rubs on a pulley, the tensions before and after differ by at most
    ``|T_2 - T_1| <= (T_1 + T_2) tanh(μ θ/2)`` with the angle θ of the wrap: if it slips, ``T_2/T_1 = exp(±μ θ)``. On
    several pulleys each sticks or slips by itself.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker or Drum
        Its ends.
    over : sequence of Pulley, optional
        What it runs over, on the way from `a` to `b`.
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
        Speed at which it slips over each pulley on which it rubs (k,), towards `a`, m/s; tension after that pulley
        less that before it, N.

    Raises
    ------
    ModelError
        For what is no marker, drum or pulley, ends inside pulleys, and a law that is not proportional to the load.

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
        posts = [k for k, pulley in path.pulleys if pulley.friction is not None]
        labels_of_posts = [""] if len(posts) == 1 else [f".{k}" for k in range(len(posts))]
        self.rubbing = tuple(Rubbing(self, *each) for each in zip(posts, labels_of_posts, strict=True))
        if length is None:
            rows = ca.vertcat(*[from_estimate(section) for section in path.sections])
        else:
            shares, between = zip(path.sections, path.shares(), strict=True), self.length - path.gripped
            rows = ca.vertcat(*[section - between * share for section, share in shares])
        rows *= path.known
        labels = tuple(f"section {k}" for k in range(rows.numel())) if rows.numel() > 1 else ()
        self.switches_modes = bool(self.frictions)
        slips = None
        if self.frictions:
            slips = ca.vertcat(*[one.sliding_speed for one in self.frictions])
            own = (one.sticking_row.removeprefix(f"{name}.") for one in self.frictions)
            labels = (*(labels or ("length",)), *own)
        super().__init__(name, rows, labels, path.markers, velocity_rows=slips)
        laws = self.resolved_laws = tuple(one.law for one in self.rubbing)
        self.validity_conditions = (*path.validity_conditions(), *self._pulls())
        self.limits = (*self.limits, *path.limits, *(limit for law in laws for limit in law.limits))
        smoothed = [one for one in self.rubbing if not one.law.exact]
        self.rates: Mapping[Any, ca.SX] = {z: rate for one in smoothed for z, rate in one.resistance.rates.items()}
        self.smoothings = tuple(smoothing for one in smoothed for smoothing in one.smoothings)
        forces = self.differences()
        self.virtual_work = tuple((one.slip, forces[one]) for one in smoothed)

    def _pulls(self) -> tuple[ValidityCondition, ...]:
        pushes = f"{self.description}: a strand would have to push; a Rope is slack instead"
        return tuple(ValidityCondition(tension, pushes, unit="N") for tension in ca.vertsplit(self.tensions))

    @cached_property
    def tensions(self) -> ca.SX:
        """Tension of each strand, N."""
        by_section = [self.multipliers[k] for k in range(len(self.path.sections))]
        tensions = [by_section[k] for k in self.path.section_of]
        for one, difference in self.differences().items():
            for strand, section in enumerate(self.path.section_of):
                if section == one.section:
                    tensions[strand] += difference / 2 * (1 if strand >= one.node else -1)
        return ca.vertcat(*tensions)

    # --- friction on pulleys ------------------------------------------------------------------------
    @cached_property
    def frictions(self) -> tuple[Rubbing, ...]:
        """Pulleys on which it sticks and slides exactly."""
        return tuple(one for one in self.rubbing if one.law.exact)

    def _of_rubbing(self, values: Sequence[ca.SX]) -> ca.SX:
        if not self.rubbing:
            raise ModelError(f"{self.description} rubs on no pulley; give one a friction=")
        return ca.vertcat(*values)

    @cached_property
    def sliding_speed(self) -> ca.SX:
        """Speed at which it slips over each pulley on which it rubs (k,), towards its first end, m/s."""
        return self._of_rubbing([one.sliding_speed for one in self.rubbing])

    @cached_property
    def friction_force(self) -> ca.SX:
        """Tension after each pulley on which it rubs less that before it (k,), N."""
        return self._of_rubbing(list(self.differences().values()))

    def differences(self, mode: Sequence[str] | None = None) -> dict[Rubbing, ca.SX]:
        """Return what each friction adds to the tension, N, in a mode or, without one, by the multipliers."""
        key = None if mode is None else tuple(mode)
        if key not in self._differences:
            senses = dict(zip(self.frictions, key or (), strict=key is not None))
            self._differences[key] = differences(self.rubbing, senses, self.multipliers)
        return self._differences[key]

    @cached_property
    def _differences(self) -> dict[tuple[str, ...] | None, dict[Rubbing, ca.SX]]:
        """The same by mode, made once so that expressions share them."""
        return {}

    @property
    def free_mode(self) -> tuple[str, ...]:
        """Mode in which it rubs on none of the pulleys whose friction is exact."""
        return ("free",) * len(self.frictions)

    def in_mode(self, mode: Sequence[str]) -> Element:
        """Return the cable with a row for each pulley on which it sticks, and a force on each on which it slides."""
        return CableInMode(self, mode)
