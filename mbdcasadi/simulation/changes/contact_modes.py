"""Which mode holds at a state of a mechanism with rigid contacts, and the impacts that lead into it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ...assembly.consistent_start import consistent_start
from ...assembly.setup import Setup
from ...equations import equations
from ...equations.impact_law import by_element
from ...errors import SimulationError, SingularityError
from ...model.events import Event
from ...model.forces.contact.rigid import RigidContact
from ...model.forces.friction.modes import switching
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...numerics.tolerances import ACCURACY, NEGLIGIBLE
from ...results.state import State
from ...results.trajectory import Trajectory
from .contact_problem import ContactProblem
from .contact_sites import ContactMode, ContactSites, ContactView
from .friction_modes import SENSE, FrictionModes, SwitchingModes
from .modes import Strike
from .shared_forces import Bearing, SharedForces
from .spots import Solution, Spot


class ContactModes(ContactSites):
    """The modes of a mechanism with rigid contacts: which one holds at a state, and the impacts that lead into it."""

    def __init__(self, setup: Setup):
        super().__init__(setup)
        #: sites whose last bounces are left out by the impact of this instant: see `_lost_rebounds`
        self._rebounds: dict[int, float] = {}

    # --- results of the whole mechanism ------------------------------------------------------------
    def notes(self, mode: ContactMode) -> list[str]:
        if not mode.open_forces:
            return []
        return [
            f"{self.names([k for k, _ in mode.open_forces])}: of forces that the motion leaves open, the least norm"
        ]

    def multipliers(self, mode: ContactMode, motion: Trajectory | State) -> np.ndarray:
        whole = equations(self.mechanism)
        columns = np.reshape(motion[self.reactions(mode)], (-1, whole.lam.numel()))
        return self._of_least_norm(mode, motion, columns) if mode.open_forces else columns

    def _of_least_norm(self, mode: ContactMode, motion: Trajectory | State, columns: np.ndarray) -> np.ndarray:
        """Multipliers (k, m) with the forces that the motion leaves open of least norm."""
        sites, numeric = [k for k, _ in mode.open_forces], self.numeric(self.free)
        rows, n = self.rows(sites), numeric.eom.v.numel()
        slopes = np.reshape(motion[ca.vec(self._expressions[-1][rows, :])], (-1, n, len(rows)))
        kinds = (("normal", self.normal), ("friction", self.tangent))
        places = [self._row(k, kind) for kind, own in kinds for k in sites if k in own]
        gaps = np.reshape(motion[ca.vertcat(*[self._gap(k) for k in sites])], (-1, len(sites)))
        laws = [self._law_at(k, status) for k, status in mode.open_forces]
        values = np.reshape(motion[ca.vertcat(*laws)], (-1, len(sites), 2))
        senses = {k: SENSE.get(status, 0.0) for k, status in enumerate(mode.statuses)}
        states = np.atleast_1d(motion.t), np.atleast_2d(motion.q), np.atleast_2d(motion.z)
        columns, kept = columns.copy(), self.kept(senses)
        known: tuple[list[Bearing], np.ndarray] | None = None
        for i, (time, q, z) in enumerate(zip(*states, strict=True)):
            near = self._near(q)
            bearings = [
                Bearing(*self.places(k, rows), status, *values[i, j])
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

    @cached_property
    def _joint_rows(self) -> list[int]:
        """Rows of the joints in the whole mechanism."""
        own, whole = self.numeric(self.free).eom.row_elements, equations(self.mechanism).row_elements
        return [whole.index(element) + row - own.index(element) for row, element in enumerate(own)]

    # --- impacts ---------------------------------------------------------------------------------------
    def struck(self, state: State, events: Sequence[Event] = (), before: ContactMode | None = None) -> Strike | None:
        view = self._viewed(state)
        touching, _ = self._touching(view, events, before)
        if not any(view.speeds[self.normal[k]] < -view.rest for k in touching):
            return None
        sites = [k for k, site in enumerate(self.sites) if site.place is None or k in touching]
        problem = ContactProblem(self, view, sites, impulsive=True)
        rows = problem.rows
        spots = [self._striking(view, k, rows) for k in sites]
        solution = problem.solution([spots])
        self._refuse_gain(view, rows, solution, sites)
        rebounds = self._lost_rebounds(view, touching, spots, sites, solution)
        if rebounds:  # what they would still take is that of the forces in the meantime
            spots = [replace(spot, target=0.0) if k in rebounds else spot for k, spot in zip(sites, spots, strict=True)]
            solution = problem.solution([spots])
        self._rebounds = rebounds
        v = view.free.v + view.response[:, rows] @ solution.forces
        _, forces = problem.open_forces(spots, solution)
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
        self,
        view: ContactView,
        touching: Sequence[int],
        spots: Sequence[Spot],
        sites: Sequence[int],
        solution: Solution,
    ) -> dict[int, float]:
        """Sites that bounce lower than what counts as closed, and the speeds by which all their bounces are left, m/s.

        The flights of bounces that follow each other last ``2 w (1 + e + e² + …) / a`` under an acceleration a.
        """
        lost, slowest = dict[int, float](), self._lost_speed(view, touching)
        for k, spot in zip(sites, spots, strict=True):
            if spot.normal is None or view.speeds[self.normal[k]] >= -view.rest:
                continue
            e, after = self._restitution(view, k), float(solution.rates[spot.normal])
            if 0 < e < 1 and after <= slowest:
                lost[k] = 2 * after / (1 - e)
        return lost

    def _striking(self, view: ContactView, k: int, rows: Sequence[int]) -> Spot:
        """What a place, or a friction in a joint, may do in an impact."""
        normal, tangent = self.places(k, rows)
        mu, _ = self._coefficients(k, view.free)
        stands = ("closed",) if tangent is None else ("sticks", "forth", "back")
        if normal is None:
            return Spot(normal, tangent, stands, mu, mu)
        target = -self._restitution(view, k) * min(view.speeds[self.normal[k]], 0.0)
        return Spot(normal, tangent, ("open", *stands), mu, mu, target)

    def _refuse_gain(self, view: ContactView, rows: Sequence[int], solution: Solution, sites: Sequence[int]) -> None:
        """Raise if restitution and friction add energy to an impact."""
        before, after = view.speeds[rows], solution.rates
        gain = solution.forces @ (before + after) / 2
        exchanged = np.abs(solution.forces) @ (np.abs(before) + np.abs(after)) / 2
        if gain > NEGLIGIBLE * exchanged:
            raise SimulationError(
                f"{self.names(sites)}: the impact at t = {view.free.t:.6g} s would gain {gain:.3g} J by Newton's "
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
        touching = [k for k in touching if view.speeds[self.normal[k]] <= slowest]
        sites = [k for k, site in enumerate(self.sites) if site.place is None or k in touching]
        problem, broken = ContactProblem(self, view, sites), self._broken(state, names, before)
        rows = problem.rows
        spots = [self._resting(view, k, rows, names) for k in sites]
        likely = [self._likely(spot, k, names, broken) for spot, k in zip(spots, sites, strict=True)]
        # where something breaks away, what shares forces with it would do so at once if it were at its limit
        attempts = [[replace(spot, clear=bool(broken)) for spot in likely], likely, spots]
        solution = problem.solution(attempts)
        self._settle(problem, view, sites, spots)
        statuses, held = list(self.free.statuses), list[int]()
        for k in ends:
            statuses[k] = "idle"
        for k, spot, status in zip(sites, spots, solution.statuses, strict=True):
            statuses[k] = "idle" if status == "open" else status
            pairs = (spot.normal, status not in ("open", "idle")), (spot.tangent, status in ("sticks", "shares"))
            held += [rows[row] for row, holds in pairs if holds and row is not None]
        for k in broken:
            if not view.is_held(self.tangent[k], held):
                statuses[k] = statuses[k].removeprefix("pulled ")
        found = [
            "open" if statuses[k] == "idle" and not view.is_held(self.normal[k], held) else statuses[k] for k in sites
        ]
        shares = tuple((sites[one], sites[other], ratio) for one, other, ratio in solution.shares)
        solution = replace(solution, statuses=tuple(found))
        open_forces, _ = problem.open_forces(spots, solution)
        mode = ContactMode(tuple(statuses), shares, open_forces)
        v = view.at_rest(held)
        state = self.at(mode, state.t, state.q, v, state.z)
        if state.obstacle is not None:
            raise state.obstacle
        return mode, state

    def _settle(self, problem: ContactProblem, view: ContactView, sites: Sequence[int], spots: Sequence[Spot]) -> None:
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
        rates = problem.solution([flying]).rates
        for k, speed in rebounds.items():
            falls = -float(rates[problem.rows.index(self.normal[k])])
            if falls > 0:
                self.settling[f"{self.sites[k].name} touches"] = view.free.t + speed / falls

    def _resting(self, view: ContactView, k: int, rows: Sequence[int], names: set[str]) -> Spot:
        """What a site that is closed, or a friction, may do from an instant on."""
        normal, tangent = self.places(k, rows)
        options: tuple[str, ...] = ("closed",) if tangent is None else ("sticks", "forth", "back")
        speed = 0.0 if tangent is None else float(view.speeds[self.tangent[k]])
        rests = abs(speed) <= view.rest or f"{self.sites[k].name} stops" in names
        sliding, static = self._coefficients(k, view.free)
        if not rests:
            options = ("forth" if speed > 0 else "back",)
        elif tangent is not None and static > sliding:
            options = ("sticks", "pulled forth", "pulled back", "forth", "back")
        if normal is not None:
            options = (*options, "open")
        return Spot(normal, tangent, options, sliding, static, rests=rests)

    def _lost_speed(self, view: ContactView, touching: Sequence[int]) -> float:
        """Speed of parting below which a place stays closed: it would rise to where it still counts as closed, m/s."""
        pressing = max(0.0, -float(np.min(view.rates[[self.normal[k] for k in touching]], initial=0.0)))
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
