"""Laws of friction: force over sliding speed and load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...immutable import Immutable
from ...quantities import HasQuantities, known_value
from ...symbols import Scalar, StateVariable


@dataclass(frozen=True, eq=False)
class Resistance:
    """Friction at one place, by a law.

    Parameters
    ----------
    force : casadi.SX
        Force along the sliding speed, N: against it, so that a passive law has ``force · speed <= 0``.
    rates : dict of StateVariable to casadi.SX
        Rates of the deflections of bristles, if the law has any.
    smoothed : tuple of casadi.SX
        Quantities between -1 and 1 that change fast at the smoothed jump of the law; a simulation warns if its steps
        jump over them.
    """

    force: ca.SX
    rates: Mapping[Any, ca.SX] = field(default_factory=dict)
    smoothed: tuple[ca.SX, ...] = ()


class FrictionLaw(Immutable, HasQuantities):
    """Base class of friction laws: force as a function of sliding speed and load.

    Laws can be added: ``Coulomb(0.2, 1e-3) + Viscous(5)``.

    Attributes
    ----------
    velocity_tolerance : float, expression or None
        Speed over which the jump at zero is smoothed, m/s; None if there is none.
    deflection_tolerance : float, expression or None
        Deflection of the bristles before they slide, m; None if there are none.
    limits : tuple of Limit
        Ranges of its quantities.
    exact : bool
        True if the law switches between exact stiction and sliding.
    """

    velocity_tolerance: Any = None
    deflection_tolerance: Any = None
    exact: bool = False
    #: remedy if a run does not resolve the law
    remedy: str = "or widen velocity_tolerance"

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force at a sliding speed (m/s) under a load (N, not negative).

        Parameters
        ----------
        name : str
            Name of the element, for the state variables of the law.
        """
        raise NotImplementedError

    @property
    def falls(self) -> bool:
        """True if friction in motion may be below that at rest, by a law with a static coefficient."""
        return known_value(ca.SX(self.static_coefficient) - self.coefficient) != 0  # type: ignore[attr-defined]

    def _check_static(self) -> None:
        """Raise an error for a static coefficient below that of sliding."""
        below = ca.SX(self.static_coefficient) - self.coefficient  # type: ignore[attr-defined]
        self.read(below, "static_coefficient - coefficient", at_least=0.0)

    def __add__(self, other: Any) -> FrictionLaw:
        if not isinstance(other, FrictionLaw):
            return NotImplemented
        return SumOfLaws(self, other)


class SumOfLaws(FrictionLaw):
    """Sum of two laws."""

    def __init__(self, first: FrictionLaw, second: FrictionLaw):
        for law in (first, second):
            if law.exact:
                raise ModelError(f"{law!r} switches between sticking and sliding and cannot be added to another law")
        self.parts = (first, second)
        self.limits = (*first.limits, *second.limits)
        for name in ("velocity_tolerance", "deflection_tolerance"):
            widths = [getattr(law, name) for law in self.parts if getattr(law, name) is not None]
            setattr(self, name, min(widths, key=_size, default=None))

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the sum of both."""
        first, second = (part.resistance(f"{name}.{k}", speed, load) for k, part in enumerate(self.parts))
        rates = {**first.rates, **second.rates}
        return Resistance(first.force + second.force, rates, (*first.smoothed, *second.smoothed))

    def __repr__(self) -> str:
        return " + ".join(repr(part) for part in self.parts)


def _size(value: Any) -> float:
    known = known_value(value)
    return float("inf") if known is None else known


def as_law(law: Any, what: str) -> FrictionLaw:
    """Return a friction law; raise an error for anything else."""
    if not isinstance(law, FrictionLaw):
        raise ModelError(f"{what}: law must be a friction law such as Coulomb, Stribeck, LuGre or Viscous, got {law!r}")
    return law


class Coulomb(FrictionLaw):
    """``F = -μ N tanh(v/v_t)``.

    Parameters
    ----------
    coefficient : float or expression
        μ, at least 0.
    velocity_tolerance : float or expression
        v_t, m/s: the speed over which the jump at rest is smoothed. Under a constant push
        F below μ N the surfaces creep at ``v_t artanh(F/(μ N))``.

    References
    ----------
    Andersson, Söderberg, Björklund, "Friction models for sliding dry, boundary and
    mixed lubricated contacts", Tribology International 40 (2007) 580.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.Coulomb(0.3, velocity_tolerance=1e-4)
    Coulomb(0.3, velocity_tolerance=0.0001)
    """

    def __init__(self, coefficient: Scalar, velocity_tolerance: Scalar):
        self.coefficient = self.read(coefficient, "coefficient", at_least=0.0)
        self.velocity_tolerance = self.read(velocity_tolerance, "velocity_tolerance", above=0.0)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force against the motion."""
        sign = ca.tanh(speed / self.velocity_tolerance)
        return Resistance(-self.coefficient * load * sign, smoothed=(sign,))

    def __repr__(self) -> str:
        return f"Coulomb({self.coefficient}, velocity_tolerance={self.velocity_tolerance})"


