"""Mechanisms: immutable lists of bodies, joints, drivers and forces."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ExpressionError, ModelError
from ..numerics.lazy import cached_property
from ..numerics.tolerances import NEGLIGIBLE
from .bodies import Body
from .cache import Cache
from .drivers import BEFORE_AN_INPUT, Driver
from .element import ConstraintElement, Element
from .immutable import HoldsSymbols, Immutable
from .quantities import Limit, entries, listed, quantity, refuse_unknown
from .rates import time_derivative
from .symbols import (
    Coordinate,
    Input,
    Parameter,
    StateVariable,
    as_sx,
    describe,
    number,
    role_of,
    symbols_of,
    t,
    varying_in,
)
from .texts import text_of


class Mechanism(Immutable, HoldsSymbols):
    """Bodies, joints, drivers and forces.

    Parameters
    ----------
    bodies : sequence of Body
        The moving bodies; the ground is always included.
    joints : sequence, optional
        Joints and other constraints.
    drivers : sequence of Driver, optional
        Prescribed motions.
    forces : sequence, optional
        Applied forces, springs, gravity.
    inputs : sequence of Input, optional
        Inputs that the elements use.
    parameters : sequence of Parameter, optional
        Parameters that elements, drivers or conditions use.
    states : dict of StateVariable to expression, optional
        Rate of each first-order state.
    name : str, default ""
        Name for printing.
    values : mapping, optional
        Values of parameters, and estimates of coordinates, in place of those that these carry: the same model with
        other dimensions, or in another pose (``{length: 0.3, crank.phi: 1.2}``).

    Attributes
    ----------
    bodies, joints, drivers, forces, inputs, parameters, states : tuple
        Its parts; `states` are the state variables of the model and of its elements.
    state_rates : dict of StateVariable to casadi.SX
        Their rates.
    own_states : dict of StateVariable to casadi.SX
        Rates of the state variables that no element brings, as they were given.
    values : dict
        Values and estimates that the mechanism has in place of those of its parts.

    Raises
    ------
    ModelError, ExpressionError
        For names that occur twice, bodies that are not listed, and symbols that are not listed.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        joints: Sequence[Element] = (),
        drivers: Sequence[Driver] = (),
        forces: Sequence[Element] = (),
        inputs: Sequence[Input] = (),
        parameters: Sequence[Parameter] = (),
        states: Mapping[StateVariable, Any] | None = None,
        name: str = "",
        values: Mapping[Any, float] | None = None,
    ):
        if not isinstance(name, str):
            raise ModelError(f"Mechanism: name= must be a text, got {name!r}")
        self.name = name
        self.bodies: tuple[Body, ...] = entries(bodies, "bodies=")
        self.joints: tuple[Any, ...] = entries(joints, "joints=")
        self.drivers: tuple[Any, ...] = entries(drivers, "drivers=")
        self.forces: tuple[Any, ...] = entries(forces, "forces=")
        self.inputs: tuple[Input, ...] = listed(inputs, Input, "inputs=")
        self.parameters: tuple[Parameter, ...] = listed(parameters, Parameter, "parameters=")
        if states is not None and not isinstance(states, Mapping):
            raise ModelError(f"states= takes {{StateVariable: rate}}, got {states!r}")
        self.own_states = dict(states or {})
        self._check_parts()
        self.elements: tuple[Any, ...] = tuple(
            getattr(part, "acting_on", lambda _bodies, part=part: part)(self.bodies)
            for part in (*self.joints, *self.drivers, *self.forces)
        )
        self.coordinates: tuple[Coordinate, ...] = tuple(c for e in self.elements for c in e.coordinates)
        self.state_rates = self._collect_rates()
        self.states = tuple(self.state_rates)
        self._check_names()
        self._check_connections()
        self._check_symbols()
        self._check_masses()
        self._check_followed_states()
        self.values = self._checked_values(values)
        self.cache = Cache()

    # --- checks --------------------------------------------------------------------
    def _check_parts(self) -> None:
        for body in self.bodies:
            if not isinstance(body, Body) or body.is_ground:
                raise ModelError(f"bodies= takes moving bodies, got {body!r}")
        if not self.bodies:
            raise ModelError("a mechanism needs at least one body")
        for argument, parts in (("joints", self.joints), ("drivers", self.drivers), ("forces", self.forces)):
            for part in parts:
                _check_place(part, argument)

    def _collect_rates(self) -> dict[StateVariable, ca.SX]:
        rates: dict[StateVariable, ca.SX] = {}
        sources = [("states=", self.own_states)] + [(e.description, e.rates) for e in self.elements]
        for source, state_rates in sources:
            for state, rate in state_rates.items():
                if not isinstance(state, StateVariable):
                    raise ModelError(f"{source}: takes {{StateVariable: rate}}, got the key {state!r}")
                if state in rates:
                    raise ModelError(f"{source}: the rate of state variable '{state.label}' is given twice")
                rates[state] = ca.SX(quantity(rate, f"state variable '{state.label}'", "rate"))
        return rates

    def _check_names(self) -> None:
        groups: tuple[tuple[str, Iterable[str]], ...] = (
            ("body", (b.name for b in self.bodies)),
            ("joint, driver or force", (e.name for e in self.elements)),
            ("input, parameter or state", (s.label for s in (*self.inputs, *self.parameters, *self.states))),
        )
        for kind, names in groups:
            seen: set[str] = set()
            for name in names:
                if name in seen:
                    raise ModelError(f"the {kind} name '{name}' occurs twice; each needs a name of its own")
                seen.add(name)

    def _check_connections(self) -> None:
        known, listed = {body.name for body in self.bodies}, set(self.bodies)  # bodies are equal if they are the same
        for element in self.elements:
            for body in element.bodies:
                if not body.is_ground and body not in listed:
                    also = " (another body of that name is)" if body.name in known else ""
                    raise ModelError(
                        f"{element.description} uses body '{body.name}', which is not among bodies= of "
                        f"the mechanism{also}"
                    )

    def _check_symbols(self) -> None:
        allowed = self.symbol_hashes
        sources = [(b.description, [as_sx(b.mass), as_sx(b.inertia)]) for b in self.bodies]
        sources += [(e.description, e.expressions()) for e in self.elements]
        sources += [(f"the rate of state variable '{z.label}'", [rate]) for z, rate in self.state_rates.items()]
        whole = ca.veccat(*[expression for _, expressions in sources for expression in expressions])
        strange = {symbol.element_hash() for symbol in symbols_of(whole)} - allowed
        for what, expressions in sources if strange else ():
            for symbol in symbols_of(ca.veccat(*expressions)):
                if symbol.element_hash() in strange:
                    raise ExpressionError(self._stray(symbol, what))
        for body in self.bodies:
            for name, value in (("mass", body.mass), ("inertia", body.inertia)):
                for symbol in varying_in(value):
                    role = role_of(symbol)
                    if role is None or role.kind != "state":
                        raise ExpressionError(
                            f"{body.description}: {name} may contain parameters and states only, not {describe(symbol)}"
                        )

    def _check_masses(self) -> None:
        """Refuse a body whose mass changes by something else than what flows into it and out of it."""
        flows: dict[Body, ca.SX] = {}
        for element in self.elements:
            for body, rate in getattr(element, "mass_rates", ()):
                flows[body] = flows.get(body, ca.SX(0)) + rate
        for body in self.bodies:
            if body in flows or varying_in(body.mass):
                change, flow = time_derivative(body.mass, self), flows.get(body, ca.SX(0))
                if not _are_equal(change, flow):
                    raise ModelError(
                        f"{body.description}: its mass changes by {text_of(change)} kg/s, and its flows bring "
                        f"{text_of(flow)} kg/s; make each flow a MassFlow, and give states in mass= rates that agree"
                    )

    def _check_followed_states(self) -> None:
        """Refuse drivers that follow states of which the mechanism has no two time derivatives."""
        rates = {state.element_hash(): (state, rate) for state, rate in self.state_rates.items()}
        for driver in self.drivers:
            expression = driver.rows
            for order, missing in enumerate(_WITHOUT_RATE, start=1):
                followed = [rates[x.element_hash()] for x in symbols_of(expression) if x.element_hash() in rates]
                for state, rate in followed:
                    _refuse_in_rate(driver.description, state, rate, order, missing)
                expression = ca.vertcat(*[rate for _, rate in followed])

    @staticmethod
    def _stray(symbol: ca.SX, what: str) -> str:
        role = role_of(symbol)
        lists = {"input": "inputs", "parameter": "parameters", "state": "states"}
        kind = role.kind if role else ""
        if role is not None and isinstance(role.owner, Element) and kind == "state":
            return (
                f"{what} uses {describe(symbol)}, which belongs to {role.owner.description}; list that in forces= too"
            )
        if kind in lists:
            return f"{what} uses {describe(symbol)}, which is not among {lists[kind]}= of the mechanism"
        if kind == "acceleration":
            return f"{what} depends on {describe(symbol)}; forces follow from positions, velocities, states and inputs"
        if kind == "input rate":
            return (
                f"{what} uses {describe(symbol)}, which is known only in costs and limits of optimal control; make the "
                "quantity a StateVariable whose rate is an input"
            )
        return f"{what} uses {describe(symbol)}, which the mechanism does not have"

    def _checked_values(self, values: Mapping[Any, float] | None) -> dict[Any, float]:
        if values is not None and not isinstance(values, Mapping):
            raise ModelError(f"values= takes {{parameter or coordinate: number}}, got {values!r}")
        checked = {}
        for symbol, value in (values or {}).items():
            known = isinstance(symbol, ca.SX) and symbol.is_symbolic() and symbol.is_scalar()
            if not known or not any(symbol.element_hash() == other.element_hash() for other in self._with_values()):
                name = describe(symbol) if known else repr(symbol)
                raise ModelError(f"values= takes parameters and coordinates of the mechanism, got {name}")
            checked[symbol] = number(value, describe(symbol), "value")
        return checked

    def _with_values(self) -> list[ca.SX]:
        """Parameters and coordinates."""
        return [*self.parameters, *(x for body in self.bodies for x in (body.x, body.y, body.phi)), *self.coordinates]

    @cached_property
    def _values_by_hash(self) -> dict[int, float]:
        return {symbol.element_hash(): value for symbol, value in self.values.items()}

    def value_of(self, symbol: Any, own: float) -> float:
        """Value of a parameter, or estimate of a coordinate: that of ``values=``, or its own."""
        return self._values_by_hash.get(symbol.element_hash(), own) if self.values else own

    def check_values(self, values: Any) -> None:
        """Check every limited quantity (a mass, a length) at values of the parameters.

        Raises
        ------
        ModelError
            Naming the element, the quantity, its value, and the parameters behind it.
        """
        limits = self.limits
        if not limits:
            return
        function = self.cache.get_or_create("values of limits", self._values_of_limits)
        values_by_symbol = {
            p.element_hash(): f"'{p.label}' = {v:.6g}" for p, v in zip(self.parameters, values, strict=True)
        }
        for limit, value in zip(limits, function(values).full().ravel(), strict=True):
            used = ", ".join(values_by_symbol[s.element_hash()] for s in symbols_of(limit.expression))
            limit.check(float(value), f" with parameter {used}")

    @property
    def limits(self) -> list[Limit]:
        """Ranges of the quantities that depend on parameters."""
        return self._all_limits[0]

    @property
    def varying_limits(self) -> list[Limit]:
        """Ranges of the quantities that vary: in time, by inputs or states."""
        return self._all_limits[1]

    @property
    def _all_limits(self) -> tuple[list[Limit], list[Limit]]:
        return self.cache.get_or_create("limits", self._sorted_limits)

    def _sorted_limits(self) -> tuple[list[Limit], list[Limit]]:
        mine = {p.element_hash() for p in self.parameters}
        limits = [limit for part in (*self.bodies, *self.elements) for limit in getattr(part, "limits", ())]
        known = [all(s.element_hash() in mine for s in symbols_of(x.expression)) for x in limits]
        both = list(zip(limits, known, strict=True))
        varying = [x for x, is_known in both if not is_known and (x.at_least, x.above) != (None, None)]
        return [x for x, is_known in both if is_known], varying

    def _values_of_limits(self) -> ca.Function:
        """Return the values of the limited quantities as a function of the parameters."""
        at = ca.vertcat(ca.SX(0, 1), *self.parameters)
        return ca.Function("limits", [at], [ca.vertcat(*[x.expression for x in self.limits])])

    # --- parts -----------------------------------------------------------------------
    @property
    def symbol_hashes(self) -> set[int]:
        """Hashes of the symbols that the equations may contain."""
        symbols = [t, *self.inputs, *self.parameters, *self.states]
        symbols += [s for c in self.coordinates for s in (c, c.velocity)]
        for body in self.bodies:
            symbols += [body.x, body.y, body.phi, body.vx, body.vy, body.omega]
        for element in self.elements:
            symbols += ca.vertsplit(element.multipliers) if element.multipliers.numel() else []
        return {s.element_hash() for s in symbols}

    @property
    def acceleration_hashes(self) -> set[int]:
        """Hashes of the accelerations, which results may contain and the equations may not."""
        symbols = [c.acceleration for c in self.coordinates]
        for body in self.bodies:
            symbols += [body.ax, body.ay, body.alpha]
        return {s.element_hash() for s in symbols}

    @property
    def constraints(self) -> tuple[ConstraintElement, ...]:
        """Elements with constraint rows: joints, then drivers, then forces."""
        return tuple(e for e in self.elements if e.multipliers.numel())

    def body(self, name: str) -> Body:
        """Return the body of a name."""
        return _find(self.bodies, name, "body")

    def joint(self, name: str) -> Any:
        """Return the joint, constraint or driver of a name."""
        return _find((*self.joints, *self.drivers), name, "joint")

    def force(self, name: str) -> Any:
        """Return the force of a name."""
        return _find(self.forces, name, "force")

    def input(self, name: str) -> Input:
        """Return the input of a name."""
        return _find(self.inputs, name, "input")

    def replace(self, **changes: Any) -> Mechanism:
        """Return a new mechanism on the same symbols, with the arguments given replaced."""
        arguments: dict[str, Any] = {
            "bodies": self.bodies,
            "joints": self.joints,
            "drivers": self.drivers,
            "forces": self.forces,
            "inputs": self.inputs,
            "parameters": self.parameters,
            "states": self.own_states,
            "name": self.name,
            "values": self.values,
        }
        refuse_unknown(changes, arguments)
        return Mechanism(**(arguments | changes))

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{len(parts)} {word}"
            for parts, word in (
                (self.bodies, "bodies"),
                (self.joints, "joints"),
                (self.drivers, "drivers"),
                (self.forces, "forces"),
                (self.inputs, "inputs"),
                (self.parameters, "parameters"),
                (self.states, "states"),
            )
            if parts
        )
        return f"Mechanism({self.name + ': ' if self.name else ''}{counts})"


