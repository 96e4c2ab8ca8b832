"""Elements whose equations switch exactly: something sticks or slides, is engaged or free."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca

if TYPE_CHECKING:
    from .element import Element


class Switching:
    """What ``simulate`` needs of an element with exact modes: it sticks, or slides forth or back.

    While it sticks, a row of velocities holds its sliding speed at zero; the multiplier of that row is positive if it
    is pulled forth. In each mode another element takes its place, by :meth:`in_mode`.

    Attributes
    ----------
    switches_modes : bool
        True if it has exact modes.
    sliding_speed : casadi.SX
        Speed that is zero while it sticks, m/s or rad/s.
    """

    switches_modes: bool = False
    #: what takes its place in analyses that do not follow its modes
    instead: str = "take Coulomb, Stribeck or LuGre"
    #: mode in which it does not act
    free_mode: Any = "free"
    #: units of its sliding speed, and of the force or couple that holds it
    units: tuple[str, str] = ("m/s", "N")
    name: str
    sliding_speed: ca.SX

    @property
    def frictions(self) -> tuple[Any, ...]:
        """What sticks and slides, each by itself: the element, or its places, by which its mode is a tuple."""
        return (self,)

    def sliding_force(self, mode: Any) -> ca.SX:
        """Force in a mode of the element in which it does not stick, N or N m."""
        return self.in_mode(mode).force  # type: ignore[attr-defined]

    @property
    def exactness(self) -> str:
        """What an analysis that cannot follow its modes says of it."""
        return f"switches exactly between sticking and sliding, which this analysis cannot follow; {self.instead} here"

    @property
    def sticking_limit(self) -> Any:
        """Largest force (N) or couple (N m) at rest."""
        raise NotImplementedError

    @property
    def limits_of_pull(self) -> tuple[Any, Any]:
        """Largest multipliers with which it sticks, when it is pulled forth and back; ``inf`` if it always holds."""
        return self.sticking_limit, self.sticking_limit

    @property
    def falls(self) -> bool:
        """True if the force in motion may be below that at rest."""
        return False

    @property
    def sticking_row(self) -> str:
        """Name of the row that is active while it sticks."""
        return self.name

    @property
    def event_names(self) -> tuple[str, str]:
        """Names of the events at which it begins to stick, and to slide."""
        return f"{self.name} stops", f"{self.name} breaks away"

    def in_mode(self, mode: str) -> Element:
        """Return the element in one mode.

        Parameters
        ----------
        mode : {"sticks", "forth", "back", "free", "pulled forth", "pulled back"}
            A row if it sticks, a force if it slides or is at its limit at rest, nothing if it is free.
        """
        raise NotImplementedError