#: Largest ratio of velocity tolerance to Stribeck velocity: above it the static peak is cut off.
STRIBECK_SHARE = 0.2


class Stribeck(FrictionLaw):
    """``F = -N (μ + (μ_s - μ) exp(-(v/v_s)²)) tanh(v/v_t)``.

    Parameters
    ----------
    coefficient, static_coefficient : float or expression
        μ of sliding and μ_s of rest, ``0 <= μ <= μ_s``.
    stribeck_velocity : float or expression
        v_s, m/s, over which friction falls from rest to sliding.
    velocity_tolerance : float or expression
        v_t, m/s, at most a fifth of v_s: above it, the peak at rest is not reached.

    References
    ----------
    Armstrong-Hélouvry, Dupont, Canudas de Wit, "A survey of models, analysis tools and
    compensation methods for the control of machines with friction", Automatica 30 (1994) 1083.
    """

    def __init__(
        self,
        coefficient: Scalar,
        static_coefficient: Scalar,
        stribeck_velocity: Scalar,
        velocity_tolerance: Scalar,
    ):
        self.coefficient = self.read(coefficient, "coefficient", at_least=0.0)
        self.static_coefficient = self.read(static_coefficient, "static_coefficient", at_least=0.0)
        self.stribeck_velocity = self.read(stribeck_velocity, "stribeck_velocity", above=0.0)
        self.velocity_tolerance = self.read(velocity_tolerance, "velocity_tolerance", above=0.0)
        self._check_static()
        tolerance, velocity = known_value(self.velocity_tolerance), known_value(self.stribeck_velocity)
        if tolerance is not None and velocity is not None and tolerance > STRIBECK_SHARE * velocity:
            raise ModelError(
                f"Stribeck: velocity_tolerance = {tolerance:g} m/s cuts off the static peak, which is "
                f"{velocity:g} m/s wide; take at most {STRIBECK_SHARE * velocity:g}"
            )

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force against the motion."""
        excess = (self.static_coefficient - self.coefficient) * ca.exp(-((speed / self.stribeck_velocity) ** 2))
        sign = ca.tanh(speed / self.velocity_tolerance)
        return Resistance(-load * (self.coefficient + excess) * sign, smoothed=(sign,))

    def __repr__(self) -> str:
        return (
            f"Stribeck({self.coefficient}, {self.static_coefficient}, {self.stribeck_velocity}, "
            f"velocity_tolerance={self.velocity_tolerance})"
        )


class Viscous(FrictionLaw):
    """``F = -c v``, independent of the load; in a contact, while the surfaces touch.

    Parameters
    ----------
    coefficient : float or expression
        c, N s/m, at least 0; in a pin, of the surfaces, so that the torque is ``-c r² ω``.
    """

    def __init__(self, coefficient: Scalar):
        self.coefficient = self.read(coefficient, "coefficient", at_least=0.0)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force against the motion."""
        return Resistance(-self.coefficient * speed)

    def __repr__(self) -> str:
        return f"Viscous({self.coefficient})"


