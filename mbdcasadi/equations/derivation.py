"""From a mechanism to its equations of motion, by virtual work.

The elements contribute rows and virtual work; everything else is
differentiation. No closed formula of a joint is written twice.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ExpressionError
from ..model.cache import Cache, ExpressionKey
from ..model.contents import contents_of, values_of_contents
from ..model.joints.lower_pairs import LowerPair
from ..model.mechanism import Mechanism
from ..model.symbols import as_sx, describe, role_of, symbols_of
from ..model.symbols import t as time
from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.symbolic import symbolic

#: Bodies up to which what is computed from a mechanism serves others of equal contents: to read these takes as long as
#: to derive the equations, of which larger mechanisms need little else.
SHARING = 30
#: Entries of the Jacobian from which its rank is found by sparse factorisation.
LARGE = 40_000


class Equations:
    """Constrained equations of motion in the textbook's names; see :class:`~.public.Equations`, which users have."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        bodies, extra = mechanism.bodies, mechanism.coordinates
        self.t = time
        self.q = ca.vertcat(*[b.q for b in bodies], *extra)
        self.v = ca.vertcat(*[b.v for b in bodies], *[c.velocity for c in extra])
        self.a = ca.vertcat(*[b.a for b in bodies], *[c.acceleration for c in extra])
        self.z = _column(mechanism.states)
        self.u = _column(mechanism.inputs)
        self.p = _column(mechanism.parameters)
        self.z_rate = _column([mechanism.state_rates[z] for z in mechanism.states])
        masses = [as_sx(value) for b in bodies for value in (b.mass, b.mass, b.inertia)]
        self.mass_diagonal = ca.vertcat(*masses, ca.SX.zeros(len(extra)))
        self.coordinate_names = tuple(s.name() for s in ca.vertsplit(self.q))
        self._collect_rows(mechanism.constraints)

    def _collect_rows(self, constraints: Sequence[Any]) -> None:
        self.lam = ca.vertcat(ca.SX(0, 1), *[c.multipliers for c in constraints])
        self.row_names = tuple(name for c in constraints for name in c.row_names)
        self.row_elements = tuple(c for c in constraints for _ in range(c.multipliers.numel()))
        position = [np.full(c.rows.numel(), True) for c in constraints]
        level = [np.r_[p, np.full(c.velocity_rows.numel(), False)] for p, c in zip(position, constraints, strict=True)]
        flags = np.concatenate([np.zeros(0, bool), *level])
        self.position_rows = np.flatnonzero(flags)
        #: places of the rows among the position rows and then the velocity-level rows
        self._order = np.argsort(np.r_[self.position_rows, np.flatnonzero(~flags)], kind="stable").tolist()
        self.Phi = ca.vertcat(ca.SX(0, 1), *[c.rows for c in constraints])
        self.velocity_rows = ca.vertcat(ca.SX(0, 1), *[c.velocity_rows for c in constraints])

    # --- terms, which are derived when they are asked for ----------------------------
    @property
    def is_large(self) -> bool:
        """True if the Jacobian has so many entries that its rank is found by sparse factorisation, or not looked at."""
        return self.q.numel() * self.lam.numel() > LARGE

    @cached_property
    @symbolic
    def M(self) -> ca.SX:
        """Mass matrix (n, n), diagonal."""
        return ca.diag(self.mass_diagonal)

    @cached_property
    @symbolic
    def Phi_q(self) -> ca.SX:
        """Constraint Jacobian (m, n); for a velocity-level row its derivative by `v`."""
        jacobians = ca.jacobian(self.Phi, self.q), ca.jacobian(self.velocity_rows, self.v)
        return ca.vertcat(*jacobians)[self._order, :] if self._order else ca.SX(0, self.q.numel())

    @cached_property
    @symbolic
    def nu(self) -> ca.SX:
        """Right side of the velocity equation (m,), ``Phi_q v = nu = -Phi_t``."""
        rest = ca.substitute(self.velocity_rows, self.v, ca.SX.zeros(self.v.numel()))
        return ca.vertcat(-self.in_time(self.Phi), -rest)[self._order]

    @cached_property
    @symbolic
    def gamma(self) -> ca.SX:
        """Right side of the acceleration equation (m,)."""
        rate = ca.jtimes(self.Phi, self.q, self.v) + self.in_time(self.Phi)
        rate = ca.vertcat(rate, self.velocity_rows)[self._order]
        return -(ca.jtimes(rate, self.q, self.v) + self.in_time(rate))

    def in_time(self, expression: ca.SX) -> ca.SX:
        """Rate of a column in a pose that stands still: by time itself, and by states, which follow their rates."""
        rate = ca.jacobian(expression, self.t)
        if self.z.numel() and ca.depends_on(expression, self.z):
            rate += ca.jtimes(expression, self.z, self.z_rate)
        return rate

    @property
    def follows_states(self) -> bool:
        """True if a driver prescribes a function of first-order states."""
        return bool(self.following_rows)

    @cached_property
    def following_rows(self) -> list[int]:
        """Rows of drivers that prescribe functions of first-order states."""
        depends = ca.which_depends(self.Phi, self.z, 1, True) if self.z.numel() and self.Phi.numel() else []
        return [int(row) for row, here in zip(self.position_rows, depends, strict=False) if here]

    @property
    def closing(self) -> ca.SX:
        """Rows of ``Phi`` that no state enters: those of poses to which drivers may lead by the states they follow."""
        following = set(self.following_rows)
        return self.Phi[[place for place, row in enumerate(self.position_rows) if int(row) not in following]]

    @cached_property
    def followed_states(self) -> list[int]:
        """Places of the states that drivers follow, and of those on which their rates depend."""
        followed, expression = list[int](), self.Phi
        while self.z.numel() and (depends := ca.which_depends(expression, self.z, 1, False)):
            new = [k for k, here in enumerate(depends) if here and k not in followed]
            if not new:
                break
            followed, expression = sorted([*followed, *new]), self.z_rate[new]
        return followed

    @cached_property
    @symbolic
    def Q(self) -> ca.SX:
        """Generalised applied forces (n,)."""
        return self.generalised_forces(self.mechanism.elements)

    @cached_property
    @symbolic
    def potential(self) -> ca.SX:
        """Potential energy of the forces that have one."""
        return sum((as_sx(e.potential) for e in self.mechanism.elements), ca.SX(0))

    @cached_property
    @symbolic
    def kinetic(self) -> ca.SX:
        """Kinetic energy."""
        return 0.5 * ca.dot(self.v, self.mass_diagonal * self.v)

    def generalised_forces(self, elements: Sequence[Any]) -> ca.SX:
        """Return the generalised forces of some elements (n,)."""
        pairs = [pair for element in elements for pair in element.virtual_work]
        displacement = ca.vertcat(ca.SX(0, 1), *[ca.vec(as_sx(d)) for d, _ in pairs])
        force = ca.vertcat(ca.SX(0, 1), *[ca.vec(as_sx(f)) for _, f in pairs])
        return ca.densify(ca.jtimes(displacement, self.q, force, True)) if pairs else ca.SX.zeros(self.q.numel())

    def residual(self, force: ca.SX | None = None) -> ca.SX:
        """``[M a + Phi_q^T lam - Q; Phi_q a - gamma]`` (n + m,), zero along a motion; under another force than Q."""
        motion = self.mass_diagonal * self.a + self.Phi_q.T @ self.lam - (self.Q if force is None else force)
        return ca.vertcat(motion, self.Phi_q @ self.a - self.gamma)

    # --- sizes and properties ------------------------------------------------------
    @cached_property
    def contents(self) -> Hashable | None:
        """Key that is equal for mechanisms of equal contents; None if these are not known."""
        return contents_of(self.mechanism) if len(self.mechanism.bodies) <= SHARING else None

    @cached_property
    def shared(self) -> Cache:
        """What holds no symbols, numbers and compiled functions, shared with mechanisms of equal contents."""
        return values_of_contents(self.contents)

    @property
    def symbols(self) -> tuple[ca.SX, ...]:
        """``(t, q, v, a, z, lam, u, p)``, the arguments of every compiled expression."""
        return self.t, self.q, self.v, self.a, self.z, self.lam, self.u, self.p

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of coordinates, velocities, accelerations, first-order states, multipliers and inputs."""
        return tuple(symbols.numel() for symbols in (self.q, self.v, self.a, self.z, self.lam, self.u))

    @property
    def position_jacobian(self) -> ca.SX:
        """Rows of ``Phi_q`` that are position constraints, in the order of ``Phi``."""
        return self.Phi_q[self.position_rows.tolist(), :]

    @cached_property
    def position_names(self) -> tuple[str, ...]:
        """Names of the rows of ``Phi``."""
        return tuple(self.row_names[k] for k in self.position_rows)

    @property
    def position_angular_rows(self) -> np.ndarray:
        """True for rows of ``Phi`` in angles of bodies alone, which are in rad."""
        return self.angular_rows[self.position_rows]

    @cached_property
    @symbolic
    def symbol_hashes(self) -> frozenset[int]:
        """Hashes of the symbols that expressions may contain."""
        return frozenset(s.element_hash() for s in ca.vertsplit(ca.vertcat(*self.symbols)))

    @cached_property
    def Q_depends_on_lam(self) -> bool:
        """True if a force depends on the multipliers (joint friction)."""
        return bool(self.lam.numel()) and bool(ca.depends_on(self.Q, self.lam))

    @cached_property
    def Q_is_linear_in_lam(self) -> bool:
        """True if forces depend on multipliers as friction in motion on the force of its contact, or not at all."""
        return not ca.depends_on(ca.jacobian(self.Q, self.lam), self.lam)

    @property
    def loaded_by_reactions(self) -> list[str]:
        """Descriptions of the elements whose forces depend on reactions, such as friction by the load of a joint."""
        return [
            element.description
            for element in self.mechanism.elements
            if any(ca.depends_on(ca.vec(ca.SX(force)), self.lam) for _, force in element.virtual_work)
        ]

    @property
    def why_not_unique(self) -> str:
        """Sentence on forces that depend on reactions in a mechanism with redundant rows."""
        return why_not_unique(self.loaded_by_reactions)

    @cached_property
    def rows_of_trees(self) -> tuple[int, ...]:
        """Rows that are regular in every pose: of pins, slides and welds by which bodies hang on others in trees."""
        left = _outside_trees(self.mechanism.constraints)
        return tuple(k for k, element in enumerate(self.row_elements) if element not in left)

    @property
    def has_loops(self) -> bool:
        """True if constraints close loops: a tree of pins, slides and welds is regular in every pose."""
        return len(self.rows_of_trees) < len(self.row_elements)

    @cached_property
    def has_branches(self) -> bool:
        """True if position constraints close loops: their poses may lie on several branches."""
        return bool(_outside_trees(element for element in self.mechanism.constraints if element.rows.numel()))

    @cached_property
    def estimate(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimates of q, v and z that the bodies and states carry."""
        m = self.mechanism
        q = np.concatenate([*[b.pose_estimate for b in m.bodies], [c.value for c in m.coordinates]])
        if m.values:
            symbols = [*(x for b in m.bodies for x in (b.x, b.y, b.phi)), *m.coordinates]
            q = np.array([m.value_of(x, own) for x, own in zip(symbols, q.tolist(), strict=True)])
        v = np.concatenate([*[b.velocity_estimate for b in m.bodies], np.zeros(len(m.coordinates))])
        return q, v, np.array([z.value for z in m.states])

    @cached_property
    def parameter_values(self) -> np.ndarray:
        """The parameters' values in the mechanism."""
        return np.array([self.mechanism.value_of(p, p.value) for p in self.mechanism.parameters])

    @cached_property
    def input_values(self) -> np.ndarray:
        """The inputs' own values."""
        return np.array([u.value for u in self.mechanism.inputs])

    @cached_property
    def own_masses(self) -> ca.SX:
        """Diagonal of M at the states' own values (n,), a metric of masses that change, as an expression in p."""
        return ca.substitute(self.mass_diagonal, self.z, ca.DM(self.estimate[2]))

    def masses(self, p: np.ndarray, z: np.ndarray | None = None) -> np.ndarray:
        """Diagonal of M as numbers (n,), by default at the states' own values."""

        def make() -> Evaluator:
            return Evaluator(ca.Function("masses", [self.z, self.p], [ca.densify(self.mass_diagonal)]))

        return self.shared.get_or_create("masses", make)(self.estimate[2] if z is None else z, p)[0].ravel()

    # --- compiled functions -----------------------------------------------------------
    @symbolic
    def function(self, expression: Any) -> ca.Function:
        """Compile an expression: a Function of ``(t, q, v, a, z, lam, u, p)``; the most recent ones are kept.

        Raises
        ------
        ExpressionError
            For a symbol that the mechanism does not have.
        """
        expression = ca.SX(expression)
        make = partial(self._of_expression, expression)
        return self.mechanism.cache.get_or_create(ExpressionKey(expression), make, bounded=True)

    def contains(self, expression: ca.SX) -> bool:
        """Return True if the mechanism has every symbol of an expression."""
        return all(symbol.element_hash() in self.symbol_hashes for symbol in symbols_of(expression))

    def _of_expression(self, expression: ca.SX) -> ca.Function:
        for symbol in symbols_of(expression):
            if symbol.element_hash() not in self.symbol_hashes:
                raise ExpressionError(f"the expression holds {self._foreign(symbol)}")
        return ca.Function("expression", list(self.symbols), [ca.densify(expression)])

    @staticmethod
    def _foreign(symbol: ca.SX) -> str:
        role = role_of(symbol)
        if role is not None and role.kind == "input rate":
            return f"{describe(symbol)}, which is known only in optimal control"
        if role is not None and role.kind == "impulse":
            return (
                f"{describe(symbol)}, which is known only just after an impact: in event.after[…], and in initial= "
                "and boundary= of optimal control"
            )
        owner = getattr(role.owner, "name", None) if role else None
        return describe(symbol) + (f" of '{owner}'" if owner else "") + ", which the mechanism does not have"

    def value(self, expression: Any, arguments: Sequence[Any]) -> np.ndarray:
        """Value of an expression at one state, in the expression's own shape."""
        return self.function(expression)(*arguments).full()

    @cached_property
    def angles(self) -> np.ndarray:
        """True for coordinates that are angles of bodies (n,)."""
        places = np.arange(self.q.numel())
        angles: np.ndarray = (places % 3 == 2) & (places < 3 * len(self.mechanism.bodies))
        return angles

    @property
    def angular_rows(self) -> np.ndarray:
        """True for constraint rows in angles of bodies alone, which are in rad (m,)."""

        def find() -> np.ndarray:
            rows, columns = (np.array(part, int) for part in self.Phi_q.sparsity().get_triplet())
            angular = np.ones(self.lam.numel(), bool)
            angular[rows[~self.angles[columns]]] = False
            return angular

        return self.shared.get_or_create("angular rows", find)

    @cached_property
    def jacobian(self) -> ca.Function:
        """``(t, q, p) -> (Phi_q, nu)``; ``(t, q, z, p)`` if drivers follow states."""
        states = [self.z] if self.follows_states else []
        return ca.Function("velocity", [self.t, self.q, *states, self.p], [self.Phi_q, ca.densify(self.nu)])

    @cached_property
    def slopes(self) -> ca.Function:
        """``(t, q, p) -> Phi_q``, which no state enters."""
        return ca.Function("slopes", [self.t, self.q, self.p], [self.Phi_q])

    def __repr__(self) -> str:
        return f"Equations(n = {self.q.numel()} coordinates, m = {self.lam.numel()} constraint rows)"


def _column(values: Sequence[Any]) -> ca.SX:
    return ca.vertcat(*values) if values else ca.SX(0, 1)


def _outside_trees(constraints: Iterable[Any]) -> dict[Any, None]:
    """Constraints besides the pins, slides and welds by which bodies hang on others in trees."""
    left, holding = dict.fromkeys(constraints), defaultdict[Any, dict[Any, None]](dict)
    for element in left:
        for body in element.bodies:
            holding[body][element] = None
    loose = [body for body, elements in holding.items() if len(elements) == 1 and not body.is_ground]
    while loose:
        last = next(iter(holding[loose.pop()]), None)
        if last is None or len(last.bodies) != 2 or not isinstance(last, LowerPair):
            continue
        del left[last]
        for body in last.bodies:
            holding[body].pop(last, None)
            if len(holding[body]) == 1 and not body.is_ground:
                loose.append(body)
    return left


def why_not_unique(elements: Sequence[str]) -> str:
    """Sentence on described elements whose forces depend on reactions in a mechanism with redundant rows."""
    return (
        f"the force of {', '.join(elements[:3])} depends on reactions, and with redundant constraints these are not "
        "unique: remove the redundant rows (see check), or take LoadIndependentFriction"
    )
