"""Exchanges of equal chains: linkages that differ in which of two equal chains is which are one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import casadi as ca
import numpy as np

from ..model.symbols import symbols_of
from ..numerics.symbolic import symbolic
from .positions import Positions

#: Bodies up to which all orders of them are looked at.
MOST_BODIES = 7
#: Difference of rows that is rounding, relative to their size.
SAME = 1e-9


@symbolic
def exchanges(positions: Positions) -> list[np.ndarray]:
    """Orders of the unknowns that leave all rows and loads what they are, but for the names of bodies; first as it is.

    The bodies of the linkage are exchanged in every way that takes joints to joints of the same kind; the unknowns of
    their markers go along. Whether rows, masses and forces are the same is seen by their values at a random point.
    """
    n = len(positions.unknowns)
    found = [np.arange(n)]
    bodies = positions.mechanism.bodies
    if len(bodies) > MOST_BODIES:
        return found
    rows = _Rows(positions)
    for order in permutations(range(len(bodies))):
        if order == tuple(range(len(bodies))):
            continue
        places = _places(positions, order)
        if places is not None and rows.are_same(order, places):
            found.append(np.argsort(places))
    return found


def _places(positions: Positions, order: tuple[int, ...]) -> np.ndarray | None:
    """Place to which each unknown goes if bodies are exchanged; None if joints do not correspond."""
    mechanism, number = positions.mechanism, {body: k for k, body in enumerate(positions.mechanism.bodies)}
    to = {body: mechanism.bodies[order[k]] for body, k in number.items()}
    unknown = {p.element_hash(): k for k, p in enumerate(ca.vertsplit(positions.p))}
    left, moved = list(mechanism.joints), dict[int, int]()
    for joint in mechanism.joints:
        wanted = [to.get(marker.body, marker.body) for marker in joint.markers]
        twin = next((j for j in left if type(j) is type(joint) and _order(j, wanted) is not None), None)
        if twin is None:
            return None
        left.remove(twin)
        for marker, k in zip(joint.markers, _order(twin, wanted) or [], strict=True):
            if not _move(marker.local, twin.markers[k].local, unknown, moved):
                return None
    places = np.array([moved.get(k, k) for k in range(len(unknown))])
    return places if len(set(places.tolist())) == places.size else None


def _move(here: ca.SX, there: ca.SX, unknown: dict[int, int], moved: dict[int, int]) -> bool:
    """Enter where the unknowns of a place go, if it goes to another one; False if they go elsewhere already."""
    for one, other in zip(ca.vertsplit(here), ca.vertsplit(there), strict=True):
        # expressions of one form hold their symbols in one order; whether they are of one is seen by values
        inside = [[unknown.get(x.element_hash()) for x in symbols_of(e)] for e in (one, other)]
        if len(inside[0]) != len(inside[1]):
            return False
        for place, image in zip(*inside, strict=True):
            known = place is not None and image is not None
            if known and moved.setdefault(place, image) != image:
                return False
    return True


def _order(joint: object, bodies: list[object]) -> list[int] | None:
    """Order of the markers of a joint in which their bodies are given ones."""
    own = [marker.body for marker in joint.markers]  # type: ignore[attr-defined]
    for order in permutations(range(len(own))):
        if len(own) == len(bodies) and all(own[k] is body for k, body in zip(order, bodies, strict=True)):
            return list(order)
    return None


class _Rows:
    """Values of all rows, masses and forces at a random point, rows without order and sign."""

    def __init__(self, positions: Positions):
        eom = positions.eom
        random = np.random.default_rng(0)
        self._q, self._p = random.normal(size=eom.q.numel()), random.normal(size=positions.p.numel())
        relations = [[positions._with_known(c.expression) for c in each] for each in positions.relations]
        groups = [positions._with_known(eom.Phi), *(ca.vertcat(*each) for each in relations)]
        held = positions.fixed_rows[: positions.held]
        sizes = ca.DM([row.size for row in (*held, *positions.limit_rows)])
        groups.append(ca.vertcat(positions.fixed[: positions.held], positions.limits) * sizes)
        self._function = ca.Function("rows", [eom.q, positions.p], [ca.densify(group) for group in groups])
        self._values = list(self._sorted(self._q, self._p))
        # torques of inputs are whatever they must be; all other loads and the masses belong to bodies
        self._v = random.normal(size=eom.q.numel())
        loads = ca.substitute(eom.Q, ca.vertcat(eom.u, eom.lam), ca.SX.zeros(eom.u.numel() + eom.lam.numel()))
        of_bodies = positions._with_known(ca.horzcat(eom.mass_diagonal, loads))
        self._of_bodies = ca.Function("loads", [eom.q, eom.v, eom.z, positions.p], [ca.densify(of_bodies)])

    def _sorted(self, q: np.ndarray, p: np.ndarray) -> Iterator[np.ndarray]:
        results = self._function(q, p)
        for group in results if isinstance(results, tuple | list) else (results,):
            yield np.sort(np.abs(group.full().ravel()))

    def are_same(self, order: tuple[int, ...], places: np.ndarray) -> bool:
        """True if the rows are the same after an exchange of bodies and unknowns."""
        moved = np.arange(self._q.size)
        for k, to in enumerate(order):
            moved[3 * to : 3 * to + 3] = np.arange(3 * k, 3 * k + 3)
        q, p = self._q[moved], np.empty_like(self._p)
        p[places] = self._p
        states = np.ones(self._of_bodies.numel_in(2))
        loads = self._of_bodies(self._q, self._v, states, self._p).full()[moved]
        exchanged = self._of_bodies(q, self._v[moved], states, p).full()
        pairs = [*zip(self._values, self._sorted(q, p), strict=True), (loads, exchanged)]
        return all(np.allclose(here, there, rtol=SAME, atol=SAME) for here, there in pairs)
