"""The equations of a run as an explicit system with invariants, for the compiled method."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...arguments.inputs import Signals
from ...equations.batches import Values
from ...equations.derivation import Equations
from ...equations.numeric import NumericEquations
from ...equations.recovery import projection_saddle
from ...equations.saddle import Saddle
from ...integrators.native.code import Written
from ...integrators.native.stretch import ExplicitSystem
from ...numerics.c_code import SIGNATURE, simplified, tape_of
from ...numerics.c_interface import constant_table
from ...numerics.tolerances import NEGLIGIBLE
from ..contact.compiled_elements import RepeatedElements, repeated_elements
from ..contact.watched_terms import WatchedTerms, has_gap
from ..quantities import quantities_of


def dynamics_of(numeric: NumericEquations, *, redundant: bool = False) -> ca.Function:
    """``(t, q, v, z, u, p) -> (a, rate of z, lam, regularity)``; made once for a mechanism.

    The regularity is the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to its
    diagonal (with light bodies, that of ``Phi_q Phi_q^T``); 1 if no pose is singular.

    Parameters
    ----------
    redundant : bool
        True if rows depend on each other; the multipliers are then those of least norm, by the regularised solve.
    """
    eom = numeric.eom

    def make() -> ca.Function:
        known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
        return _function_of("dynamics", numeric, known, *numeric.forward_dynamics(redundant=redundant)(*known))

    return eom.mechanism.cache.get_or_create(("explicit dynamics", numeric.light_key, redundant), make)


def _function_of(name: str, numeric: NumericEquations, known: list[ca.SX], a: ca.SX, lam: ca.SX) -> ca.Function:
    """``known -> (a, rate of z, lam, regularity)``."""
    eom = numeric.eom
    rates = ca.substitute(eom.z_rate, ca.vertcat(eom.a, eom.lam), ca.vertcat(a, lam)) if eom.z.numel() else eom.z_rate
    return ca.Function(name, known, [a, ca.densify(rates), lam, _regularity(numeric)])


def _regularity(numeric: NumericEquations) -> ca.SX:
    eom = numeric.eom
    if not eom.lam.numel() or not eom.has_loops:
        return ca.SX(1)
    if numeric.augmentation is None:  # as in the forward dynamics: evaluated once
        return numeric.saddle().pivot()
    return Saddle(ca.SX(ca.DM(numeric.column_scale**-2)), eom.Phi_q, eom.angular_rows).pivot()


def projection_of(eom: Equations) -> ca.Function:
    """``(t, q, v, z, p, weights) -> (q, v, |Phi|)``: one step onto the constraints; made once for a mechanism.

    One factorisation serves positions and velocities, whose residual is that of the new pose. Where the factors are
    shifted it is taken away twice; else what the turn of the rows and rounding leave of it counts as a residual.
    """
    return eom.mechanism.cache.get_or_create("explicit projection", lambda: _projection(eom))


def _projection(eom: Equations) -> ca.Function:
    rows, whole = eom.position_rows.tolist(), list(range(eom.lam.numel()))
    weights, saddle = projection_saddle(eom, whole)
    q, v, left = eom.q, eom.v, ca.SX(0)
    if rows:
        q = q - projection_saddle(eom, rows)[1].project(eom.Phi)
    if whole:
        there = ca.Function("there", [eom.t, eom.q, eom.z, eom.p], [eom.Phi, eom.Phi_q, eom.nu])
        phi, jacobian, nu = there(eom.t, q, eom.z, eom.p)
        for _ in range(2 if eom.has_loops else 1):
            v = v - saddle.over(jacobian.T @ saddle.multipliers(jacobian @ v - nu))
        left = ca.norm_inf(ca.densify(phi)) if rows else left
        left = left if eom.has_loops else ca.fmax(left, _left_by_turn(eom, q - eom.q, v - eom.v))
    results = [ca.densify(q), ca.densify(v), left]
    return ca.Function("projection", [eom.t, eom.q, eom.v, eom.z, eom.p, weights], results)


def _left_by_turn(eom: Equations, moved: ca.SX, corrected: ca.SX) -> ca.SX:
    """Estimate of the residual that one correction of the velocities leaves, by rows of an earlier pose."""
    slopes = ca.vertcat(*eom.Phi_q.nonzeros())
    bends = np.array([not ca.SX(slope).is_constant() for slope in eom.Phi_q.nonzeros()], bool)
    turning = np.flatnonzero(ca.which_depends(slopes, eom.q, 1, False))
    _, columns = eom.Phi_q.sparsity().get_triplet()
    bent = np.unique(np.array(columns, int)[bends])
    if not turning.size or not bent.size:
        return ca.SX(0)
    turn, change = (ca.norm_inf(ca.densify(part)) for part in (moved[turning.tolist()], corrected[bent.tolist()]))
    return change * (turn + NEGLIGIBLE)


def explicit_system(
    numeric: NumericEquations, signals: Signals, terms: WatchedTerms | None = None, *, implicit: bool = False
) -> ExplicitSystem:
    """Return the system of a run; kept for a mechanism and for inputs of the same structure.

    Parameters
    ----------
    terms : WatchedTerms, optional
        Integrands along the motion, among others; the same in every run of a mechanism that has some.
    implicit : bool
        True for an implicit method, which needs slopes.
    """
    key = ("explicit system", numeric.light_key, terms is None, implicit)
    return signals.kept(numeric.eom, key, lambda: _system(numeric, signals, terms, implicit=implicit), bounded=True)


def _system(
    numeric: NumericEquations, signals: Signals, terms: WatchedTerms | None, *, implicit: bool
) -> ExplicitSystem:
    eom = numeric.eom

    def quadrature() -> ca.Function:
        if terms is None:
            content = ca.SX(0, 1)
        elif implicit and repeated is not None:  # an implicit method runs the loops alone: the size is enough
            content = ca.SX.zeros(terms.size)
        else:
            content = ca.densify(terms.rates)
        return ca.Function("quadrature", list(eom.symbols), [content])

    cache = eom.mechanism.cache
    repeated = None if terms is None else repeated_elements(terms)
    integrals = cache.get_or_create(("explicit quadrature", terms is None, implicit), quadrature)
    slopes = _slopes_of(numeric, signals, repeated) if implicit else None
    written = None
    if repeated is not None:
        key = ("explicit code with loops", numeric.light_key, slopes)
        written = cache.get_or_create(key, lambda: _with_loops(numeric, repeated, slopes))
    return ExplicitSystem(
        signals.function(eom),
        dynamics_of(numeric),
        integrals,
        projection_of(eom),
        switching_of(eom, signals, with_gaps=repeated is None),
        slopes,
        written,
    )


def switching_of(eom: Equations, signals: Signals, *, with_gaps: bool) -> ca.Function:
    """``(t, q, v, z, p) ->`` quantities at whose zeros forces, or their derivatives, jump; kept for a mechanism.

    Parameters
    ----------
    signals : Signals
        Inputs.
    with_gaps : bool
        False to leave gaps to the error test, as of elements that are many of a kind: steps would end at each of them.
    """

    def make() -> ca.Function:
        unknown = ca.vertcat(eom.a, eom.lam, eom.u)
        gaps = [ca.vec(ca.SX(e.watched_gaps)) for e in eom.mechanism.elements if with_gaps and has_gap(e)]
        known_gaps = [gap for gap in gaps if not ca.depends_on(gap, unknown)]
        content = ca.vertcat(ca.SX(0, 1), *known_gaps, *quantities_of(eom, signals).compared)
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        return ca.Function("switching", known, [ca.densify(content)])

    return signals.kept(eom, ("what switches", with_gaps), make, bounded=True)


def _slopes_of(numeric: NumericEquations, signals: Signals, repeated: RepeatedElements | None) -> ca.Function:
    """``(t, q, v, z, u, p, levels, channel) ->`` slopes of accelerations and rates of z by the state, with the inputs'.

    With elements in loops, these are those of the others alone, under forces Q of the loops as a ninth argument, and
    the nonzero slopes by these forces.
    """
    eom = numeric.eom

    def make() -> ca.Function:
        force, x = ca.SX.sym("Q", eom.q.numel()), ca.vertcat(eom.q, eom.v, eom.z)
        u = signals.parametrised if ca.depends_on(signals.parametrised, x) else eom.u
        known = [eom.t, eom.q, eom.v, eom.z, u, eom.p]
        if repeated is None:
            solved = dynamics_of(numeric)(*known)
        else:
            others = repeated.rest(*known[:4], ca.SX.zeros(eom.lam.numel()), *known[4:])
            solved = _solution(numeric)(*known, force + others)
        rates = ca.vertcat(*solved[:2])
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p, signals.levels, signals.channel]
        results = [ca.jacobian(rates, x)]
        if repeated is not None:
            arguments, results = [*arguments, force], [*results, ca.jacobian(rates, force)]
        return ca.Function("slopes", arguments, results)

    return signals.kept(eom, ("explicit slopes", numeric.light_key, repeated is None), make)


def _solution(numeric: NumericEquations) -> ca.Function:
    """``(t, q, v, z, u, p, Q) -> (a, rate of z, lam, regularity)`` under generalised forces Q."""
    eom = numeric.eom
    force = ca.SX.sym("Q", eom.q.numel())
    known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p, force]
    return _function_of("solve", numeric, known, *numeric.saddle().solve(force, eom.gamma))


def _with_loops(numeric: NumericEquations, repeated: RepeatedElements, slopes: ca.Function | None) -> Written:
    """Dynamics and quadrature in C, with loops over elements that are many of a kind; and slopes, if they are asked."""
    eom, values = numeric.eom, repeated.terms.values
    z_rate = ca.Function("rates_of_states", list(eom.symbols), [ca.densify(eom.z_rate)])
    tapes = [tape_of(simplified(function)) for function in (_solution(numeric), repeated.rest, z_rate)]
    loops, work = repeated.loops(outputs=True)
    work = max(work, *(tape.work_in_c for tape in tapes))
    n, size, states = eom.q.numel(), values.size, eom.z.numel()
    shared = "\n".join([loops, *(tape.as_c for tape in tapes)])
    dynamics = f"""int dynamics({SIGNATURE}) {{
  double *column = w, *force = w + {size}, *rest = force + {n}, *work = rest + {n};
  for (int i = 0; i < {size}; ++i) column[i] = 0;
{_filled(values, "t", "q", "v", "z", "u", "p")}
  {{ const double* in[] = {{column}}; double* out[] = {{force}}; forces(in, out, iw, work, mem); }}
  {{ const double* in[] = {{arg[0], arg[1], arg[2], arg[3], 0, arg[4], arg[5]}}; double* out[] = {{rest}};
    rest_of_forces(in, out, iw, work, mem); }}
  for (int i = 0; i < {n}; ++i) force[i] += rest[i];
  const double* in[] = {{arg[0], arg[1], arg[2], arg[3], arg[4], arg[5], force}};
  return solve(in, res, iw, work, mem);
}}
"""
    quadrature = f"""int quadrature({SIGNATURE}) {{
  double *column = w, *work = w + {size + states};
{_filled(values, "t", "q", "v", "a", "z", "lam", "u", "p")}
  double* out[] = {{column + {values.start("z_rate")}}};
  rates_of_states(arg, out, iw, work, mem);
  column[{size - 2}] = 0; column[{size - 1}] = 1;
  const double* in[] = {{column}};
  return rates(in, res, iw, work, mem);
}}
"""
    bodies = {"dynamics": (dynamics, size + 2 * n + work), "quadrature": (quadrature, size + states + work)}
    instructions = repeated.size + sum(tape.size for tape in tapes)
    if slopes is not None:
        tape = tape_of(simplified(_with_nonzeros(slopes), densify=False))
        text, own_work = _slopes_with_loops(slopes, values, repeated)
        shared, bodies = f"{shared}\n{tape.as_c}", bodies | {"slopes": (text, own_work + max(work, tape.work_in_c))}
        instructions += tape.size
    return Written(shared, bodies, instructions, repeated.watch_by)


def _with_nonzeros(slopes: ca.Function) -> ca.Function:
    """The slopes of a solution under another name, those by forces as a column of nonzeros."""
    arguments = slopes.sx_in()
    by_state, by_force = slopes(*arguments)
    return ca.Function("slopes_of_solution", arguments, [by_state, ca.densify(by_force.nz[:])])


def _slopes_with_loops(slopes: ca.Function, values: Values, repeated: RepeatedElements) -> tuple[str, int]:
    """Slopes by the state in C, and the length of the work array without that of what they call."""
    n, m, size = values.count("q"), slopes.size1_out(0), values.size
    code, rows, columns, own_work = repeated.slopes
    state = np.full(size, -1)
    for group, first in (("q", 0), ("v", n), ("z", 2 * n)):
        state[values.start(group) :][: values.count(group)] = first + np.arange(values.count(group))
    starts, entries = (np.array(part, int) for part in slopes.sparsity_out(1).get_ccs())
    tables = {"rows": rows, "states": state[columns], "starts": starts, "entries": entries}
    text = "\n".join(constant_table("int", f"slopes_{name}", content) for name, content in tables.items())
    text += f"""
{code}
int slopes({SIGNATURE}) {{
  double *column = w, *force = w + {size}, *nonzeros = force + {n}, *by_force = nonzeros + {rows.size};
  double* work = by_force + {entries.size};
  for (int i = 0; i < {size}; ++i) column[i] = 0;
{_filled(values, "t", "q", "v", "z", "u", "p")}
  const double* values[] = {{column}};
  forces(values, &force, iw, work, mem);
  jac_forces(values, &nonzeros, iw, work, mem);
  const double* in[] = {{arg[0], arg[1], arg[2], arg[3], arg[4], arg[5], arg[6], arg[7], force}};
  double* out[] = {{res[0], by_force}};
  slopes_of_solution(in, out, iw, work, mem);
  for (int k = 0; k < {rows.size}; ++k) {{
    if (nonzeros[k] == 0 || slopes_states[k] < 0) continue;
    double* by_state = res[0] + slopes_states[k] * {m};
    for (int i = slopes_starts[slopes_rows[k]]; i < slopes_starts[slopes_rows[k] + 1]; ++i)
      by_state[slopes_entries[i]] += by_force[i] * nonzeros[k];
  }}
  return 0;
}}
"""
    return text, size + n + rows.size + entries.size + own_work


def _filled(values: Values, *groups: str) -> str:
    """Lines of C that put arguments into a column of values, and the rates that are known."""
    lines = [
        f"  for (int i = 0; i < {values.count(group)}; ++i) column[{values.start(group)} + i] = arg[{k}][i];"
        for k, group in enumerate(groups)
        if values.count(group)
    ]
    return "\n".join(lines)
