"""Mechanisms at rest whose dry friction sticks and whose rigid contacts are closed, and the laws by which they hold.

Of the reactions ``lam`` that balance the loads in a pose, all that the laws allow are possible: ``N >= 0`` of each
contact, ``|F| <= μ_s N`` of each friction. They are looked for by a linear program; if a load depends on reactions by
more than a plane, by one after the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.consistent_start import position_limits
from ..assembly.setup import Setup
from ..equations import equations
from ..equations.derivation import why_not_unique
from ..equations.numeric import NumericEquations
from ..errors import EquilibriumError, SingularityError
from ..model.forces.contact.rigid import RigidContact
from ..model.forces.friction.modes import held_at, switching, variant_in, without_exact_friction
from ..model.quantities import known_value
from ..model.symbols import Input, Parameter
from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from ..numerics.rank import analyse_rank
from ..numerics.tolerances import MET, NEGLIGIBLE
from ..results.state import State
from .search import LARGEST_STEP
from .statics import Statics

#: Linear programs for reactions on which limits of friction depend, at most.
PROGRAMS = 50


@dataclass(frozen=True, eq=False)
class Law:
    """A quantity that is not negative as long as a place holds.

    Attributes
    ----------
    place : str
        Kind and name of the element, and its place.
    slack : casadi.SX
        The quantity, N or N m.
    needed, available : casadi.SX
        Friction that holds the pose, and the largest; of a contact its normal force, and nothing; of the limit of an
        input neither.
    unit : str
        Of these.
    """

    place: str
    slack: ca.SX
    needed: ca.SX | None = None
    available: ca.SX | None = None
    unit: str = "N"

    @property
    def event(self) -> str:
        """What happens beyond it."""
        if self.needed is None:
            return f"{self.place} is at its limit"
        return f"{self.place} {'opens' if self.available is None else 'slides'}"


def laws_of_limits(load: Input | Parameter) -> list[Law]:
    """Return what keeps an input within its limits."""
    if not isinstance(load, Input):
        return []
    ends = (load.lower, load - load.lower), (load.upper, load.upper - load)
    return [Law(f"input '{load.label}'", ca.SX(slack)) for end, slack in ends if np.isfinite(end)]


class Held:
    """What of a mechanism holds at rest in a pose: friction sticks, contacts that touch are closed.

    Parameters
    ----------
    setup : Setup
        Setup of the whole mechanism.
    start : State
        The pose, of the mechanism in which nothing sticks or touches.

    Attributes
    ----------
    mechanism : Mechanism
        The mechanism held there, by rows of positions.
    laws : tuple of Law
        By which it holds.

    Raises
    ------
    EquilibriumError
        If outlines penetrate each other.
    SingularityError
        If redundant joints leave the load of a friction open.
    """

    def __init__(self, setup: Setup, start: State):
        self.whole = setup.mechanism
        self._near = float(position_limits(free_numeric(setup), np.array([False]))[0])
        closed = {e: self._closed(e, start) for e in switching(self.whole) if isinstance(e, RigidContact)}
        senses = tuple(self._sense(e, closed.get(e, [])) for e in switching(self.whole))
        eom, variant = start.equations, variant_in(self.whole, senses)
        pose = np.atleast_1d(start[eom.q])
        self.mechanism = held_at(variant, self.whole, eom.q, eom.v, pose)
        self.numeric = setup.numeric_of(self.mechanism)
        self._closed_places = closed
        self.laws = tuple(law for e in switching(self.whole) for law in self._laws(e))
        self._refuse_open_loads(free_numeric(setup), setup.time, pose)

    def _refuse_open_loads(self, free: NumericEquations, time: float, pose: np.ndarray) -> None:
        """Raise if redundant joints may squeeze what rubs as they like."""
        if not free.has_redundant_rows(time, pose):
            return
        shared = np.any(np.abs(free.rank(time, pose).null_rows) > NEGLIGIBLE, axis=0)
        open_ = free.eom.lam[np.flatnonzero(shared).tolist()]
        limits = [(law.place, law.available) for law in self.laws if law.available is not None]
        names = [place for place, limit in limits if ca.depends_on(limit, open_)]
        if names:
            raise SingularityError(why_not_unique(list(dict.fromkeys(names))))

    @staticmethod
    def _sense(element: Any, closed: Sequence[int]) -> Any:
        if not isinstance(element, RigidContact):
            return tuple("sticks" for _ in element.frictions) if isinstance(element.free_mode, tuple) else "sticks"
        stands = "closed" if element.friction is None else "sticks"
        return tuple(stands if k in closed else "open" for k in range(len(element.places)))

    def _closed(self, contact: RigidContact, start: State) -> list[int]:
        """Places of a contact that touch."""
        closed = []
        for k, place in enumerate(contact.places):
            gap, within = float(start[contact.gaps[k]]), place.touch.within
            if gap < -self._near:
                raise EquilibriumError(
                    f"{contact.description}: the outlines penetrate each other by {-gap:.3g} m; start with a gap that "
                    "is not negative"
                )
            if gap <= self._near and (within is None or float(start[within]) >= -self._near):
                closed.append(k)
        return closed

    def _laws(self, element: Any) -> list[Law]:
        if isinstance(element, RigidContact):
            return [law for k in self._closed_places[element] for law in self._laws_of_place(element, k)]
        eom = equations(self.mechanism)
        pulls = {friction: eom.lam[eom.row_names.index(friction.sticking_row)] for friction in element.frictions}
        return [
            Law(friction.description, limit - sign * pull, sign * pull, ca.SX(limit), friction.units[1])
            for friction, pull in pulls.items()
            for sign, limit in zip((1, -1), friction.limits_of_pull, strict=True)
            if known_value(limit) != np.inf
        ]

    @staticmethod
    def _laws_of_place(contact: RigidContact, k: int) -> list[Law]:
        name = contact.description if len(contact.places) == 1 else f"{contact.description}, place {k},"
        normal, friction, law = contact.normal_forces[k], contact.friction_forces[k], contact.friction
        laws = [Law(name, normal, normal)]
        if law is not None:
            limit = law.static_coefficient * normal  # type: ignore[attr-defined]
            laws += [Law(name, limit - sign * friction, sign * friction, limit) for sign in (1, -1)]
        return laws

    def multipliers(self, lam: np.ndarray) -> np.ndarray:
        """Multipliers of the whole mechanism, from those of the held one; of what is open they are zero."""
        names = equations(self.mechanism).row_names
        rows = equations(self.whole).row_names
        return np.array([lam[names.index(name)] if name in names else 0.0 for name in rows])

    def check(self, statics: Statics, x: np.ndarray) -> np.ndarray:
        """Return an equilibrium of the held mechanism with reactions that the laws allow.

        These are the ones of least norm if they hold, else those with the largest margins.

        Raises
        ------
        EquilibriumError
            If there are none: the place that gives, the force it needs, and what it has.
        """
        self._refuse_penetration(statics, x)
        program = HoldingProgram(statics, self.laws)
        if statics.reactions_are_free:
            q, z, _, y = statics.split(x)
            x = statics.join(q, z, statics.of_least_norm(x), y)
        if not program.holds(x):
            x = program.with_largest_margin(x)
        if not program.holds(x):
            raise EquilibriumError(f"equilibrium: the pose does not hold: {program.why(x)}", time=statics.t)
        return x

    def _refuse_penetration(self, statics: Statics, x: np.ndarray) -> None:
        q = statics.split(x)[0]
        for contact in self._closed_places:
            gaps = ca.Function("gaps", [statics.eom.t, statics.eom.q, statics.eom.p], [contact.gaps])
            deepest = float(np.min(gaps(statics.t, q, statics.parameters(x)).full()))
            if deepest < -self._near:
                raise EquilibriumError(
                    f"equilibrium: on the way to rest the outlines of {contact.description} came to penetrate each "
                    f"other by {-deepest:.3g} m; start from a pose in which they touch",
                    time=statics.t,
                )


class HoldingProgram:
    """Linear programs for reactions, and for a load, that laws allow.

    Parameters
    ----------
    statics : Statics
        Equations of the held mechanism; its last unknown is the load if there is one.
    laws : sequence of Law
        The laws.
    """

    def __init__(self, statics: Statics, laws: Sequence[Law]):
        self._statics, self._laws = statics, tuple(laws)
        none = ca.SX(0, 1)
        self._slacks = statics.function(ca.vertcat(none, *[law.slack for law in laws]))
        forces = [law.needed for law in laws] + [law.available for law in laws]
        self._forces = statics.function(ca.vertcat(none, *[ca.SX(0) if force is None else force for force in forces]))

    def _unit(self, x: np.ndarray) -> float:
        """Force that is typical of the reactions, the limits of friction and the load, N."""
        statics = self._statics
        _, _, reactions, load = statics.split(x)
        forces = [largest(self._forces(x)[0]), largest(reactions)]
        if load.size and not self._limits_bend:  # what is left where it lifts off
            slopes = statics.rows(x)[1][: statics.n, -1]
            forces.append(largest(statics.numeric.column_scale * slopes * load[-1]))
        return max(forces) or 1.0

    def holds(self, x: np.ndarray) -> bool:
        """True if all laws are met, but for rounding."""
        return bool(np.min(self._slacks(x)[0], initial=0.0) >= -NEGLIGIBLE * self._unit(x))

    def why(self, x: np.ndarray) -> str:
        """The place that gives, in words."""
        k = int(np.argmin(self._slacks(x)[0]))
        law, count = self._laws[k], len(self._laws)
        needed, available = self._forces(x)[0][[k, count + k]]
        if law.needed is None:
            return f"{law.place} would be beyond its limit by {-self._slacks(x)[0][k]:.6g}"
        if law.available is None:
            return (
                f"{law.place} would have to pull with {-needed:.6g} N, so it opens; start from a pose in which it does "
                "not touch, or change the loads"
            )
        return (
            f"{law.place} would have to hold {needed:.6g} {law.unit} and holds {available:.6g} {law.unit}, so it "
            "slides; let it hold more, change the loads (holding_range gives those that hold), or start from another "
            "pose"
        )

    def with_largest_margin(self, x: np.ndarray) -> np.ndarray:
        """Return the equilibrium with reactions of which the least slack is largest; as it is if they are unique."""
        statics = self._statics
        internal = analyse_rank(self._by_reactions(x)).null_columns
        if not internal.shape[1]:
            return x
        first = statics.n + statics.k
        for _ in range(PROGRAMS):
            unit, (slack, slopes) = self._unit(x), self._slacks(x)
            moved = slopes[:, first : first + statics.m] @ internal
            # a margin of the size of the load itself is enough: a wedge may be squeezed as one likes
            cost, bounds = np.r_[np.zeros(moved.shape[1]), -1.0], [(None, None)] * moved.shape[1] + [(None, 1.0)]
            found = linear_program(cost, np.hstack([-moved, np.ones((len(slack), 1))]), slack / unit, bounds=bounds)
            assert found.x is not None  # zero with a margin below all slacks is one
            step = unit * internal @ found.x[:-1]
            x = x.copy()
            x[first : first + statics.m] += step
            if largest(step) <= MET * unit or not self._limits_bend:
                break
        return x

    @cached_property
    def _limits_bend(self) -> bool:
        """True if a slack is not linear in the reactions."""
        lam = self._statics.eom.lam
        slacks = ca.vertcat(ca.SX(0, 1), *[law.slack for law in self._laws])
        return bool(ca.depends_on(ca.jacobian(slacks, lam), lam))

    def _by_reactions(self, x: np.ndarray) -> np.ndarray:
        """Slopes of the forces by the multipliers, scaled."""
        statics = self._statics
        first = statics.n + statics.k
        slope: np.ndarray = statics.rows(x)[1][: statics.n, first : first + statics.m]
        return statics.numeric.column_scale[:, None] * slope

    # --- loads ---------------------------------------------------------------------------------
    def extreme(self, x: np.ndarray, sign: int) -> tuple[np.ndarray | None, list[Law]]:
        """Return the equilibrium at the least (-1) or the largest (1) load that holds, and the laws that end it.

        None if there is no end.

        Raises
        ------
        EquilibriumError
            If no load holds, or no end is found.
        """
        statics = self._statics
        for _ in range(PROGRAMS):
            found, step, size = self._moved(x, sign)
            if found.status == 2:
                raise EquilibriumError(
                    f"holding_range: no load holds this pose; at {x[-1]:.6g} {self.why(x)}", time=statics.t
                )
            if found.status == 3:
                return None, []
            after = statics.displaced(x, step[: statics.n])
            if after is None:
                break
            after = np.concatenate([after[: statics.n], (x + step)[statics.n :]])
            change, x = step / size, after
            if largest(change) <= NEGLIGIBLE and self._is_balanced(x) and self.holds(x):
                pressing = np.abs(found.ineqlin.marginals) > NEGLIGIBLE * largest(found.ineqlin.marginals)
                return x, [law for law, presses in zip(self._laws, pressing, strict=True) if presses]
        raise EquilibriumError(
            f"holding_range: the {'largest' if sign > 0 else 'least'} load that holds was not found; the search came "
            f"to {x[-1]:.6g}, where the mechanism may give way before anything slides: see equilibrium_path",
            time=statics.t,
        )

    def _is_balanced(self, x: np.ndarray) -> bool:
        values = self._statics.numeric.column_scale * self._statics.rows(x)[0][: self._statics.n]
        return largest(values) <= NEGLIGIBLE * self._unit(x) * max(1.0, self._statics.lever)

    def _moved(self, x: np.ndarray, sign: int) -> tuple[Any, np.ndarray, np.ndarray]:
        """Program for the change of the unknowns by which the load moves most; its answer, the change, and sizes."""
        statics = self._statics
        c, n, k = statics.numeric.column_scale, statics.n, statics.k
        values, slopes = statics.rows(x)
        basis, unit = statics.stiffness(x).basis, self._unit(x)
        free = basis.shape[1]
        by_load = largest(c * slopes[:n, -1])
        load = max(abs(x[-1]), unit / by_load if by_load else 0.0)
        # free directions, first-order states, multipliers and the load, each in its own size
        sizes = np.r_[np.full(free, statics.lever), np.ones(k), np.full(statics.m, unit), load]
        to_x = (
            np.block([[basis, np.zeros((n, x.size - n))], [np.zeros((x.size - n, free)), np.eye(x.size - n)]]) * sizes
        )
        rows = np.r_[0:n, statics.rates.start : statics.rates.stop]
        weights = np.r_[c, np.ones(k)]
        equal, right = weights[:, None] * slopes[rows] @ to_x, -weights * values[rows]
        length = np.max(np.abs(equal), axis=1, initial=0.0)
        length = np.where(length > 0, length, 1.0)
        slack, by_x = self._slacks(x)
        bounds = [(-LARGEST_STEP, LARGEST_STEP)] * free + [(None, None)] * (len(sizes) - free)
        cost = np.zeros(len(sizes))
        cost[-1] = -sign
        found = linear_program(
            cost, -by_x @ to_x / unit, slack / unit, equal / length[:, None], right / length, bounds=bounds
        )
        step = np.zeros(x.size) if found.x is None else to_x @ found.x
        return found, step, np.r_[statics.lever * c, np.ones(k), np.full(statics.m, unit), load]


def linear_program(
    cost: np.ndarray,
    upper: np.ndarray,
    limits: np.ndarray,
    equal: np.ndarray | None = None,
    right: np.ndarray | None = None,
    *,
    bounds: Any,
) -> Any:
    """Least ``cost · y`` with ``upper y <= limits`` and ``equal y = right``: a vertex, by the simplex method."""
    from scipy.optimize import linprog

    return linprog(cost, upper, limits, equal, right, bounds, method="highs-ds")


def free_numeric(setup: Setup) -> NumericEquations:
    """Equations in which nothing sticks or touches, at the values of the parameters."""
    return setup.numeric_of(without_exact_friction(setup.mechanism))
