"""Check of a model: degrees of freedom, redundant and contradictory rows, singular poses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..assembly.consistent_start import refuse_inconsistent
from ..assembly.impact import states_after
from ..assembly.pose import PoseProblem
from ..assembly.setup import Setup
from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ModelError
from ..model.forces.friction.modes import without_exact_friction
from ..model.mechanism import Mechanism
from ..numerics.console import keyboard_interrupts
from ..numerics.newton import solve
from ..numerics.rank import dependent_rows, rows_taking_part
from ..numerics.tolerances import MET
from ..results.notebook import html_table
from ..results.state import State
from ..results.validity import broken_at_pose, changing_quantities
from .mobility import Joints, Mobility, mobility
from .singular import describe_singularity


@dataclass(frozen=True)
class Report:
    """Findings about a model; prints as a table.

    Attributes
    ----------
    degrees_of_freedom : int
        Coordinates less independent rows, in a pose that is not singular.
    gruebler : int
        Coordinates less rows: the count by hand, wrong if rows are redundant.
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
        Gaps by element, if the mechanism cannot be assembled.
    singular : {"", "lock-up", "bifurcation", "shaky"}
        Kind of the pose, if it is singular: no velocity meets the drivers; several motions are possible; or an
        infinitesimal motion is, that goes nowhere, and reactions to loads along it grow without bound.
    singular_rows : tuple of str
        Rows that depend on each other in the singular pose alone.
    unused_bodies : tuple of str
        Bodies that no joint holds and no force but gravity acts on.
    without_mass : tuple of str
        Coordinates in which something moves that has no mass.
    remarks : tuple of str
        Conditions of validity of elements that the pose, or the free motions, break.
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
        """True if the mechanism can be assembled and simulated as it stands."""
        return not (self.contradictory or self.residuals or self.singular or self.without_mass)

    def __str__(self) -> str:
        lines = self._lines()
        width = max(len(name) for name, _ in lines)
        return "\n".join(f"{name:<{width}}  {value}" for name, value in lines)

    def _repr_html_(self) -> str:
        """The findings as a table, for notebooks."""
        verdict = "the mechanism can" if self.ok else "the mechanism cannot"
        return html_table(f"Report: {verdict} be simulated as it stands", self._lines())

    def _lines(self) -> list[tuple[str, str]]:
        """Findings by name."""
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
        return lines + [(name, value) for name, value in optional if value]


def _count(number: int, names: tuple[str, ...]) -> str:
    return f"{number}" + (f": {', '.join(names)}" if names else "")


@keyboard_interrupts("check")
def check(mechanism: Mechanism, state: State | None = None, *, parameters: Any = None) -> Report:
    """Check a model.

    The rank of ``Phi_q`` is found in the assembled pose and in poses nearby
    that the joints allow. What depends on each other everywhere is redundant;
    what does so in this pose alone makes it singular.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    state : State, optional
        The pose to look at; the assembled estimate if none is given. It brings along its parameters.
    parameters : mapping, optional
        Parameter to number, over those of the state.

    Returns
    -------
    Report
        Also if the mechanism cannot be assembled.

    References
    ----------
    Haug 1989, sections 3.7 (singular configurations) and 4.4 (redundant constraints).
    """
    if state is not None and not isinstance(state, State):
        raise ModelError(f"check: state= takes a State (from assemble, equilibrium or a trajectory), got {state!r}")
    t = 0.0 if state is None else state.t
    setup = Setup(mechanism, "check", t=t, initial=() if state is None else state, parameters=parameters)
    numeric = setup.numeric_of(without_exact_friction(mechanism))
    eom = numeric.eom
    n, m = eom.q.numel(), eom.lam.numel()
    open_rows: dict[str, float] = {}
    if state is not None:
        q, z = np.atleast_1d(state[eom.q]), states_after(eom.mechanism, state)
        refuse_inconsistent(numeric, state, t, q, np.atleast_1d(state[eom.v]), z)
    else:
        (q, open_rows), z = _pose(numeric, t), eom.estimate[2]
    here = numeric.rank(t, q)
    near = Mobility(here.rank, q, here) if open_rows else mobility(numeric, t, q)
    redundant = m - near.rank
    dependent = rows_taking_part(near.analysis.null_rows) if redundant else []
    names = eom.row_names
    pose = describe_singularity(numeric, t, q, z, near) if near.singular else None
    return Report(
        degrees_of_freedom=n - near.rank,
        gruebler=n - m,
        coordinates=n,
        rows=m,
        redundant_rows=redundant,
        redundant=tuple(names[k] for k in dependent_rows(numeric.scaled_jacobian(t, near.pose))[:redundant]),
        dependent=tuple(names[k] for k in dependent),
        not_unique=tuple(dict.fromkeys(eom.row_elements[k].name for k in dependent)),
        contradictory=_contradictory(numeric, t, q, z, here.null_rows, open_rows, singular=near.singular),
        residuals=open_rows,
        singular=pose.kind if pose else "",
        singular_rows=pose.rows if pose else (),
        unused_bodies=_unused(mechanism),
        without_mass=tuple(numeric.motion_without_mass(t, near.pose)),
        remarks=() if open_rows else _remarks(numeric, t, q),
    )


def _pose(numeric: NumericEquations, t: float) -> tuple[np.ndarray, dict[str, float]]:
    """Assembled pose; if there is none the least-squares one, and its gaps."""
    estimate, _, z = numeric.eom.estimate
    problem = PoseProblem(numeric, [], t, z)
    try:
        return problem.solve(estimate), {}
    except AssemblyError:
        sizes = numeric.scale.coordinates
        closest = solve(problem.rows_with([]), estimate, numeric.weights, sizes=sizes, step_limit=numeric.step_limit)
        return closest.x, problem.open_parts(closest.residual)


def _remarks(numeric: NumericEquations, t: float, q: np.ndarray) -> tuple[str, ...]:
    """Conditions of validity that a pose breaks, or the motions that the joints allow in it."""
    free = Joints(numeric, t).motions(q)
    changing = changing_quantities(numeric, t, q, free * numeric.column_scale[:, None])
    return tuple(dict.fromkeys((*broken_at_pose(numeric, t, q), *changing)))


def _contradictory(
    numeric: NumericEquations,
    t: float,
    q: np.ndarray,
    z: np.ndarray,
    null_rows: np.ndarray,
    open_rows: Any,
    *,
    singular: bool,
) -> tuple[str, ...]:
    """Rows of a dependency whose residuals, or whose ``nu``, do not cancel: they cannot hold together."""
    eom = numeric.eom
    if open_rows:
        wanted = np.zeros(eom.lam.numel())
        wanted[eom.position_rows] = numeric.position(t, q, z)[0]
    elif singular:  # what a driver asks for in a singular pose is reported with that pose
        return ()
    else:
        wanted = numeric.velocity(t, q, z)[1]
    wanted = wanted / numeric.row_size(t, q)
    shares = [np.abs(combination * wanted).sum() for combination in null_rows]
    broken = [c for c, share in zip(null_rows, shares, strict=True) if abs(c @ wanted) > MET * max(1.0, share)]
    return tuple(eom.row_names[k] for k in rows_taking_part(np.array(broken).reshape(len(broken), null_rows.shape[1])))


def _unused(mechanism: Mechanism) -> tuple[str, ...]:
    used = {
        body
        for element in mechanism.elements
        for body in element.bodies
        if len(element.bodies) < len(mechanism.bodies) or element.multipliers.numel() or len(element.markers)
    }
    if len(mechanism.bodies) == 1:
        return ()
    return tuple(body.name for body in mechanism.bodies if body not in used)
