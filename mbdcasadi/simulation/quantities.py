"""Quantities of the state at which loads switch or pass quickly, as the graph of the equations shows them."""

from __future__ import annotations

from collections import defaultdict

import casadi as ca

from ..arguments.inputs import Signals
from ..equations import Equations
from ..equations.switching.switch_functions import as_level, state_switches
from ..model.symbols import as_sx
from ..numerics.evaluation import Evaluator
from ..numerics.lookup import MANY
from ..numerics.roots import Levels
from .contact.watched_terms import has_gap


def quantities_of(eom: Equations, signals: Signals, integrands: ca.SX | None = None) -> Quantities:
    """Return the quantities of a motion that are watched, of its loads or of integrands; the former are kept."""
    if integrands is not None:
        return Quantities(eom, signals, integrands)
    return signals.kept(eom, ("state quantities",), lambda: Quantities(eom, signals, None), bounded=True)


class Quantities:
    """Quantities of a motion at whose levels the equations switch, and at whose zeros or extrema loads pass quickly.

    Contacts, stops and smoothed friction are left out: these are watched by :class:`~.checks.resolution.Resolution`.
    What is compared with several numbers, as the argument of a spline, is one quantity.

    Attributes
    ----------
    switches, number : int
        Number of those that switch, which come first, and of all.
    levels : Levels
        Their levels: the numbers that they are compared with, and zero for what passes quickly.
    function : Evaluator
        ``(t, q, v, z, p) ->`` their values (number,).
    compared : list of casadi.SX
        Functions at whose zeros steps end: of all that switch but of the points of tables, whose pieces join smoothly.
    """

    def __init__(self, eom: Equations, signals: Signals, integrands: ca.SX | None):
        switches, transients = state_quantities(eom, signals, integrands)
        with_levels = [as_level(switch) for switch in switches]
        levels = defaultdict[int, list[float]](list)
        for quantity, level in with_levels:
            levels[quantity.element_hash()].append(level)
        quantities = {quantity.element_hash(): quantity for quantity, _ in with_levels}
        few = [len(levels[quantity.element_hash()]) < MANY for quantity, _ in with_levels]
        self.compared = [switch for switch, is_one in zip(switches, few, strict=True) if is_one]
        self.levels = Levels([levels[key] for key in quantities] + [[0.0]] * len(transients))
        column = ca.vertcat(ca.SX(0, 1), *quantities.values(), *transients)
        self.switches, self.number = len(quantities), column.numel()
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        self.function = Evaluator(ca.Function("quantities", known, [ca.densify(column)]))


def state_quantities(
    eom: Equations, signals: Signals, integrands: ca.SX | None = None
) -> tuple[list[ca.SX], list[ca.SX]]:
    """Quantities of the loads, or of integrands, that switch, and others that may pass quickly."""
    everything = _loads(eom) if integrands is None else integrands
    if eom.u.numel() and ca.depends_on(everything, eom.u):
        everything = ca.substitute(everything, eom.u, signals.with_expressions(eom.u))
    unknown = ca.vertcat(eom.a, eom.lam, eom.u)
    state = ca.vertcat(eom.q, eom.v, eom.z)
    return state_switches(everything, state, unknown)


def _loads(eom: Equations) -> ca.SX:
    elements = [e for e in eom.mechanism.elements if not has_gap(e) and not getattr(e, "smoothings", ())]
    loads = [ca.vec(as_sx(x)) for e in elements for pair in e.virtual_work for x in pair]
    loads += [ca.vec(ca.SX(rate)) for rate in eom.mechanism.state_rates.values()]
    return ca.vertcat(ca.SX(0, 1), *loads, eom.Phi, eom.velocity_rows)
