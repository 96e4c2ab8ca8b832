"""Check of a model: degrees of freedom, redundant and contradictory rows, singular poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arguments.values import parameter_vector
from ..assembly.pose import OPEN, PoseProblem
from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import AssemblyError
from ..model.mechanism import Mechanism
from ..numerics.least_squares import largest, solve
from ..numerics.rank import analyse_rank, dependent_rows, rows_taking_part, unit_rows
from ..results.state import State
from ..results.validity import broken_at_pose, turning_angles
from ..simulation.stick_slip.friction_modes import without_exact_friction
from .singular import describe_singularity

#: How far a pose is moved along the free motions to see whether a loss of rank is particular to it.
EXCURSION = 0.03


@dataclass(frozen=True)
class Report:
    """What was found in a model; prints as a table.

    Attributes
    ----------
    degrees_of_freedom : int
        Coordinates less independent rows, in a pose that is not singular.
    gruebler : int
        Coordinates less rows: the count by hand, wrong where rows are redundant.
    redundant_rows : int
        Rows that others imply.
    redundant : tuple of str
        Names of rows that may be left out, one for each redundant row.
    dependent : tuple of str
        All rows that take part in a dependency.
    not_unique : tuple of str
        Joints and drivers whose reactions are not unique.
    contradictory : tuple of str
        Rows that cannot be met together, in their positions or in their velocities.
    residuals : dict of str to float
        What stays open by element, where the mechanism cannot be assembled.
    singular : {"", "lock-up", "bifurcation"}
        What the pose is, where it is singular.
    singular_rows : tuple of str
        Rows that depend on each other in the singular pose alone.
    unused_bodies : tuple of str
        Bodies that no joint holds and no force but gravity acts on.
    without_mass : tuple of str
        Coordinates in which something moves that has no mass.
    remarks : tuple of str
        What elements take for granted and the pose, or the free motions, do not keep to.
    """

    degrees_of_freedom: int
    gruebler: int
    coordinates: int
    rows: int
    redundant_rows: int = 0
    redundant: tuple[str, ...] = ()
    dependent: tuple[str, ...] = ()
    not_unique: tuple[str, ...] = ()
    contradictory: tuple[str, ...] = ()
    residuals: dict[str, float] = field(default_factory=dict)
    singular: str = ""
    singular_rows: tuple[str, ...] = ()
    unused_bodies: tuple[str, ...] = ()
    without_mass: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether the mechanism can be assembled and simulated as it stands."""
        return not (self.contradictory or self.residuals or self.singular or self.without_mass)

    def __str__(self) -> str:
        lines = [
            ("degrees of freedom", str(self.degrees_of_freedom)),
            ("by Grübler's count", f"{self.coordinates} coordinates - {self.rows} rows = {self.gruebler}"),
            ("redundant rows", _count(self.redundant_rows, self.redundant)),
        ]
        optional = (
            ("  they depend on", ", ".join(self.dependent)),
            ("reactions not unique", ", ".join(self.not_unique)),
            ("contradictory rows", ", ".join(self.contradictory)),
            ("left open", ", ".join(f"{name} ({value:.3g})" for name, value in self.residuals.items())),
            ("singular pose", f"{self.singular}: {', '.join(self.singular_rows)}" if self.singular else ""),
            ("unused bodies", ", ".join(self.unused_bodies)),
            ("moves without mass", ", ".join(self.without_mass)),
            ("remarks", "; ".join(self.remarks)),
        )
        lines += [(name, value) for name, value in optional if value]
        width = max(len(name) for name, _ in lines)
        return "\n".join(f"{name:<{width}}  {value}" for name, value in lines)


def _count(number: int, names: tuple[str, ...]) -> str:
    return f"{number}" + (f": {', '.join(names)}" if names else "")


def check(mechanism: Mechanism, state: State | None = None, *, parameters: Any = None) -> Report:
    """Look a model over.

    The rank of ``Phi_q`` is found in the assembled pose and in poses nearby
    that the joints allow. What depends on each other everywhere is redundant;
    what does so in this pose alone makes it singular.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    state : State, optional
        The pose to look at; the assembled estimate where none is given.
    parameters : mapping, optional
        Parameter to number.

    Returns
    -------
    Report
        Also where the mechanism cannot be assembled.

    References
    ----------
    Haug 1989, sections 3.7 (singular configurations) and 4.4 (redundant constraints).
    """
    eom = equations(without_exact_friction(mechanism))
    numeric = NumericEquations(eom, parameter_vector(eom, parameters) if state is None else state.parameters)
    t = 0.0 if state is None else state.t
    n, m = eom.q.numel(), eom.lam.numel()
    open_rows: dict[str, float] = {}
    if state is not None:
        q = np.atleast_1d(state[eom.q])
    else:
        q, open_rows = _pose(numeric, t)
    here = numeric.rank(t, q)
    generic_pose, generic = _generic(numeric, t, q) if not open_rows else (q, here)
    dependent = rows_taking_part(generic.null_rows)
    names = eom.row_names
    kind, singular_rows = _singularity(numeric, t, q, here.rank < generic.rank)
    return Report(
        degrees_of_freedom=n - generic.rank,
        gruebler=n - m,
        coordinates=n,
        rows=m,
        redundant_rows=m - generic.rank,
        redundant=tuple(names[k] for k in _superfluous(numeric, t, generic_pose)),
        dependent=tuple(names[k] for k in dependent),
        not_unique=tuple(dict.fromkeys(eom.row_elements[k].name for k in dependent)),
        contradictory=_contradictory(numeric, t, q, here.null_rows, open_rows, singular=here.rank < generic.rank),
        residuals=open_rows,
        singular=kind,
        singular_rows=singular_rows,
        unused_bodies=_unused(mechanism),
        without_mass=tuple(numeric.motion_without_mass(t, generic_pose)),
        remarks=() if open_rows else _remarks(numeric, t, q),
    )


