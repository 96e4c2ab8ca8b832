"""What friction laws share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...immutable import Immutable
from ...quantities import Limit, known_value


@dataclass(frozen=True, eq=False)
class Resistance:
    """What a law exerts at one place.

    Attributes
    ----------
    force : casadi.SX
        Force along the sliding speed, N: against it, so that a passive law has ``force · speed <= 0``.
    rates : dict of StateVariable to casadi.SX
        Rates of the bristles' deflections, where the law has them.
    smoothed : tuple of casadi.SX
        Quantities from -1 to 1 that change fast where the law is smoothed; a run tells where its steps jump over them.
    """

    force: ca.SX
    rates: Mapping[Any, ca.SX] = field(default_factory=dict)
    smoothed: tuple[ca.SX, ...] = ()


class FrictionLaw(Immutable):
    """Base class of friction laws: the force over sliding speed and load.

    Laws add up: ``Coulomb(0.2, 1e-3) + Viscous(5)``.

    Attributes
    ----------
    velocity_tolerance : float, expression or None
        Speed over which the jump at zero is spread, m/s; None where there is none.
    deflection_tolerance : float, expression or None
        Way over which bristles bend before they slide, m; None where there are none.
    limits : tuple of Limit
        What its quantities must keep to.
    exact : bool
        Whether it sticks exactly, by switching.
    """

    velocity_tolerance: Any = None
    deflection_tolerance: Any = None
    limits: tuple[Limit, ...] = ()
    exact: bool = False
    #: what to do where a run does not resolve the law
    remedy: str = "or widen velocity_tolerance"

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force at a sliding speed (m/s) under a load (N, not negative).

        Parameters
        ----------
        name : str
            Of the element, for what the law brings along of its own.
        """
        raise NotImplementedError

    def __add__(self, other: Any) -> FrictionLaw:
        if not isinstance(other, FrictionLaw):
            return NotImplemented
        return SumOfLaws(self, other)


class SumOfLaws(FrictionLaw):
    """Two laws that act together."""

    def __init__(self, first: FrictionLaw, second: FrictionLaw):
        for law in (first, second):
            if law.exact:
                raise ModelError(f"{law!r} switches between sticking and sliding and cannot be added to another law")
        self.parts = (first, second)
        self.limits = (*first.limits, *second.limits)
        for name in ("velocity_tolerance", "deflection_tolerance"):
            widths = [getattr(law, name) for law in self.parts if getattr(law, name) is not None]
            setattr(self, name, min(widths, key=_size, default=None))

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Sum of both."""
        first, second = (part.resistance(f"{name}.{k}", speed, load) for k, part in enumerate(self.parts))
        rates = {**first.rates, **second.rates}
        return Resistance(first.force + second.force, rates, (*first.smoothed, *second.smoothed))

    def __repr__(self) -> str:
        return " + ".join(repr(part) for part in self.parts)


def _size(value: Any) -> float:
    known = known_value(value)
    return float("inf") if known is None else known


def as_law(law: Any, what: str) -> FrictionLaw:
    """Check a friction law."""
    if not isinstance(law, FrictionLaw):
        raise ModelError(f"{what}: law must be a friction law as Coulomb, Stribeck, LuGre or Viscous, got {law!r}")
    return law