#: Kinds of symbols that the first and second time derivative of what a driver prescribes may not hold.
_WITHOUT_RATE = (("input", "velocity", "acceleration", "multiplier"), ("acceleration", "multiplier"))


def _refuse_in_rate(driver: str, state: StateVariable, rate: ca.SX, order: int, kinds: Sequence[str]) -> None:
    """Raise if the rate of a state that a driver follows holds a symbol of some kinds."""
    for symbol in symbols_of(rate):
        role = role_of(symbol)
        if role is None or role.kind not in kinds:
            continue
        what = f"{driver} follows the state '{state.label}', whose rate contains {describe(symbol)}"
        if role.kind == "input":
            raise ModelError(f"{what}; {BEFORE_AN_INPUT}")
        raise ModelError(
            f"{what}; the {'first' if order == 1 else 'second'} time derivative of what a driver prescribes does not "
            f"depend on a {role.kind}: put a state before it, or take a force in place of the driver"
        )


def _check_place(part: Any, argument: str) -> None:
    """Raise if something is no element, or does not belong in an argument."""
    if isinstance(part, type) or not hasattr(part, "rows") or not hasattr(part, "virtual_work"):
        raise ModelError(f"{argument}= takes model elements, got {part!r}")
    if argument != "drivers" and isinstance(part, Driver):
        raise ModelError(f"{part.description} belongs in drivers=, not in {argument}=")
    if argument == "forces":
        if part.rows.numel():
            raise ModelError(f"{part.description} is a constraint; give it in joints= or drivers=")
        return
    if not isinstance(part, Element) and not hasattr(part, "multipliers"):
        raise ModelError(f"{part!r} has rows but no multipliers")
    is_force = not isinstance(part, ConstraintElement)  # a joint without rows has a coordinate to read
    if is_force and not part.rows.numel() and not part.velocity_rows.numel():
        raise ModelError(f"{part.description} constrains nothing; give it in forces=")


def _find(parts: Sequence[Any], name: str, kind: str) -> Any:
    named = {str(part.name() if isinstance(part, ca.SX) else part.name): part for part in parts}
    if not isinstance(name, str) or name not in named:
        raise ModelError(f"there is no {kind} {name!r}; there are {', '.join(map(repr, named)) or 'none'}")
    return named[name]


def _are_equal(one: ca.SX, other: ca.SX) -> bool:
    """Return True if two scalar expressions have the same values at random places."""
    symbols = ca.vertcat(ca.SX(0, 1), *symbols_of(ca.vertcat(one, other)))
    places = np.random.default_rng(0).uniform(0.5, 1.5, (symbols.numel(), 5))
    values = ca.Function("both", [symbols], [ca.densify(ca.vertcat(one, other))])(places).full()
    apart = np.abs(values[0] - values[1]) <= NEGLIGIBLE * (1 + np.abs(values[0]))
    return bool(np.all(apart | ~np.all(np.isfinite(values), axis=0)))