def generic_rank(numeric: NumericEquations, t: float, q: np.ndarray) -> int:
    """Rank of the Jacobian in poses near a consistent one, where that one may be singular."""
    return _generic(numeric, t, q)[1].rank


def _pose(numeric: NumericEquations, t: float) -> tuple[np.ndarray, dict[str, float]]:
    """Assembled pose; where there is none the least-squares one, and what stays open."""
    estimate, _, z = numeric.eom.estimate
    try:
        return PoseProblem(numeric, [], t, z).solve(estimate), {}
    except AssemblyError as error:
        closest = solve(lambda q: numeric.position(t, q), estimate, numeric.weights, step_limit=1.0)
        return closest.x, {name: value for name, value in error.residuals.items() if value > OPEN}


def _generic(numeric: NumericEquations, t: float, q: np.ndarray):
    """Pose near q, on the joints' manifold, where the rank is largest; drivers let go for the excursion."""
    kept = _without_drivers(numeric)

    def joints(pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi, jacobian = numeric.position(t, pose)
        return phi[kept], jacobian[kept]

    best = (q, numeric.rank(t, q))
    free = analyse_rank(joints(q)[1] * numeric.column_scale).null_columns
    generator = np.random.default_rng(1)
    for _ in range(3 if free.size else 0):
        direction = (free @ generator.standard_normal(free.shape[1])) * numeric.column_scale
        moved = solve(joints, q + EXCURSION * direction / largest(direction), numeric.weights, iterations=30)
        if moved.converged:
            found = numeric.rank(t, moved.x)
            if found.rank > best[1].rank:
                best = (moved.x, found)
    return best


def _remarks(numeric: NumericEquations, t: float, q: np.ndarray) -> tuple[str, ...]:
    """Return the messages of validity conditions that are broken at a pose, or by motions that the joints allow."""
    free = analyse_rank(numeric.position(t, q)[1][_without_drivers(numeric)] * numeric.column_scale).null_columns
    turning = turning_angles(numeric, t, q, free * numeric.column_scale[:, None])
    return tuple(dict.fromkeys((*broken_at_pose(numeric, t, q), *turning)))


def _without_drivers(numeric: NumericEquations) -> list[int]:
    """Places of the joints' rows among the position rows."""
    eom = numeric.eom
    drivers = {id(d) for d in eom.mechanism.drivers}
    return [k for k, row in enumerate(eom.position_rows) if id(eom.row_elements[row]) not in drivers]


def _superfluous(numeric: NumericEquations, t: float, q: np.ndarray) -> list[int]:
    return dependent_rows(unit_rows(numeric.velocity(t, q)[0] * numeric.column_scale))


def _contradictory(
    numeric: NumericEquations, t: float, q: np.ndarray, null_rows: np.ndarray, open_rows: Any, *, singular: bool
) -> tuple[str, ...]:
    """Rows of a dependency whose residuals, or whose ``nu``, do not cancel: they cannot hold together."""
    eom = numeric.eom
    if open_rows:
        wanted = np.zeros(eom.lam.numel())
        wanted[eom.position_rows] = numeric.position(t, q)[0]
    elif singular:  # what a driver asks for in a singular pose is told with that pose
        return ()
    else:
        wanted = numeric.velocity(t, q)[1]
    wanted = wanted / numeric.row_size(t, q)
    shares = [np.abs(combination * wanted).sum() for combination in null_rows]
    broken = [c for c, share in zip(null_rows, shares, strict=True) if abs(c @ wanted) > OPEN * max(1.0, share)]
    return tuple(eom.row_names[k] for k in rows_taking_part(np.array(broken).reshape(len(broken), null_rows.shape[1])))


def _singularity(numeric: NumericEquations, t: float, q: np.ndarray, singular: bool) -> tuple[str, tuple[str, ...]]:
    if not singular:
        return "", ()
    pose = describe_singularity(numeric, t, q)
    return pose.kind, pose.rows


def _unused(mechanism: Mechanism) -> tuple[str, ...]:
    used = {
        id(body)
        for element in mechanism.elements
        for body in element.bodies
        if len(element.bodies) < len(mechanism.bodies) or element.multipliers.numel() or len(element.markers)
    }
    if len(mechanism.bodies) == 1:
        return ()
    return tuple(body.name for body in mechanism.bodies if id(body) not in used)
