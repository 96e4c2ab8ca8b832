"""Places at which a mechanism touches, sticks and slides: its equations and events in one mode, and views of states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...assembly.consistent_start import position_limits
from ...assembly.setup import Setup
from ...equations import equations
from ...equations.impact_law import impulse_response
from ...errors import ModelError, SimulationError
from ...model.events import Event
from ...model.forces.contact.rigid import RigidContact
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.forces.friction.modes import switching, variant_in
from ...model.mechanism import Mechanism
from ...model.rates import time_derivative
from ...model.sites import WHAT, sites_of
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest, least_norm
from ...numerics.tolerances import NEGLIGIBLE, ZERO_VALUE
from ...results.state import State
from .events import at_rest
from .friction_modes import SENSE, SwitchingModes


@dataclass(frozen=True)
class ContactMode:
    """What is open, sticks and slides.

    Attributes
    ----------
    statuses : tuple of str
        By site; see :class:`.Solution`.
    shares : tuple of (int, int, float)
        Sites that share the friction of another one.
    open_forces : tuple of (int, str)
        Sites whose forces the motion leaves open, and what each does there: see :class:`.Bearing`.
    """

    statuses: tuple[str, ...]
    shares: tuple[tuple[int, int, float], ...] = ()
    open_forces: tuple[tuple[int, str], ...] = ()

    @property
    def motion(self) -> tuple[str, ...]:
        """What touches, rests and slides, however the forces share it."""
        at_rest = {"shares": "sticks", "pulled forth": "sticks", "pulled back": "sticks", "idle": "open"}
        statuses = {k: at_rest.get(one, one) for k, one in enumerate(self.statuses)} | dict(self.open_forces)
        return tuple(statuses.values())


@dataclass(frozen=True, eq=False)
class ContactView:
    """What a decision needs of a state: rows are the speeds at which places part, then those of sliding.

    Attributes
    ----------
    free : State
        The state in the mode in which nothing is held.
    gaps, within : numpy.ndarray
        Gaps of the contacts (s,), m, and their distances from the ends of edges with the rates of these (s, 2).
    speeds, rates : numpy.ndarray
        Values and rates of the rows (r,), m/s and m/s².
    rows, response, joints : numpy.ndarray
        Slopes of the rows by v (r, n); velocities (n, r) and impulses of the joints (m, r) by unit impulses along them.
    rest : float
        Speed below which a row rests, m/s.
    """

    free: State
    gaps: np.ndarray
    within: np.ndarray
    speeds: np.ndarray
    rates: np.ndarray
    rows: np.ndarray
    response: np.ndarray
    joints: np.ndarray
    rest: float

    @property
    def matrix(self) -> np.ndarray:
        """Rates of the rows by unit forces along them."""
        product: np.ndarray = self.rows @ self.response
        return (product + product.T) / 2

    def is_held(self, row: int, held: Sequence[int]) -> bool:
        """True if the speed of a row cannot change while those of others do not."""
        matrix = self.matrix
        left = matrix[row, row] - matrix[row, held] @ least_norm(matrix[np.ix_(held, held)], matrix[held, row])
        return bool(left <= NEGLIGIBLE * matrix[row, row])

    def at_rest(self, rows: Sequence[int]) -> np.ndarray:
        """Velocities with the speeds of some rows at zero exactly."""
        v: np.ndarray = self.free.v
        if not rows:
            return v
        return v - self.response[:, rows] @ least_norm(self.matrix[np.ix_(rows, rows)], self.speeds[rows])


class ContactSites(SwitchingModes):
    """The places of a mechanism with rigid contacts, and perhaps exact friction in joints.

    Attributes
    ----------
    sites : tuple of Site
        The places.
    normal, tangent : dict of int to int
        Rows of sites: the speeds at which places part, then those of sliding.
    """

    prefix: ClassVar[str] = "contact: "

    def __init__(self, setup: Setup):
        super().__init__(setup)
        self.elements = switching(setup.mechanism)
        self.sites = tuple(site for element in self.elements for site in sites_of(element))
        self._contacts = [k for k, site in enumerate(self.sites) if site.place is not None]
        other = [e.description for e in self.elements if not isinstance(e, RigidContact | FrictionInJoint)]
        if other:
            raise ModelError(
                f"{', '.join(other)} sticks and slides, which is not sorted out together with "
                f"{self.names(self._contacts)}; take a Contact with a stiffness"
            )
        self._rubs = [k for k, site in enumerate(self.sites) if site.law is not None]
        self.normal = {k: row for row, k in enumerate(self._contacts)}
        self.tangent = {k: len(self._contacts) + row for row, k in enumerate(self._rubs)}
        loaded = self.numeric(self.free).eom.loaded_by_reactions
        if loaded:
            raise ModelError(
                f"{', '.join(loaded)} depends on reactions by a smoothed law, which is not sorted out together with "
                f"{self.names(self._contacts)}; take DryFriction there"
            )

    def names(self, sites: Sequence[int]) -> str:
        """Kinds and names of the elements of some sites, as messages give them."""
        return ", ".join(dict.fromkeys(self.sites[k].element.description for k in sites))

    def rows(self, sites: Sequence[int]) -> list[int]:
        """Rows of some sites."""
        return [rows[k] for rows in (self.normal, self.tangent) for k in sites if k in rows]

    def places(self, k: int, rows: Sequence[int]) -> tuple[int | None, int | None]:
        """Places of the normal and the tangent of a site among some rows."""
        normal, tangent = (rows.index(own[k]) if k in own else None for own in (self.normal, self.tangent))
        return normal, tangent

    # --- mechanisms in one mode ------------------------------------------------------------------
    @cached_property
    def free(self) -> ContactMode:
        return ContactMode(tuple("free" if site.place is None else "open" for site in self.sites))

    def variant(self, mode: ContactMode) -> Mechanism:
        statuses = iter(mode.statuses)
        senses = [
            tuple(next(statuses) for _ in element.places) if isinstance(element, RigidContact) else next(statuses)
            for element in self.elements
        ]
        return variant_in(self.mechanism, tuple(senses))

    def continues(self, before: ContactMode, after: ContactMode) -> bool:
        return before.motion == after.motion

    def sliding(self, mode: ContactMode) -> list[tuple[Any, float]]:
        both = zip(self.sites, mode.statuses, strict=True)
        return [(site, SENSE.get(status, 0.0)) for site, status in both if site.law is not None]

    @property
    def loads(self) -> list[tuple[str, ca.SX]]:
        return [(self.sites[k].description, self.sites[k].load) for k in self._rubs]

    def kept(self, senses: Mapping[int, float]) -> list[int]:
        """Rows of joints whose multipliers are the load of a friction that slides."""
        lam, kept = self.numeric(self.free).eom.lam, set[int]()
        for k, sense in senses.items():
            if sense and self.sites[k].place is None:
                kept.update(np.flatnonzero(ca.which_depends(self.sites[k].load, lam, 1, False)).tolist())
        return sorted(kept)

    def _row(self, k: int, kind: str) -> int:
        """Row of a site in the whole mechanism."""
        return equations(self.mechanism).row_elements.index(self.sites[k].element) + self.sites[k].row(kind)

    def _reactions(self, mode: ContactMode) -> ca.SX:
        """Multipliers of the whole mechanism in a mode; of friction that is shared, all at the first place."""
        terms = ca.vertsplit(equations(self.mechanism).lam)
        for k, (site, status) in enumerate(zip(self.sites, mode.statuses, strict=True)):
            if status in ("open", "idle"):
                terms[self._row(k, "normal")] = ca.SX(0)
            if status.endswith(("forth", "back")):
                terms[self._row(k, "friction")] = -site.sliding_friction(status)
            elif status != "sticks":
                terms[self._row(k, "friction")] = ca.SX(0)
        return ca.vertcat(*terms)

    # --- events of a mode ----------------------------------------------------------------------------
    def event_names(self) -> set[str]:
        return {f"{site.name} {what}" for site in self.sites for what in WHAT}

    def events(self, mode: ContactMode) -> tuple[Event, ...]:
        return tuple(event for k in range(len(self.sites)) for event in self._events_of(k, mode))

    @property
    def _rounding(self) -> ca.SX:
        """Distance that is rounding, m."""
        return ZERO_VALUE * self._fineness * (1 + ca.norm_2(equations(self.mechanism).q))

    def _events_of(self, k: int, mode: ContactMode) -> list[Event]:
        """Events at which a site leaves its mode."""
        site, status, found = self.sites[k], mode.statuses[k], []
        if status in ("open", "idle"):
            gap = site.element.gaps[site.place]
            if status == "idle":
                gap += self._rounding
            return [Event(f"{site.name} touches", gap, direction=-1, terminal=True)]
        if site.place is not None:
            found = [Event(f"{site.name} opens", site.normal_force, direction=-1, terminal=True)]
            within = site.element.places[site.place].touch.within
            if within is not None:
                found.append(Event(f"{site.name} slips off", within + self._rounding, direction=-1, terminal=True))
        if status == "sticks":
            limit = site.law.static_coefficient * site.load
            for leader, member, ratio in mode.shares:
                if leader == k:
                    other = self.sites[member]
                    limit += abs(ratio) * other.law.static_coefficient * other.load
            excess = ca.fabs(site.friction) - limit
            found.append(Event(f"{site.name} breaks away", excess, direction=1, terminal=True))
        elif SENSE.get(status):
            speed, direction = site.sliding_speed, -int(SENSE[status])
            found.append(Event(f"{site.name} stops", speed, direction=direction, terminal=True))
        elif status.startswith("pulled") or (status in ("free", "closed") and site.law is not None):
            leaves = ca.fabs(site.sliding_speed) - self.rest
            found.append(Event(f"{site.name} breaks away", leaves, direction=1, terminal=True))
        return found

    def came_about(self, name: str, after: ContactMode) -> bool:
        for site, status in zip(self.sites, after.statuses, strict=True):
            apart = status in ("open", "idle")
            if name in (f"{site.name} opens", f"{site.name} breaks away"):
                return apart == name.endswith("opens")
        return True

    def switched(self, before: ContactMode, after: ContactMode) -> list[str]:
        names = []
        for site, old, new in zip(self.sites, before.statuses, after.statuses, strict=True):
            apart = [status in ("open", "idle") for status in (old, new)]
            if apart[0] != apart[1]:
                names.append(f"{site.name} {'opens' if apart[1] else 'touches'}")
            elif "sticks" in (old, new) and (SENSE.get(old) or SENSE.get(new)):
                names.append(f"{site.name} {'stops' if new == 'sticks' else 'breaks away'}")
        return names

    # --- what a state is like ---------------------------------------------------------------------------
    @cached_property
    def _expressions(self) -> tuple[ca.SX, ...]:
        """Gaps, distances from the ends of edges and their rates (s, 2), speeds of the rows, their rates and slopes."""
        none, contacts = ca.SX(0, 1), [self.sites[k] for k in self._contacts]
        gaps = ca.vertcat(none, *[s.element.gaps[s.place] for s in contacts])
        touches = [s.element.places[s.place].touch for s in contacts]
        within = ca.vertcat(none, *[ca.SX(1) if t.within is None else t.within for t in touches])
        speeds = [s.element.normal_speeds[s.place] for s in contacts]
        speeds += [self.sites[k].sliding_speed for k in self._rubs]
        rows = ca.vertcat(none, *speeds)
        sides = ca.horzcat(within, time_derivative(within, self.mechanism))
        return gaps, sides, rows, time_derivative(rows, self.mechanism), ca.jacobian(rows, equations(self.mechanism).v)

    def _viewed(self, state: State) -> ContactView:
        """Everything that a decision needs of a state.

        Raises
        ------
        SimulationError
            If outlines penetrate each other.
        """
        free, numeric = self.at(self.free, state.t, state.q, state.v, state.z), self.numeric(self.free)
        if free.obstacle is not None:
            raise free.obstacle
        gaps, sides, speeds, rates, rows = (self._value(free, e) for e in self._expressions)
        gaps, speeds, rates = gaps.ravel(), speeds.ravel(), rates.ravel()
        jacobian = numeric.jacobian(free.t, free.q)
        response, joints = impulse_response(numeric, jacobian, rows, free.z)
        deepest = int(np.argmin(gaps))
        if gaps[deepest] < -float(position_limits(numeric, np.array([False]))[0]):
            site = self.sites[self._contacts[deepest]]
            raise SimulationError(
                f"{site.element.description}: the outlines penetrate each other by {-gaps[deepest]:.3g} m at t = "
                f"{free.t:.6g} s, and a rigid contact does not push them apart; start with a gap that is not negative",
                time=free.t,
            )
        return ContactView(free, gaps, sides, speeds, rates, rows, response, joints, at_rest(free))

    def _near(self, q: np.ndarray) -> float:
        """Gap below which a place counts as closed, m."""
        return NEGLIGIBLE * self._fineness * (1 + largest(q))

    def _touching(
        self, view: ContactView, events: Sequence[Event], before: ContactMode | None
    ) -> tuple[list[int], list[int]]:
        """Sites of contacts that are closed, and those at an end of an edge where another place takes their load."""
        near, names = self._near(view.free.q), {event.name for event in events}
        touching, ends = list[int](), list[int]()
        for i, k in enumerate(self._contacts):
            site, (within, rate) = self.sites[k], view.within[i]
            touches = f"{site.name} touches" in names
            was = before is not None and before.statuses[k] not in ("open", "idle")
            if abs(within) <= near:  # at the end of an edge it is where it goes, or stays what it was
                slips = any(f"{other.name} slips off" in names for other in self.sites if other.element is site.element)
                covers = site.element.places[site.place].touch.covers_ends if before is None or touches else was
                within = rate if abs(rate) > (0.0 if slips else view.rest) else 1.0 if covers else -1.0
                if within < 0 and view.gaps[i] <= near:
                    ends.append(k)
            if within > 0 and (was or view.gaps[i] <= near or touches):
                touching.append(k)
        return touching, ends

    def _coefficients(self, k: int, free: State) -> tuple[float, float]:
        """Coefficients of sliding and of rest of a site."""
        law = self.sites[k].law
        if law is None:
            return 0.0, 0.0
        sliding, static = np.asarray(free[ca.vertcat(law.coefficient, law.static_coefficient)])
        return float(sliding), float(static)

    def _restitution(self, view: ContactView, k: int) -> float:
        """Coefficient of restitution of a place."""
        site = self.sites[k]
        e = float(view.free[ca.SX(site.element.restitution)])
        if not 0 <= e <= 1:
            raise ModelError(f"{site.element.description}: restitution must be from 0 to 1, got {e:g}")
        return e

    @staticmethod
    def _value(state: State, expression: ca.SX) -> np.ndarray:
        """Value of an expression at a state, as a matrix."""
        return np.reshape(state[expression], expression.shape)
