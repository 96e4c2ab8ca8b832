"""Equilibrium: the state at rest in which all forces balance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.least_efforts import LeastEfforts
from ..arguments.values import inputs_and_parameters, position_in
from ..assembly.consistent_start import consistent_start
from ..assembly.setup import Setup
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, EquilibriumError, MechanismError, warn
from ..model.conditions import Condition, read_conditions
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..model.quantities import one_of
from ..model.symbols import Input, Parameter, place_of
from ..numerics.console import keyboard_interrupts
from ..numerics.least_squares import largest
from ..numerics.rank import analyse_rank, unit_rows
from ..results.state import Conditions, State
from ..results.validity import report_exceeded_limits, report_validity_at
from .amplification import amplification, warn_of
from .held import Held, free_numeric
from .search import newton, newton_nearby, to_stable, with_least_efforts
from .small_motions import SmallMotions
from .statics import Statics, Stiffness

#: Speed of a driver that counts as rest (m/s or rad/s).
REST_TOLERANCE = 1e-9
#: What helps if inputs do not hold a pose within their limits.
_MORE = "raise the limits, or name more inputs in unknowns="
#: Violation of an inequality that is rounding, in its own unit.
CONDITION_TOLERANCE = 1e-8


class Equilibrium(State):
    """A state at rest, and whether it is stable.

    Attributes
    ----------
    stable : bool
        True if small disturbances stay small: every free direction is held by
        stiffness, and no small motion grows, with the damping, the feedback
        and the first-order states that the model has (the eigenvalues of
        :func:`linearize`). A direction in which nothing pushes (a wheel that
        may turn) is not stable.
    stiffness : Stiffness
        Eigenvalues and directions of the reduced stiffness.
    small_motions : SmallMotions
        Eigenvalues and shapes of the small motions.
    """

    def __init__(self, statics: Statics, x: np.ndarray, held: Held | None = None):
        q, z, lam, _ = statics.split(x)
        mechanism, rest = statics.eom.mechanism, np.zeros(statics.n)
        if held is not None:
            mechanism, lam = held.whole, held.multipliers(lam)
        elif statics.reactions_are_free:
            lam = statics.of_least_norm(x)
        super().__init__(mechanism, statics.t, q, rest, rest, z, lam, statics.inputs(x), statics.parameters(x))
        self.stiffness: Stiffness = statics.stiffness(x)
        self.small_motions: SmallMotions = statics.small_motions(x)

    @property
    def stable(self) -> bool:
        """True if small disturbances stay small."""
        return self.stiffness.holds and not self.small_motions.grow

    def __repr__(self) -> str:
        least = self.stiffness.least
        held = "nothing is free to move" if np.isinf(least) else f"least reduced stiffness {least:.6g} N/m"
        growth = f"; small motions grow by {self.small_motions.growth:.6g} 1/s" if self.small_motions.grow else ""
        unstable = "not stable" if self.small_motions.grow or self.stiffness.pushes_away else "neutral"
        return f"{super().__repr__()}\n  {'stable' if self.stable else unstable} at rest; {held}{growth}"


def equilibrium(
    mechanism: Mechanism,
    conditions: Conditions = (),
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    *,
    unknowns: Sequence[Input | Parameter] = (),
    weights: Mapping[Input, float] | None = None,
    prefer: str = "stable",
    t: float = 0.0,
) -> Equilibrium:
    """Find the state at rest in which all forces balance.

    ``Q - Phi_q^T lam = 0``, ``Phi = 0`` and ``z_rate = 0`` at ``v = 0``. First-order states whose rates vanish at
    rest, whatever the pose (a spring in series, trapped oil), follow the motion from the start.

    Exact dry friction sticks where it starts, and rigid contacts that touch there stay closed, as long as there are
    reactions with ``N >= 0`` and ``|F| <= μ_s N``; :func:`holding_range` gives the loads at which there are.

    Parameters
    ----------
    mechanism : Mechanism
        The model. Drivers hold what they drive, and must be at rest.
    conditions : sequence of relations, or State, optional
        Start of the search: the pose that :func:`assemble` finds for them, or
        a state. Inequalities also hold for the result, which says which of
        several equilibria is meant. With ``unknowns=`` all of them hold for
        the result, and may then hold reactions, inputs and parameters.
    inputs : mapping of Input to number or expression, optional
        Values other than the inputs' own; feedback is taken at rest.
    parameters : mapping of Parameter to number, optional
        Values other than the parameters' own.
    unknowns : sequence of Input or Parameter, optional
        Found with the equilibrium, as many as there are equalities among the
        conditions: the torque that holds a pose, the counterweight that balances.
        Inputs may be more (two motors on one shaft, cables): in the pose, which the conditions must then determine,
        the sum of ``weight * input**2`` is least, with all of them within their limits.
    weights : mapping of Input to float, optional
        Positive weights of inputs in that sum; 1 for those that are not named.
    prefer : {"stable", "nearest"}
        "stable" goes downhill from the start, past unstable equilibria;
        "nearest" takes Newton's method to any. With `unknowns` it is "nearest".
    t : float, default 0
        Time at which drivers and forces are taken, s.

    Returns
    -------
    Equilibrium
        A State with ``.stable`` and ``.stiffness``. With redundant rows the multipliers are those of least norm; if
        friction does not hold these, those with the largest margin.

    Raises
    ------
    EquilibriumError
        If forces are left over: which, and in which coordinates; and if the pose is singular and no finite
        reactions hold the load; if friction slides or a contact opens: which, the force that it would have to hold, and
        what it holds; if inputs that are more than the pose needs do not hold it within their limits: which.
    ConditionError
        For conditions that no pose meets, or that do not match the unknowns.

    Warns
    -----
    MechanismWarning
        If the pose is singular, or so near to a singular one that the reactions are amplified a thousandfold; if
        first-order states remember more of the way to rest than the pose; if the pose is one that an element does not
        allow, such as a cable that would have to push; if an input is beyond its limits.

    References
    ----------
    Haug 1989, section 6.6 (equilibrium); Nikravesh, *Computer-Aided Analysis of Mechanical Systems*, 1988, ch. 14.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> rest = mbd.equilibrium(mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()]))
    >>> round(rest[arm.phi] / np.pi, 9), rest.stable
    (-0.5, True)
    """
    with keyboard_interrupts("equilibrium"):
        setup = Setup(mechanism, "equilibrium", t=t, initial=conditions, inputs=inputs, parameters=parameters)
        rest = equilibrium_of(setup, inputs_and_parameters(mechanism, unknowns, "unknowns="), prefer, weights)
        report_exceeded_limits(rest, "equilibrium")
        return rest


def equilibrium_of(
    setup: Setup, wanted: tuple[Any, ...] = (), prefer: str = "stable", weights: Mapping[Input, float] | None = None
) -> Equilibrium:
    """Find the equilibrium for arguments that are read; see :func:`equilibrium`.

    Parameters
    ----------
    setup : Setup
        With the conditions as its start.
    wanted : tuple of Input or Parameter
        The unknowns.
    prefer : {"stable", "nearest"}
        Direction of the search.
    weights : mapping of Input to float, optional
        Of inputs that are more than the equalities.
    """
    one_of(prefer, ("stable", "nearest"), "equilibrium", "prefer")
    conditions, time = setup.initial, setup.time
    free = free_numeric(setup)
    eom = free.eom
    rows = () if isinstance(conditions, State) else read_conditions(conditions)
    equalities = tuple(c for c in rows if c.equality) if wanted else ()
    efforts = [w for w in wanted if isinstance(w, Input)] if len(wanted) > len(equalities) else []
    if wanted and not efforts and len(equalities) != len(wanted):
        raise ConditionError(
            f"equilibrium: {len(wanted)} unknowns ({', '.join(w.label for w in wanted)}) need as many equalities "
            f"among the conditions, and there are {len(equalities)}"
        )
    if weights and not efforts:
        raise ConditionError("equilibrium: weights= goes with more inputs in unknowns= than equalities need")
    least = LeastEfforts(efforts, weights, "equilibrium", "unknowns=", "hold the pose", _MORE)
    start = start_of(setup, rows, bool(wanted))
    # the state may come from another mechanism on the same bodies
    q, z = (np.atleast_1d(start[group]) if group.numel() else np.zeros(0) for group in (eom.q, eom.z))
    _refuse_moving_drivers(free, time, q, z)
    held = Held(setup, start) if switching(setup.mechanism) else None
    numeric = free if held is None else held.numeric
    statics = Statics(numeric, setup.signals, time, (q, z), wanted, equalities)
    values = [value_of(w, eom, setup.p, start) for w in wanted]
    x = statics.join(q, z, np.zeros(statics.m), values)
    if efforts:
        places = [x.size - len(wanted) + k for k, w in enumerate(wanted) if isinstance(w, Input)]
        rest = _with_least_efforts(statics, x, least, places, held)
    else:
        rest = rest_near(statics, x, stable=prefer == "stable" and not wanted)
    if wanted:
        setup.mechanism.check_values(statics.parameters(rest))
    rest = rest if held is None else held.check(statics, rest)
    result = Equilibrium(statics, rest, held)
    _check_inequalities(rows, result)
    _check_reactions(statics, rest)
    report_validity_at(result, setup.mechanism, "equilibrium")
    by_the_way = statics.states_by_the_way(rest)
    if by_the_way:
        remember = f"s {', '.join(by_the_way)} remember" if len(by_the_way) > 1 else f" {by_the_way[0]} remembers"
        warn(
            f"equilibrium: the state variable{remember} the course and the speed of the way to rest: the rest that was "
            "found is one of several, that of the straight way from the start; simulate until the motion rests"
        )
    return result


def _with_least_efforts(
    statics: Statics, x: np.ndarray, least: LeastEfforts, places: Sequence[int], held: Held | None
) -> np.ndarray:
    """Return the equilibrium with the least inputs in a pose that is determined, or raise."""
    names = ", ".join(repr(u.label) for u in least.inputs)
    if held is not None:
        raise EquilibriumError(
            f"equilibrium: {names} are more inputs than equalities, and exact dry friction or a rigid contact holds a "
            "part of the load, of which the least efforts are not looked for; fix some of them by inputs="
        )
    slopes = np.delete(statics.rows(x)[1][:, : statics.n], np.r_[: statics.n, statics.rates], axis=0)
    free = statics.n - analyse_rank(unit_rows(slopes * statics.numeric.column_scale)).rank
    if free:
        raise ConditionError(
            f"equilibrium: {names} are more inputs than equalities, of which the least are found in a pose that the "
            f"conditions determine, and they leave {free} degree{'s' if free > 1 else ''} of freedom; add conditions"
        )
    try:
        rest = with_least_efforts(statics, statics.follow(x), least, places)
    except MechanismError as error:
        raise EquilibriumError(f"equilibrium: {error}", time=statics.t) from None
    if rest is None:
        raise EquilibriumError(_left_over(statics, x))
    return rest


def rest_near(statics: Statics, x: np.ndarray, *, stable: bool = True) -> np.ndarray:
    """Return the equilibrium near a pose: downhill of it, or by Newton's method."""
    x = statics.follow(x)
    if stable:
        rest = to_stable(statics, x)
        rest = newton(statics, x) if rest is None else rest
    else:
        rest = newton_nearby(statics, x)
    if rest is None:
        raise EquilibriumError(_left_over(statics, x))
    return rest