class LuGre(FrictionLaw):
    """``F = -N (σ0 z + σ1(v) ż)``, ``ż = v - σ0 |v| z / g(v)``, ``g = μ + (μ_s - μ) exp(-(v/v_s)²)``.

    The deflection z of the bristles is a first-order state for each place at which the law acts.
    At rest F balances any push up to μ_s N, without creep.

    Parameters
    ----------
    coefficient, static_coefficient : float or expression
        μ and μ_s, ``0 < μ <= μ_s``.
    stribeck_velocity : float or expression
        v_s, m/s.
    stiffness : float or expression
        σ0, 1/m: stiffness of the bristles per newton of load; μ_s/σ0 is the largest deflection.
    damping : float or expression, default 0
        σ1, s/m, per newton of load. It acts as ``σ1(v) = σ1 exp(-(v/v_s)²)``, so that
        the bristles do not drive the motion at speed.

    Notes
    -----
    With the energy ``N σ0 z²/2`` of the bristles, the law dissipates
    ``N |v| (u² - σ1(v) v u + σ1(v) |v| g)/g``, ``u = σ0 z``: not negative at any deflection if
    ``σ1(v) |v| <= 4 g(v)``, which ``σ1 v_s <= 4 √(2e) μ ≈ 9.3 μ`` ensures. With more damping the law
    may put energy into the motion. It also may if the load changes while the bristles are bent, as in a
    bouncing contact: a growing load stiffens them without work. With a constant σ1, as first proposed,
    additional viscous friction of at least ``N σ1 (μ_s - μ)/μ`` would be necessary (Barabanov and Ortega).

    References
    ----------
    Canudas de Wit, Olsson, Åström, Lischinsky, "A new model for control of systems with
    friction", IEEE Trans. Automatic Control 40 (1995) 419; Olsson, "Control systems with
    friction", thesis, Lund 1996 (damping that falls with the speed); Barabanov, Ortega, "Necessary
    and sufficient conditions for passivity of the LuGre friction model", IEEE Trans. Automatic
    Control 45 (2000) 830.
    """

    remedy = "or take softer bristles"

    def __init__(
        self,
        coefficient: Scalar,
        static_coefficient: Scalar,
        stribeck_velocity: Scalar,
        stiffness: Scalar,
        damping: Scalar = 0.0,
    ):
        self.coefficient = self.read(coefficient, "coefficient", above=0.0)
        self.static_coefficient = self.read(static_coefficient, "static_coefficient", above=0.0)
        self.stribeck_velocity = self.read(stribeck_velocity, "stribeck_velocity", above=0.0)
        self.stiffness = self.read(stiffness, "stiffness", above=0.0)
        self.damping = self.read(damping, "damping", at_least=0.0)
        self._check_static()
        self.deflection_tolerance = self.static_coefficient / self.stiffness

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force against the motion, with a new deflection."""
        deflection = StateVariable(f"{name}.deflection")
        near = ca.exp(-((speed / self.stribeck_velocity) ** 2))
        g = self.coefficient + (self.static_coefficient - self.coefficient) * near
        rate = speed - self.stiffness * ca.fabs(speed) * deflection / g
        force = -load * (self.stiffness * deflection + self.damping * near * rate)
        return Resistance(force, {deflection: rate}, (self.stiffness / self.static_coefficient * deflection,))

    def __repr__(self) -> str:
        return (
            f"LuGre({self.coefficient}, {self.static_coefficient}, {self.stribeck_velocity}, {self.stiffness}, "
            f"damping={self.damping})"
        )


class DryFriction(FrictionLaw):
    """Exact stick and slip: ``|F| <= μ_s N`` at rest, ``F = -μ N sgn v`` in motion; in joints and rigid contacts.

    For :func:`simulate`, :func:`equilibrium`, :func:`linearize`, :func:`sensitivities`, :func:`stability` and, without
    a static coefficient of its own, :func:`optimize`. The motion switches between sticking, with the sliding speed held
    at zero by a multiplier, and sliding, at instants that are located to rounding and listed in ``motion.events`` as
    "<name> stops" and "<name> breaks away", and in ``solution.switches``. Nothing creeps, and there is no velocity
    tolerance. Several frictions that one motion would make slide hold it as long as they can together. Friction takes
    no part in the impulse of an event that resets velocities.

    Parameters
    ----------
    coefficient : float or expression
        μ of sliding, at least 0.
    static_coefficient : float or expression, optional
        μ_s of rest, at least μ; μ by default.

    References
    ----------
    Haug, Wu, Yang, "Dynamics of mechanical systems with Coulomb friction, stiction,
    impact and constraint addition-deletion", Mechanism and Machine Theory 21 (1986) 401.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.DryFriction(0.3, static_coefficient=0.4)
    DryFriction(0.3, static_coefficient=0.4)
    """

    exact = True

    def __init__(self, coefficient: Scalar, static_coefficient: Scalar | None = None):
        self.coefficient = self.read(coefficient, "coefficient", at_least=0.0)
        static = coefficient if static_coefficient is None else static_coefficient
        self.static_coefficient = self.read(static, "static_coefficient", at_least=0.0)
        self._check_static()

    def __repr__(self) -> str:
        return f"DryFriction({self.coefficient}, static_coefficient={self.static_coefficient})"
