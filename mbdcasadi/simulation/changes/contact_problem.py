"""The problem of some places at a state: the motion that meets the laws of contact and friction, and its forces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ...errors import SimulationError
from ...numerics.least_squares import largest
from ...numerics.tolerances import NEGLIGIBLE
from .complementarity import Complementarity, TooManyChoicesError
from .contact_sites import ContactSites, ContactView
from .friction_modes import FRICTION_TOLERANCE, NO_EFFECT, SENSE
from .shared_forces import Bearing, SharedForces
from .spots import Loads, Solution, Spot


class ContactProblem:
    """What some places may do at a state, by accelerations, or in an impact.

    Parameters
    ----------
    modes : ContactSites
        The places of the mechanism.
    view : ContactView
        The state.
    sites : sequence of int
        Those that are closed, and frictions in joints.
    impulsive : bool
        True for impulses and velocities, in place of forces and accelerations.

    Attributes
    ----------
    rows : list of int
        Rows of the places.
    """

    def __init__(self, modes: ContactSites, view: ContactView, sites: Sequence[int], *, impulsive: bool = False):
        self._modes, self._view, self._sites = modes, view, tuple(sites)
        self.rows, self._impulsive = modes.rows(sites), impulsive
        self._what = "velocities" if impulsive else "accelerations"
        self._loads = self._loads_of_frictions()

    def _loads_of_frictions(self) -> Loads | None:
        """Loads of the frictions in joints by the forces of the rows, or by their impulses; None if there are none."""
        places = self._modes.sites
        if all(places[k].place is not None for k in self._sites):
            return None
        eom = self._view.free.equations
        loads = ca.vertcat(*[places[k].load if places[k].place is None else ca.SX(0) for k in self._sites])
        slopes = ca.jacobian(loads, eom.lam)
        function = eom.function(ca.horzcat(loads, slopes))
        joints, arguments = self._view.joints[:, self.rows], list(self._view.free.arguments)
        given = np.zeros(eom.lam.numel()) if self._impulsive else self._view.free.lam
        arguments[5] = given
        finite = function(*arguments).full()[:, 0] if self._impulsive else 0.0  # which has no part in an instant

        def at(forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            arguments[5] = given + joints @ forces
            values = function(*arguments).full()
            return values[:, 0] - finite, values[:, 1:] @ joints

        acts = np.abs(joints) > NO_EFFECT * np.max(np.abs(joints), axis=1, keepdims=True, initial=0.0)
        needs = np.zeros(slopes.shape, int)
        needs[slopes.sparsity().row(), slopes.sparsity().get_col()] = 1
        return Loads(at, needs @ acts > 0)

    def solution(self, attempts: Sequence[Sequence[Spot]]) -> Solution:
        """The one motion that meets the laws: of the parts of the mechanism that do not act on each other, one each.

        Parameters
        ----------
        attempts : sequence of sequence of Spot
            What each place may be, in the order in which they are tried.

        Raises
        ------
        SimulationError
            If there is none, or more than one, and if there are too many choices.
        """
        view, rows, loads = self._view, self.rows, self._loads
        matrix, constant = view.matrix[np.ix_(rows, rows)], (view.speeds if self._impulsive else view.rates)[rows]
        alone = np.sum(view.rows[rows] ** 2 / self._modes.numeric(self._modes.free).weights, axis=1)
        whole = Complementarity(matrix, constant, alone, attempts[-1], loads)
        statuses, shares = np.full(len(self._sites), "", object), list[tuple[int, int, float]]()
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
            part = self._unique(problems, [self._sites[k] for k in own])
            forces[lines], rates[lines], statuses[own] = part.forces, part.rates, part.statuses
            shares += [(own[one], own[other], ratio) for one, other, ratio in part.shares]
        return Solution(tuple(statuses), forces, rates, tuple(shares))

    def _unique(self, attempts: Sequence[Complementarity], sites: Sequence[int]) -> Solution:
        """The one motion of some places that meets the laws, among the first choices that have any."""
        names, what, time = self._modes.names(sites), self._what, self._view.free.t
        for problem in attempts:
            try:
                found = problem.solutions()
            except TooManyChoicesError:
                raise SimulationError(
                    f"{names}: {len(sites)} places that act on each other are closed at t = {time:.6g} s, "
                    'more than are sorted out at once; take a Contact with a stiffness, and method="bdf"',
                    time=time,
                ) from None
            if not found:
                continue
            if problem.may_fall:  # what can stick does not slide
                found = [one for one in found if one.sticking == found[0].sticking]
            if any(problem.different(found[0], other) for other in found[1:]):
                raise SimulationError(
                    f"{names}: more than one set of {what} meets the laws of contact and friction at t = "
                    f"{time:.6g} s (Painlevé's paradox); lower the friction, or take a Contact with a stiffness",
                    time=time,
                )
            return found[0]
        if not attempts[-1].without_friction().solutions():
            raise SimulationError(
                f"{names}: joints, drivers and other contacts press the outlines into each other at t = "
                f"{time:.6g} s, and no force of contact can part them; let the prescribed motion end before, or "
                "let it act by a spring",
                time=time,
            )
        raise SimulationError(
            f"{names}: no {what} meet the laws of contact and friction at t = {time:.6g} s: friction is "
            "so large that it jams (Painlevé's paradox); lower the friction, or take a Contact with a stiffness",
            time=time,
        )

    def open_forces(self, spots: Sequence[Spot], solution: Solution) -> tuple[tuple[tuple[int, str], ...], np.ndarray]:
        """Sites whose forces the motion leaves open, with what each does there, and the forces of least norm (r,)."""
        forces, bearings, senses = solution.forces, dict[int, Bearing](), dict[int, float]()
        view, rows, modes = self._view, self.rows, self._modes
        given = np.zeros(len(spots)) if self._loads is None else self._loads.at(forces)[0]
        still = FRICTION_TOLERANCE * (largest(view.rates[rows]) + largest(solution.rates))
        for k, spot, status, load in zip(self._sites, spots, solution.statuses, given, strict=True):
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
        numeric = modes.numeric(modes.free)
        jacobian, _ = numeric.velocity(view.free.t, view.free.q, view.free.z)
        split = SharedForces(
            view.rows[rows], jacobian, numeric.column_scale, list(bearings.values()), modes.kept(senses)
        )
        if not split.directions.size:
            return (), forces
        forces = split.least(forces)
        moved = {row for row, size in enumerate(np.abs(split.directions).max(axis=1)) if size > NEGLIGIBLE}
        return tuple((k, b.status) for k, b in bearings.items() if moved & {b.normal, b.tangent}), forces