def value_of(symbol: Any, eom: Any, p: np.ndarray, start: State) -> float:
    """Start of the search for an unknown."""
    if isinstance(symbol, Parameter):
        return float(p[position_in(eom.mechanism.parameters, symbol, "unknowns=")])
    return float(start[symbol]) if place_of(symbol, start.mechanism.inputs) is not None else symbol.value


def start_of(setup: Setup, rows: Sequence[Condition], trim: bool = False) -> State:
    """Return the pose to start from; conditions that do not involve the pose are left to the search."""
    if isinstance(setup.initial, State):
        return setup.initial
    later = ("multiplier", "input") if trim else ()
    usable = [c for c in rows if not c.depends_on(*later) and (not trim or c.depends_on("position", "state"))]
    return consistent_start(free_numeric(setup), usable, setup.time, setup.signals)


def _refuse_moving_drivers(numeric: NumericEquations, time: float, q: np.ndarray, z: np.ndarray) -> None:
    nu = np.abs(numeric.velocity(time, q, z)[1])
    if largest(nu) > REST_TOLERANCE:
        worst = int(np.argmax(nu))
        element = numeric.eom.row_elements[worst]
        kind = "driver" if element in numeric.eom.mechanism.drivers else "constraint"
        raise EquilibriumError(
            f"equilibrium: {kind} '{element.name}' moves at {nu[worst]:.6g} per second at "
            f"t = {time:.6g} s, so nothing is at rest there; choose another time t=, or use inverse_dynamics",
            time=time,
        )


