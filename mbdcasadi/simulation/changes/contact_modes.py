"""Mechanisms with rigid contacts in one mode, which mode holds at a state, and the impacts that lead into it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...assembly.consistent_start import consistent_start, position_limits
from ...assembly.setup import Setup
from ...equations import equations
from ...equations.impact_law import by_element, impulse_response
from ...errors import ModelError, SimulationError, SingularityError
from ...model.events import Event
from ...model.forces.contact.rigid import RigidContact
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.forces.friction.modes import switching, variant_in
from ...model.mechanism import Mechanism
from ...model.rates import time_derivative
from ...model.sites import WHAT, sites_of
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest, least_norm
from ...numerics.tolerances import ACCURACY, NEGLIGIBLE, ZERO_VALUE
from ...results.state import State
from ...results.trajectory import Trajectory
from .complementarity import Complementarity, TooManyChoicesError
from .events import at_rest
from .friction_modes import FRICTION_TOLERANCE, NO_EFFECT, SENSE, FrictionModes, SwitchingModes
from .modes import Strike
from .shared_forces import Bearing, SharedForces
from .spots import Loads, Solution, Spot


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
class _View:
    """What a decision needs of a state: rows are the speeds at which places part, then those of sliding."""

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


class ContactModes(SwitchingModes):
    """The modes of a mechanism with rigid contacts, and perhaps exact friction in joints."""

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
                f"{self._names(self._contacts)}; take a Contact with a stiffness"
            )
        self._rubs = [k for k, site in enumerate(self.sites) if site.law is not None]
        #: sites whose last bounces are left out by the impact of this instant: see `_lost_rebounds`
        self._rebounds: dict[int, float] = {}
        #: rows of the sites: the speeds at which places part, then those of sliding
        self._normal = {k: row for row, k in enumerate(self._contacts)}
        self._tangent = {k: len(self._contacts) + row for row, k in enumerate(self._rubs)}
        loaded = self.numeric(self.free).eom.loaded_by_reactions
        if loaded:
            raise ModelError(
                f"{', '.join(loaded)} depends on reactions by a smoothed law, which is not sorted out together with "
                f"{self._names(self._contacts)}; take DryFriction there"
            )

    def _names(self, sites: Sequence[int]) -> str:
        return ", ".join(dict.fromkeys(self.sites[k].element.description for k in sites))

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

    def notes(self, mode: ContactMode) -> list[str]:
        if not mode.open_forces:
            return []
        return [
            f"{self._names([k for k, _ in mode.open_forces])}: of forces that the motion leaves open, the least norm"
        ]

    def continues(self, before: ContactMode, after: ContactMode) -> bool:
        return before.motion == after.motion

    def sliding(self, mode: ContactMode) -> list[tuple[Any, float]]:
        both = zip(self.sites, mode.statuses, strict=True)
        return [(site, SENSE.get(status, 0.0)) for site, status in both if site.law is not None]

    @property
    def loads(self) -> list[tuple[str, ca.SX]]:
        return [(self.sites[k].description, self.sites[k].load) for k in self._rubs]

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

    # --- results of the whole mechanism ------------------------------------------------------------
    def multipliers(self, mode: ContactMode, motion: Trajectory | State) -> np.ndarray:
        whole = equations(self.mechanism)
        columns = np.reshape(motion[self.reactions(mode)], (-1, whole.lam.numel()))
        return self._of_least_norm(mode, motion, columns) if mode.open_forces else columns

    def _of_least_norm(self, mode: ContactMode, motion: Trajectory | State, columns: np.ndarray) -> np.ndarray:
        """Multipliers (k, m) with the forces that the motion leaves open of least norm."""
        sites, numeric = [k for k, _ in mode.open_forces], self.numeric(self.free)
        rows, n = self._rows(sites), numeric.eom.v.numel()
        slopes = np.reshape(motion[ca.vec(self._expressions[-1][rows, :])], (-1, n, len(rows)))
        kinds = (("normal", self._normal), ("friction", self._tangent))
        places = [self._row(k, kind) for kind, own in kinds for k in sites if k in own]
        gaps = np.reshape(motion[ca.vertcat(*[self._gap(k) for k in sites])], (-1, len(sites)))
        laws = [self._law_at(k, status) for k, status in mode.open_forces]
        values = np.reshape(motion[ca.vertcat(*laws)], (-1, len(sites), 2))
        senses = {k: SENSE.get(status, 0.0) for k, status in enumerate(mode.statuses)}
        states = np.atleast_1d(motion.t), np.atleast_2d(motion.q), np.atleast_2d(motion.z)
        columns, kept = columns.copy(), self._kept(senses)
        known: tuple[list[Bearing], np.ndarray] | None = None
        for i, (time, q, z) in enumerate(zip(*states, strict=True)):
            near = self._near(q)
            bearings = [
                Bearing(*self._places(k, rows), status, *values[i, j])
                for j, (k, status) in enumerate(mode.open_forces)
                if gaps[i, j] <= near
            ]
            given = np.vstack([slopes[i].T, numeric.velocity(float(time), q, z)[0]])
            if known is None or bearings != known[0] or largest(given - known[1]) > ACCURACY * largest(given):
                known = bearings, given  # what rests does not turn: one decomposition for many outputs
                split = SharedForces(given[: len(rows)], given[len(rows) :], numeric.column_scale, bearings, kept)
            forces = -columns[i, places]
            change = split.least(forces) - forces
            columns[i, places] -= change
            columns[i, self._joint_rows] += split.by_joints(change)
        return columns

    def _gap(self, k: int) -> ca.SX:
        """Gap of a site, m; zero of a friction in a joint."""
        site = self.sites[k]
        return ca.SX(0) if site.place is None else site.element.gaps[site.place]

    def _law_at(self, k: int, status: str) -> ca.SX:
        """Coefficient of friction of a site, at rest if it sticks, and load of a friction in a joint, N (2,)."""
        site = self.sites[k]
        if site.law is None:
            return ca.SX(2, 1)
        coefficient = site.law.static_coefficient if status == "sticks" else site.law.coefficient
        return ca.vertcat(coefficient, site.load if site.place is None else 0.0)

    def _kept(self, senses: Mapping[int, float]) -> list[int]:
        """Rows of joints whose multipliers are the load of a friction that slides."""
        lam, kept = self.numeric(self.free).eom.lam, set[int]()
        for k, sense in senses.items():
            if sense and self.sites[k].place is None:
                kept.update(np.flatnonzero(ca.which_depends(self.sites[k].load, lam, 1, False)).tolist())
        return sorted(kept)

    @cached_property
    def _joint_rows(self) -> list[int]:
        """Rows of the joints in the whole mechanism."""
        own, whole = self.numeric(self.free).eom.row_elements, equations(self.mechanism).row_elements
        return [whole.index(element) + row - own.index(element) for row, element in enumerate(own)]

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

    def _viewed(self, state: State) -> _View:
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
        return _View(free, gaps, sides, speeds, rates, rows, response, joints, at_rest(free))

    def _near(self, q: np.ndarray) -> float:
        """Gap below which a place counts as closed, m."""
        return NEGLIGIBLE * self._fineness * (1 + largest(q))

    def _touching(
        self, view: _View, events: Sequence[Event], before: ContactMode | None
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

    @staticmethod
    def _value(state: State, expression: ca.SX) -> np.ndarray:
        """Value of an expression at a state, as a matrix."""
        return np.reshape(state[expression], expression.shape)

    # --- impacts ---------------------------------------------------------------------------------------
    def struck(self, state: State, events: Sequence[Event] = (), before: ContactMode | None = None) -> Strike | None:
        view = self._viewed(state)
        touching, _ = self._touching(view, events, before)
        if not any(view.speeds[self._normal[k]] < -view.rest for k in touching):
            return None
        sites = [k for k, site in enumerate(self.sites) if site.place is None or k in touching]
        rows = self._rows(sites)
        spots = [self._striking(view, k, rows) for k in sites]
        loads = self._loads(view, rows, sites, impulsive=True)
        solution = self._solution(view, rows, view.speeds[rows], [spots], sites, "velocities", loads)
        self._refuse_gain(view, rows, solution, sites)
        rebounds = self._lost_rebounds(view, touching, spots, sites, solution)
        if rebounds:  # what they would still take is that of the forces in the meantime
            spots = [replace(spot, target=0.0) if k in rebounds else spot for k, spot in zip(sites, spots, strict=True)]
            solution = self._solution(view, rows, view.speeds[rows], [spots], sites, "velocities", loads)
        self._rebounds = rebounds
        v = view.free.v + view.response[:, rows] @ solution.forces
        _, forces = self._open_forces(view, rows, dict(zip(sites, spots, strict=True)), solution, loads)
        impulses = dict(by_element(self.numeric(self.free).eom, view.joints[:, rows] @ forces))
        names = list[str]()
        for k, spot in zip(sites, spots, strict=True):
            site = self.sites[k]
            own = impulses.setdefault(site.element, np.zeros(site.element.multipliers.numel()))
            if spot.normal is not None:
                own[site.row("normal")] = -forces[spot.normal]
                if forces[spot.normal] > 0:
                    names.append(f"{site.name} touches")
            if spot.tangent is not None:
                own[site.row("friction")] = -forces[spot.tangent]
        return Strike(self.at(self.free, state.t, state.q, v, state.z), impulses, tuple(names))

    def _lost_rebounds(
        self, view: _View, touching: Sequence[int], spots: Sequence[Spot], sites: Sequence[int], solution: Solution
    ) -> dict[int, float]:
        """Sites that bounce lower than what counts as closed, and the speeds by which all their bounces are left, m/s.

        The flights of bounces that follow each other last ``2 w (1 + e + e² + …) / a`` under an acceleration a.
        """
        lost, slowest = dict[int, float](), self._lost_speed(view, touching)
        for k, spot in zip(sites, spots, strict=True):
            if spot.normal is None or view.speeds[self._normal[k]] >= -view.rest:
                continue
            e, after = self._restitution(view, k), float(solution.rates[spot.normal])
            if 0 < e < 1 and after <= slowest:
                lost[k] = 2 * after / (1 - e)
        return lost

    def _rows(self, sites: Sequence[int]) -> list[int]:
        """Rows of some sites."""
        return [rows[k] for rows in (self._normal, self._tangent) for k in sites if k in rows]

    def _places(self, k: int, rows: Sequence[int]) -> tuple[int | None, int | None]:
        """Places of the normal and the tangent of a site among some rows."""
        normal, tangent = (rows.index(own[k]) if k in own else None for own in (self._normal, self._tangent))
        return normal, tangent

    def _striking(self, view: _View, k: int, rows: Sequence[int]) -> Spot:
        """What a place, or a friction in a joint, may do in an impact."""
        normal, tangent = self._places(k, rows)
        mu, _ = self._coefficients(k, view.free)
        stands = ("closed",) if tangent is None else ("sticks", "forth", "back")
        if normal is None:
            return Spot(normal, tangent, stands, mu, mu)
        target = -self._restitution(view, k) * min(view.speeds[self._normal[k]], 0.0)
        return Spot(normal, tangent, ("open", *stands), mu, mu, target)

    def _restitution(self, view: _View, k: int) -> float:
        """Coefficient of restitution of a place."""
        site = self.sites[k]
        e = float(view.free[ca.SX(site.element.restitution)])
        if not 0 <= e <= 1:
            raise ModelError(f"{site.element.description}: restitution must be from 0 to 1, got {e:g}")
        return e

    def _refuse_gain(self, view: _View, rows: Sequence[int], solution: Solution, sites: Sequence[int]) -> None:
        """Raise if restitution and friction add energy to an impact."""
        twice = view.speeds[rows] + solution.rates
        gain, exchanged = solution.forces @ twice / 2, np.abs(solution.forces) @ np.abs(twice) / 2
        if gain > NEGLIGIBLE * exchanged:
            raise SimulationError(
                f"{self._names(sites)}: the impact at t = {view.free.t:.6g} s would gain {gain:.3g} J by Newton's "
                "restitution while friction turns the sliding back (Kane's paradox); lower the restitution or the "
                "friction, or take a Contact with a stiffness",
                time=view.free.t,
            )

    # --- which mode holds -----------------------------------------------------------------------------
    def decided(
        self, state: State, events: Sequence[Event] = (), before: ContactMode | None = None
    ) -> tuple[ContactMode, State]:
        view, names = self._viewed(state), {event.name for event in events}
        touching, ends = self._touching(view, events, before)
        slowest = self._lost_speed(view, touching)
        touching = [k for k in touching if view.speeds[self._normal[k]] <= slowest]
        sites = [k for k, site in enumerate(self.sites) if site.place is None or k in touching]
        rows, broken = self._rows(sites), self._broken(state, names, before)
        spots = [self._resting(view, k, rows, names) for k in sites]
        likely = [self._likely(spot, k, names, broken) for spot, k in zip(spots, sites, strict=True)]
        # where something breaks away, what shares forces with it would do so at once if it were at its limit
        attempts = [[replace(spot, clear=bool(broken)) for spot in likely], likely, spots]
        loads = self._loads(view, rows, sites)
        solution = self._solution(view, rows, view.rates[rows], attempts, sites, "accelerations", loads)
        self._settle(view, rows, sites, spots, loads)
        statuses, held = list(self.free.statuses), list[int]()
        for k in ends:
            statuses[k] = "idle"
        for k, spot, status in zip(sites, spots, solution.statuses, strict=True):
            statuses[k] = "idle" if status == "open" else status
            pairs = (spot.normal, status not in ("open", "idle")), (spot.tangent, status in ("sticks", "shares"))
            held += [rows[row] for row, holds in pairs if holds and row is not None]
        for k in broken:
            if not self._is_held(view, self._tangent[k], held):
                statuses[k] = statuses[k].removeprefix("pulled ")
        found = [
            "open" if statuses[k] == "idle" and not self._is_held(view, self._normal[k], held) else statuses[k]
            for k in sites
        ]
        shares = tuple((sites[one], sites[other], ratio) for one, other, ratio in solution.shares)
        solution = replace(solution, statuses=tuple(found))
        open_forces, _ = self._open_forces(view, rows, dict(zip(sites, spots, strict=True)), solution, loads)
        mode = ContactMode(tuple(statuses), shares, open_forces)
        v = self._at_rest(view, held)
        state = self.at(mode, state.t, state.q, v, state.z)
        if state.obstacle is not None:
            raise state.obstacle
        return mode, state

    def _settle(
        self, view: _View, rows: Sequence[int], sites: Sequence[int], spots: Sequence[Spot], loads: Loads | None
    ) -> None:
        """Note when bounces that are left out come to rest, by the accelerations in their flights."""
        closed = {f"{self.sites[k].name} touches" for k in sites}
        self.settling = {name: time for name, time in self.settling.items() if name in closed}
        rebounds, self._rebounds = self._rebounds, dict[int, float]()
        if not rebounds:
            return
        flying = [
            replace(spot, options=("open",), target=-np.inf) if k in rebounds else spot
            for k, spot in zip(sites, spots, strict=True)
        ]
        rates = self._solution(view, rows, view.rates[rows], [flying], sites, "accelerations", loads).rates
        for k, speed in rebounds.items():
            falls = -float(rates[rows.index(self._normal[k])])
            if falls > 0:
                self.settling[f"{self.sites[k].name} touches"] = view.free.t + speed / falls

    @staticmethod
    def _is_held(view: _View, row: int, held: Sequence[int]) -> bool:
        """True if the speed of a row cannot change while those of others do not."""
        matrix = view.matrix
        left = matrix[row, row] - matrix[row, held] @ least_norm(matrix[np.ix_(held, held)], matrix[held, row])
        return bool(left <= NEGLIGIBLE * matrix[row, row])

    def _resting(self, view: _View, k: int, rows: Sequence[int], names: set[str]) -> Spot:
        """What a site that is closed, or a friction, may do from an instant on."""
        normal, tangent = self._places(k, rows)
        options: tuple[str, ...] = ("closed",) if tangent is None else ("sticks", "forth", "back")
        speed = 0.0 if tangent is None else float(view.speeds[self._tangent[k]])
        rests = abs(speed) <= view.rest or f"{self.sites[k].name} stops" in names
        sliding, static = self._coefficients(k, view.free)
        if not rests:
            options = ("forth" if speed > 0 else "back",)
        elif tangent is not None and static > sliding:
            options = ("sticks", "pulled forth", "pulled back", "forth", "back")
        if normal is not None:
            options = (*options, "open")
        return Spot(normal, tangent, options, sliding, static, rests=rests)

    def _lost_speed(self, view: _View, touching: Sequence[int]) -> float:
        """Speed of parting below which a place stays closed: it would rise to where it still counts as closed, m/s."""
        pressing = max(0.0, -float(np.min(view.rates[[self._normal[k] for k in touching]], initial=0.0)))
        return max(view.rest, math.sqrt(2 * pressing * self._near(view.free.q)))

    def _broken(self, state: State, names: set[str], before: ContactMode | None) -> dict[int, str]:
        """Sites that break away just there, and the sense in which they begin to slide."""
        broken: dict[int, str] = {}
        for k, site in enumerate(self.sites):
            if before is None or before.statuses[k] != "sticks" or f"{site.name} breaks away" not in names:
                continue
            pull = -float(state[site.friction])
            for other, ratio in [(k, 1.0), *((m, r) for leader, m, r in before.shares if leader == k)]:
                broken[other] = "forth" if pull * ratio > 0 else "back"
        return broken

    def _likely(self, spot: Spot, k: int, names: set[str], broken: dict[int, str]) -> Spot:
        """What a site may be if what has just taken place there is not undone at once."""
        options = tuple(spot.options)
        if f"{self.sites[k].name} opens" in names:
            options = ("open",)
        elif k in broken:
            options = tuple(o for o in options if o in ("open", broken[k]))
        return replace(spot, options=options)

    def _loads(
        self, view: _View, rows: Sequence[int], sites: Sequence[int], *, impulsive: bool = False
    ) -> Loads | None:
        """Loads of the frictions in joints by the forces of the rows, or by their impulses; None if there are none."""
        if all(self.sites[k].place is not None for k in sites):
            return None
        eom = view.free.equations
        loads = ca.vertcat(*[self.sites[k].load if self.sites[k].place is None else ca.SX(0) for k in sites])
        slopes = ca.jacobian(loads, eom.lam)
        function = eom.function(ca.horzcat(loads, slopes))
        joints, arguments = view.joints[:, rows], list(view.free.arguments)
        given = np.zeros(eom.lam.numel()) if impulsive else view.free.lam
        arguments[5] = given
        finite = function(*arguments).full()[:, 0] if impulsive else 0.0  # which has no part in an instant

        def at(forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            arguments[5] = given + joints @ forces
            values = function(*arguments).full()
            return values[:, 0] - finite, values[:, 1:] @ joints

        acts = np.abs(joints) > NO_EFFECT * np.max(np.abs(joints), axis=1, keepdims=True, initial=0.0)
        needs = np.zeros(slopes.shape, int)
        needs[slopes.sparsity().row(), slopes.sparsity().get_col()] = 1
        return Loads(at, needs @ acts > 0)

    def _solution(
        self,
        view: _View,
        rows: Sequence[int],
        constant: np.ndarray,
        attempts: Sequence[Sequence[Spot]],
        sites: Sequence[int],
        what: str,
        loads: Loads | None = None,
    ) -> Solution:
        """The one motion that meets the laws: of the parts of the mechanism that do not act on each other, one each."""
        matrix = view.matrix[np.ix_(rows, rows)]
        alone = np.sum(view.rows[rows] ** 2 / self.numeric(self.free).weights, axis=1)
        whole = Complementarity(matrix, constant, alone, attempts[-1], loads)
        statuses, shares = np.full(len(sites), "", object), list[tuple[int, int, float]]()
        forces, rates = np.zeros(len(rows)), np.zeros(len(rows))
        for own, lines in whole.parts():
            place: dict[int | None, int] = {row: n for n, row in enumerate(lines)}
            problems = [
                Complementarity(
                    matrix[np.ix_(lines, lines)],
                    constant[lines],
                    alone[lines],
                    [
                        replace(spots[k], normal=place.get(spots[k].normal), tangent=place.get(spots[k].tangent))
                        for k in own
                    ],
                    None if loads is None else loads.of(own, lines),
                )
                for spots in attempts
            ]
            part = self._unique(problems, [sites[k] for k in own], what, view.free.t)
            forces[lines], rates[lines], statuses[own] = part.forces, part.rates, part.statuses
            shares += [(own[one], own[other], ratio) for one, other, ratio in part.shares]
        return Solution(tuple(statuses), forces, rates, tuple(shares))

    def _unique(self, attempts: Sequence[Complementarity], sites: Sequence[int], what: str, time: float) -> Solution:
        """The one motion that meets the laws, among the first choices that have any.

        Raises
        ------
        SimulationError
            If there is none, or more than one, and if there are too many choices.
        """
        for problem in attempts:
            try:
                found = problem.solutions()
            except TooManyChoicesError:
                raise SimulationError(
                    f"{self._names(sites)}: {len(sites)} places that act on each other are closed at t = {time:.6g} s, "
                    'more than are sorted out at once; take a Contact with a stiffness, and method="bdf"',
                    time=time,
                ) from None
            if not found:
                continue
            if problem.may_fall:  # what can stick does not slide
                found = [one for one in found if one.sticking == found[0].sticking]
            if any(problem.different(found[0], other) for other in found[1:]):
                raise SimulationError(
                    f"{self._names(sites)}: more than one set of {what} meets the laws of contact and friction at t = "
                    f"{time:.6g} s (Painlevé's paradox); lower the friction, or take a Contact with a stiffness",
                    time=time,
                )
            return found[0]
        if not attempts[-1].without_friction().solutions():
            raise SimulationError(
                f"{self._names(sites)}: joints, drivers and other contacts press the outlines into each other at t = "
                f"{time:.6g} s, and no force of contact can part them; let the prescribed motion end before, or "
                "let it act by a spring",
                time=time,
            )
        raise SimulationError(
            f"{self._names(sites)}: no {what} meet the laws of contact and friction at t = {time:.6g} s: friction is "
            "so large that it jams (Painlevé's paradox); lower the friction, or take a Contact with a stiffness",
            time=time,
        )

    def _open_forces(
        self,
        view: _View,
        rows: Sequence[int],
        spots: Mapping[int, Spot],
        solution: Solution,
        loads: Loads | None,
    ) -> tuple[tuple[tuple[int, str], ...], np.ndarray]:
        """Sites whose forces the motion leaves open, with what each does there, and the forces of least norm (r,)."""
        forces, bearings, senses = solution.forces, dict[int, Bearing](), dict[int, float]()
        given = np.zeros(len(spots)) if loads is None else loads.at(forces)[0]
        still = FRICTION_TOLERANCE * (largest(view.rates[rows]) + largest(solution.rates))
        for (k, spot), status, load in zip(spots.items(), solution.statuses, given, strict=True):
            senses[k] = SENSE.get(status, 0.0)
            if status in ("open", "free") or (spot.normal is None and senses[k]):
                continue
            onset = 0.0 if spot.tangent is None else float(solution.rates[spot.tangent])
            if spot.tangent is None or status == "closed":
                status = "closed"
            elif status == "idle":
                slides = len(spot.options) == 2 or abs(onset) > still
                status = ("forth" if onset > 0 else "back") if spot.rests and slides else spot.options[0]
            elif not senses[k]:
                status = "sticks"
            coefficient = spot.static if status == "sticks" else spot.sliding
            tangent = None if status == "closed" else spot.tangent
            bearings[k] = Bearing(
                spot.normal, tangent, status, coefficient, float(load) if spot.normal is None else 0.0
            )
        numeric = self.numeric(self.free)
        jacobian, _ = numeric.velocity(view.free.t, view.free.q, view.free.z)
        split = SharedForces(
            view.rows[rows], jacobian, numeric.column_scale, list(bearings.values()), self._kept(senses)
        )
        if not split.directions.size:
            return (), forces
        forces = split.least(forces)
        moved = {row for row, size in enumerate(np.abs(split.directions).max(axis=1)) if size > NEGLIGIBLE}
        return tuple((k, b.status) for k, b in bearings.items() if moved & {b.normal, b.tangent}), forces

    @staticmethod
    def _at_rest(view: _View, rows: Sequence[int]) -> np.ndarray:
        """Velocities with the speeds of some rows at zero exactly."""
        v: np.ndarray = view.free.v
        if not rows:
            return v
        return v - view.response[:, rows] @ least_norm(view.matrix[np.ix_(rows, rows)], view.speeds[rows])


def modes_of(setup: Setup) -> SwitchingModes:
    """Modes of a mechanism with exact friction or rigid contacts."""
    touches = any(isinstance(element, RigidContact) for element in switching(setup.mechanism))
    return ContactModes(setup) if touches else FrictionModes(setup)


def start_in_mode(setup: Setup) -> State:
    """Find the consistent start; accelerations and reactions belong to the mode that the laws allow there."""
    modes, time = modes_of(setup), float(setup.grid[0])
    free = modes.numeric(modes.free)
    state = consistent_start(free, setup.initial, time, setup.signals)
    if free.has_redundant_rows(time, state.q):
        modes.refuse_redundant_rows(state)
    try:
        if modes.struck(state) is not None:
            raise SimulationError("bodies strike each other", time=time)
        return modes.whole(*modes.decided(state))
    except SimulationError as error:
        obstacle = SingularityError(f"there are no accelerations at t = {time:.6g} s: {error}", time=time)
    lam = modes.multipliers(modes.free, state)[0]
    values = state.q, state.v, state.a, state.z, lam, state.inputs, state.parameters
    return State(setup.mechanism, time, *values, obstacle)
