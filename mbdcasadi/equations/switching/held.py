"""Equations of motion in which whatever jumps is held on one side, the sides being parameters."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ...model.symbols import Parameter
from ...numerics.graph import operations
from ...numerics.operations import BENDING
from ..derivation import Equations
from ..numeric import NumericEquations
from .continuity import Surroundings, continuous_switches, switches_without_value
from .switches import Switch, hold, jumps_anywhere, strictly_compared

#: Typical sizes of velocities, accelerations and first-order states, of multipliers and inputs, and of times.
RATES, LOADS, TIMES = 3.0, 10.0, 3.0


@dataclass(frozen=True, eq=False)
class JumpingPart:
    """Expressions of one element, state or input in which something jumps.

    Attributes
    ----------
    kind : {"rows", "rate", "force", "input", "integrand"}
        Role in the equations.
    place : int or tuple of int
        Its rows, or its position among those of its kind.
    expressions : tuple of casadi.SX
        Of rows ``Phi``, ``Phi_q``, ``nu`` and ``gamma``; of a force its share of Q; else one expression; each
        :func:`~.switches.strictly_compared`.
    description : str
        To whom they belong, in words.
    nodes, continuous : frozenset of int
        Operations that jump, and those of them over which the expressions are continuous nevertheless.
    smooth : frozenset of int
        Switches over which nothing need be held: these, or those over which slopes and curvatures are continuous too.
    roots : frozenset of int
        Switches over which nothing can be held, as powers of a penetration have no value beyond.
    bends : bool
        True if slopes and curvatures count.
    """

    kind: str
    place: int | tuple[int, ...]
    expressions: tuple[ca.SX, ...]
    description: str
    nodes: frozenset[int]
    continuous: frozenset[int]
    smooth: frozenset[int]
    roots: frozenset[int] = frozenset()
    bends: bool = False


def jumping_parts(numeric: NumericEquations, *, bends: bool = False) -> tuple[JumpingPart, ...]:
    """Parts of the equations of motion in which a value jumps, or with `bends` a slope; found once for a mechanism."""
    return numeric.eom.mechanism.cache.get_or_create(("jumping parts", bends), lambda: tuple(_parts(numeric, bends)))


def _parts(numeric: NumericEquations, bends: bool) -> list[JumpingPart]:
    eom = numeric.eom
    if not jumps_anywhere([eom.Q, eom.z_rate, eom.gamma, eom.nu, eom.Phi_q, eom.Phi], bends=bends):
        return []
    parts: list[JumpingPart] = []
    for element in eom.mechanism.constraints:
        rows = [k for k, owner in enumerate(eom.row_elements) if owner is element]
        levels = eom.Phi[_among_positions(eom, rows)], eom.Phi_q[rows, :], eom.nu[rows], eom.gamma[rows]
        parts += part_of(numeric, "rows", tuple(rows), levels, element.description, bends=bends)
    for k, state in enumerate(eom.mechanism.states):
        description = f"the rate of state variable '{state.label}'"
        parts += part_of(numeric, "rate", k, (eom.z_rate[k],), description, bends=bends)
    for k, element in enumerate(eom.mechanism.elements):
        work = [ca.SX(x) for pair in element.virtual_work for x in pair]
        if work and jumps_anywhere(work, bends=bends):
            share = (eom.generalised_forces([element]),)
            parts += part_of(numeric, "force", k, share, element.description, bends=bends)
    return parts


def part_of(
    numeric: NumericEquations,
    kind: str,
    place: int | tuple[int, ...],
    expressions: tuple[ca.SX, ...],
    description: str,
    *,
    bends: bool = False,
) -> list[JumpingPart]:
    """Return expressions as a part, if something jumps in them, or with `bends` in their slopes; else nothing."""
    if not jumps_anywhere(expressions, bends=bends):
        return []
    eom = numeric.eom
    expressions = tuple(strictly_compared(expressions))
    held, switches = hold(expressions, bends=bends)
    n, loads = eom.q.numel(), eom.lam.numel() + eom.u.numel()
    symbols = ca.vertcat(eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u)
    centre = np.concatenate([[0.0], *eom.estimate[:2], np.zeros(n), eom.estimate[2], np.zeros(loads)])
    sizes = np.r_[TIMES, numeric.scale.coordinates, np.full(2 * n + eom.z.numel(), RATES), np.full(loads, LOADS)]
    # further symbols, as levels and channels of inputs, are loads
    known = {s.element_hash() for s in ca.vertsplit(ca.vertcat(symbols, eom.p))}
    others = [s for s in ca.symvar(ca.veccat(*expressions)) if s.element_hash() not in known]
    symbols, centre = ca.vertcat(symbols, *others), np.r_[centre, np.zeros(len(others))]
    size = np.r_[sizes, np.full(len(others), LOADS)]
    # positions do not jump in the state: a row that does, as by the angle of a direction, is one turn off
    jumping = held[1:] if kind == "rows" else held
    around = Surroundings(symbols, centre, size, eom.p, numeric.p)
    smooth = continuous = frozenset(continuous_switches(jumping, switches, around))
    roots: frozenset[int] = frozenset()
    if bends:
        levels = [ca.veccat(*jumping)]
        for _ in range(2):
            levels.append(ca.vertcat(ca.SX(0, 1), *ca.jacobian(levels[-1], symbols).nonzeros()))
        smooth = continuous & continuous_switches(levels, switches, around)
        continuous |= {node.element_hash() for _, node in operations(expressions, BENDING)}
        roots = continuous & switches_without_value(levels, switches, around)
        smooth |= roots
    nodes = frozenset(switch.node for switch in switches)
    return [JumpingPart(kind, place, expressions, description, nodes, continuous, smooth, roots, bends)]


def _among_positions(eom: Equations, rows: Sequence[int]) -> list[int]:
    """Places of rows among those of ``Phi``, which has position rows alone."""
    return np.flatnonzero(np.isin(eom.position_rows, list(rows))).tolist()


class HeldEquations(Equations):
    """Equations of motion whose switches are held: their sides follow the parameters in `p`.

    Parameters
    ----------
    parts : sequence of JumpingPart
        Their parts in which something jumps, and of inputs and integrands.
    free : collection of int
        Operations that are left as they are, beside those that are continuous.

    Attributes
    ----------
    switches : tuple of Switch
        Switches that are held.
    held : dict of (str, int or tuple of int) to tuple of casadi.SX
        Expressions of the parts by kind and place.
    """

    def __init__(self, eom: Equations, parts: Sequence[JumpingPart], free: Collection[int]):
        for name in _SHARED:
            setattr(self, name, getattr(eom, name))
        self.held: dict[tuple[str, int | tuple[int, ...]], list[ca.SX]] = {}
        switches: list[Switch] = []
        for part in parts:
            left = {*part.smooth, *free}

            def side(name: str, owner: str = f"{part.description}, {part.kind}") -> Parameter:
                return Parameter(f"{owner}, {name}", 0.0)

            held, found = hold(part.expressions, part.description, free=left, bends=part.bends, symbol=side)
            self.held[part.kind, part.place] = held
            switches += [replace(s, share=ca.SX(0)) if s.node in part.continuous else s for s in found]
        self.switches = tuple(switches)
        sides = tuple(switch.side for switch in switches)
        self.mechanism = eom.mechanism.replace(parameters=(*eom.mechanism.parameters, *sides))
        self.mechanism.cache.get_or_create("equations", lambda: self)
        self.p = ca.vertcat(eom.p, *sides)
        self._replace_parts(eom)

    @property
    def contents(self) -> None:
        """None: the equations are not those of the mechanism."""
        return None

    def _replace_parts(self, eom: Equations) -> None:
        forces = {place for kind, place in self.held if kind == "force"}
        smooth = [element for k, element in enumerate(eom.mechanism.elements) if k not in forces]
        self.Q = eom.Q if not forces else self.generalised_forces(smooth)
        for name in ("Phi", "Phi_q", "nu", "gamma", "z_rate"):
            setattr(self, name, ca.SX(getattr(eom, name)))
        for (kind, place), held in self.held.items():
            if kind == "force":
                self.Q = self.Q + held[0]
            elif kind == "rate":
                self.z_rate[place] = held[0]
            elif kind == "rows":
                rows = list(place) if isinstance(place, tuple) else [place]
                self.Phi[_among_positions(eom, rows)], self.Phi_q[rows, :] = held[0], held[1]
                self.nu[rows], self.gamma[rows] = held[2], held[3]


#: Terms that the equations share with those in which nothing is held.
_SHARED = (
    "t", "q", "v", "a", "z", "u", "lam", "mass_diagonal", "M", "coordinate_names", "row_names", "row_elements",
    "position_rows", "velocity_rows", "potential", "kinetic",
)  # fmt: skip