def _check_inequalities(rows: Sequence[Condition], result: State) -> None:
    for row in rows:
        if not row.equality and result[row.expression] > CONDITION_TOLERANCE:
            raise EquilibriumError(
                f"equilibrium: the equilibrium that was found breaks the condition {row.label} by "
                f"{result[row.expression]:.6g}; start from a pose nearer to the one that is meant"
            )


def _check_reactions(statics: Statics, x: np.ndarray) -> None:
    """Refuse reactions without a significant digit, and warn of those with few."""
    pose = amplification(statics, x)
    if pose is None:
        return
    if pose.singular and pose.factor:
        raise EquilibriumError(
            f"equilibrium: the pose is singular, and no finite reactions hold the load in it (those that balance it "
            f"nearby, {pose.reaction:.3g} N, are {pose.factor:.2g} times the load, and depend on rounding): "
            f"{pose.text}; move the mechanism out of this pose, or remove the load",
            time=statics.t,
        )
    warn_of(pose)


def _left_over(statics: Statics, x: np.ndarray) -> str:
    """Message on the forces that are not balanced at the start of the search."""
    eom, here = statics.eom, statics.stiffness(x)
    force = here.basis @ here.force / statics.numeric.column_scale**2
    order = np.argsort(-np.abs(force * statics.numeric.column_scale))
    parts = [f"{eom.coordinate_names[k]} ({force[k]:.4g})" for k in order[:3] if abs(force[k]) > 1e-9 * largest(force)]
    rates = statics.rows(x)[0][statics.rates]
    parts += [f"{z.label} (rate {r:.4g})" for z, r in zip(eom.mechanism.states, rates, strict=True) if abs(r) > 1e-9]
    pose = amplification(statics, x)
    singular = f"; the pose is singular, {pose.text}" if pose is not None and pose.singular else ""
    soft = here.values.size and here.least <= 1e-9 * here.scale
    remedy = (
        "no force holds it back in some direction (a body that falls?)"
        if soft
        else "the forces may have no balance near this pose"
    )
    rubbing = [
        e.description for e in eom.mechanism.elements if any(ca.depends_on(s.expression, eom.v) for s in e.smoothings)
    ]
    if soft and rubbing:
        remedy = (
            f"no force holds it back in some direction: smoothed friction ({', '.join(rubbing[:3])}) gives way slowly "
            "at rest; DryFriction sticks"
        )
    return (
        f"equilibrium: no state at rest was found; at the start the forces that are not balanced act on "
        f"{', '.join(parts) or 'nothing'} (N or N m){singular}; {remedy}; "
        "give conditions nearer to it, or check springs and loads"
    )
