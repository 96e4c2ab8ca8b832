"""Friction of a rope that does not stretch on the pulleys over which it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..forces.active_rows import ActiveRows
from ..forces.friction.laws import Resistance
from ..rates import time_derivative
from ..switching import Switching
from ..validity import Smoothing


class Rubbing(Switching):
    """A pulley on which a cable rubs: ``T_2/T_1 = exp(c θ)`` with the wrap θ, where c is -μ to μ.

    Attributes
    ----------
    node, section : int
        Its number among the nodes of the path, and the section of the cable to which it belongs.
    slip : casadi.SX
        Half of what is longer before the pulley than after it, m.
    sliding_speed : casadi.SX
        Speed at which the cable slips over it, towards its first end, m/s.
    """

    def __init__(self, cable: Any, node: int, label: str):
        self.cable, self.node, self._label = cable, node, label
        self.name, path = f"{cable.name}{label}", cable.path
        self.law, self.section = path.nodes[node].friction, path.section_of[node]
        self.switches_modes = self.law.exact
        strands = [k for k, section in enumerate(path.section_of) if section == self.section]
        self.slip = (path.piece(strands[0], node) - path.piece(node, strands[-1] + 1)) / 2
        self.sliding_speed = time_derivative(self.slip)

    @property
    def description(self) -> str:
        """Kind and name of the cable, and the pulley with its name in events if it rubs on several."""
        if len(self.cable.rubbing) == 1:
            return str(self.cable.description)
        return f"{self.cable.description} on the {self.cable.path.nodes[self.node].description} ({self.name})"

    @property
    def sticking_row(self) -> str:
        """Name of the row that is active while it sticks."""
        return f"{self.cable.name}.slip{self._label}"

    @cached_property
    def multipliers(self) -> ca.SX:
        """Multiplier of the row that holds while it sticks, N."""
        return self.cable.multipliers[self.cable.row_names.index(self.sticking_row)]

    @property
    def falls(self) -> bool:
        """True if friction in motion may be below that at rest."""
        return bool(self.law.falls)

    def exponent(self, coefficient: Any) -> ca.SX:
        """Exponent ``c θ`` of the ratio of the tensions, of a coefficient of friction with a sign."""
        return coefficient * self.cable.path.wraps[self.node]

    @cached_property
    def sticking_limit(self) -> ca.SX:
        """Largest difference of the tensions at rest, ``(T_1 + T_2) tanh(μ θ/2)``, N."""
        both = 2 * self.cable.multipliers[self.section]
        for other, difference in self.cable.differences().items():
            if other.section == self.section and other is not self:
                both += difference if other.node < self.node else -difference
        return ca.fabs(both) * ca.tanh(self.exponent(self.law.static_coefficient) / 2)

    def sliding_force(self, mode: Any) -> ca.SX:
        """Tension after the pulley less that before it in a mode of the cable, N."""
        return self.cable.differences(mode)[self]

    @cached_property
    def resistance(self) -> Resistance:
        """Friction by a smoothed law for each newton of load, which is a coefficient of friction with a sign."""
        load = ca.SX.sym("load")
        unit = self.law.resistance(self.name, self.sliding_speed, load)
        if not ca.substitute(unit.force, load, 0).is_zero() or ca.depends_on(ca.gradient(unit.force, load), load):
            raise ModelError(f"{self.description}: {self.law!r} is not proportional to the load of the pulley")
        return Resistance(ca.substitute(unit.force, load, 1), unit.rates, unit.smoothed)

    @property
    def smoothings(self) -> tuple[Smoothing, ...]:
        """Quantities that change within a short time: the smoothed sign of the friction."""
        smoothed = () if self.law.exact else self.resistance.smoothed
        return tuple(Smoothing(s, 2.0, "its change of direction", self.law.remedy) for s in smoothed)

    def law_in(self, sense: str | None) -> tuple[ca.SX | None, ca.SX]:
        """Difference of the tensions if it is given, else None, and the ratio; in a sense, None of the whole cable."""
        if sense == "free":
            return ca.SX(0), ca.SX(1)
        if self.law.exact and sense in (None, "sticks"):
            return -self.multipliers, ca.SX(1)
        if not self.law.exact:
            return None, ca.exp(self.exponent(self.resistance.force))
        coefficient = self.law.static_coefficient if str(sense).startswith("pulled") else self.law.coefficient
        return None, ca.exp(self.exponent(coefficient if str(sense).endswith("back") else -coefficient))


def differences(rubbing: Sequence[Rubbing], senses: Mapping[Rubbing, str], multipliers: ca.SX) -> dict[Rubbing, ca.SX]:
    """Return what each friction adds to the tension of a cable, N.

    In a section whose multiplier is ``λ = (T_first + T_last)/2`` each pulley multiplies the tension by its ratio, or
    adds what holds it: ``T_last = P T_first + C``, so ``T_first = (2 λ - C)/(1 + P)``.

    Parameters
    ----------
    rubbing : sequence of Rubbing
        Pulleys on which it rubs, in order.
    senses : mapping of Rubbing to str
        Modes of the exact ones; of none in the whole cable.
    multipliers : casadi.SX
        Multipliers of the sections.
    """
    found: dict[Rubbing, ca.SX] = {}
    for section in dict.fromkeys(one.section for one in rubbing):
        laws = {one: one.law_in(senses.get(one)) for one in rubbing if one.section == section}
        product, added = ca.SX(1), ca.SX(0)
        for given, ratio in laws.values():
            product, added = product * ratio, added * ratio + (0 if given is None else given)
        tension = (2 * ca.fabs(multipliers[section]) - added) / (1 + product)
        for one, (given, ratio) in laws.items():
            found[one] = tension * (ratio - 1) if given is None else given
            tension += found[one]
    return found


class CableInMode(ActiveRows):
    """A cable that sticks on some pulleys, and slips over others with a given friction."""

    kind = "cable"

    def __init__(self, cable: Any, mode: Sequence[str]):
        senses = dict(zip(cable.frictions, mode, strict=True))
        sections = cable.rows.numel()
        chosen = [sections + k for k, one in enumerate(cable.frictions) if senses[one] == "sticks"]
        speeds = [one.sliding_speed for one in cable.frictions if senses[one] == "sticks"]
        forces = cable.differences(mode)
        work = tuple((one.slip, forces[one]) for one in cable.rubbing if senses.get(one) != "sticks")
        super().__init__(
            cable,
            rows=cable.rows,
            velocity_rows=ca.vertcat(ca.SX(0, 1), *speeds),
            chosen=[*range(sections), *chosen],
            virtual_work=work,
        )
        self.cable, self.rates, self.smoothings = cable, cable.rates, cable.smoothings

    @property
    def bodies(self) -> tuple[Any, ...]:
        """Bodies on which it acts."""
        return tuple(self.cable.bodies)
