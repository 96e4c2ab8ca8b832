"""One linkage that passes through given positions."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..errors import ExpressionError, ModelError
from ..inverse_dynamics.inverse_dynamics import inverse_dynamics
from ..kinematics.kinematics import kinematics
from ..model.drivers import Driver
from ..model.mechanism import Mechanism
from ..model.quantities import whole
from ..model.symbols import Parameter, number
from ..model.symbols import t as time
from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.assemble import assemble
from ..visual.drawing.draw import draw
from .circuit import Circuit, Poses, circuit_through, turning_pins

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Outputs of a motion over one turn, with both ends.
OUTPUTS = 201


class Shared:
    """What the linkages of a list have in common: the mechanism, its unknowns, and the speed of a crank.

    Parameters
    ----------
    mechanism : Mechanism
        Without drivers.
    unknowns : sequence of Parameter
        Its unknown dimensions.
    """

    def __init__(self, mechanism: Mechanism, unknowns: tuple[Parameter, ...]):
        self.speed = Parameter("speed of the crank", 2 * np.pi)
        self.given, self.unknowns = mechanism, unknowns
        self.mechanism = mechanism.replace(parameters=[*mechanism.parameters, self.speed])
        self.poses = Poses(mechanism)


class Linkage:
    """Dimensions with which a mechanism passes through given positions; made by :func:`synthesize`.

    ``linkage[expression]`` is the value of an expression in parameters.

    Attributes
    ----------
    parameters : mapping of Parameter to float
        The unknowns that were found; it cannot be changed.
    poses : numpy.ndarray
        Coordinates of all bodies at the positions (positions, n), m and rad.
    residual : float
        Largest amount by which a relation or a joint is missed, m or rad.
    misses : dict of str to float
        Relations that are missed most, by name, the largest first.
    found : int
        Number of starts that led to it.
    family : int
        Dimensions that it has free beyond what positions leave free of any linkage: it belongs to a family of others,
        such as parallelograms.
    independent_poses : numpy.ndarray
        The coordinates of these that pins do not give (positions, k).
    """

    parameters: Mapping[Parameter, float]
    misses: dict[str, float]
    residual: float
    found: int
    family: int

    def __init__(
        self,
        shared: Shared,
        values: np.ndarray,
        poses: np.ndarray,
        misses: dict[str, float],
        residual: float,
        found: int,
        family: int = 0,
    ):
        self._shared, self.independent_poses = shared, poses
        self.parameters = MappingProxyType(dict(zip(shared.unknowns, values.tolist(), strict=True)))
        self.misses, self.residual, self.found, self.family = misses, residual, found, family

    # --- values ----------------------------------------------------------------------------------
    def __getitem__(self, expression: Any) -> Any:
        """Value of an expression in parameters: a float of a scalar, else an array."""
        eom = equations(self._shared.given)
        try:
            values = ca.Function("value", [eom.p], [ca.densify(ca.SX(expression))])(self._p).full()
        except (NotImplementedError, RuntimeError):
            raise ExpressionError(
                f"a linkage has values of parameters of its mechanism, and {expression} is no expression of these; "
                "positions are quantities of linkage.motion()"
            ) from None
        return float(values[0, 0]) if values.size == 1 else values.squeeze()

    @cached_property
    def _p(self) -> np.ndarray:
        """Values of all parameters of the mechanism."""
        mechanism, known = self._shared.given, self.parameters
        return np.array([known.get(p, mechanism.value_of(p, p.value)) for p in mechanism.parameters])

    @cached_property
    def poses(self) -> np.ndarray:
        """Coordinates of all bodies at the positions (positions, n)."""
        return self._shared.poses.coordinates(self.independent_poses, self._p)

    @property
    def gap(self) -> float:
        """Largest gap of a joint at a position, m or rad."""
        rows = [self._shared.poses.rows(y, self._p)[0] for y in self.independent_poses]
        return largest(np.array(rows))

    @cached_property
    def mechanism(self) -> Mechanism:
        """The mechanism with these dimensions, in the pose of the first position; on the symbols of the given one."""
        base, eom = self._shared.mechanism, equations(self._shared.given)
        pose = zip(ca.vertsplit(eom.q), self.poses[0].tolist(), strict=True)
        return base.replace(values={**base.values, **self.parameters, **dict(pose)})

    @property
    def state(self) -> State:
        """The first position at rest."""
        return assemble(self.mechanism)

    # --- checks ----------------------------------------------------------------------------------
    @cached_property
    def _circuit(self) -> Circuit | None:
        poses = self._shared.poses
        places = self.poses[:, : 3 * len(poses.mechanism.bodies)].reshape(-1, 3)[:, :2]
        extent = max(float(np.ptp(places)), np.finfo(float).tiny)
        return circuit_through(poses, self.independent_poses, self._p, np.where(poses.turning, 1.0, extent))

    @property
    def one_branch(self) -> bool | None:
        """True if a motion leads from each position to all others; None if that is not decided.

        The poses of a linkage of one degree of freedom are closed curves, its circuits. It is not decided for others,
        nor if the circuit of the first position has singular poses, where curves meet.
        """
        return None if self._circuit is None else not bool(np.isnan(self._circuit.places).any())

    @property
    def in_order(self) -> bool | None:
        """True if the positions lie on one circuit and are passed in their order; None if that is not decided."""
        return None if self._circuit is None else self._circuit.in_order

    @cached_property
    def _crank(self) -> int | None:
        """Number of the first pin on the ground whose body turns fully."""
        turning = [] if self._circuit is None else turning_pins(self._shared.poses, self._circuit, self._p)
        return turning[0] if turning else None

    @property
    def crank_turns(self) -> bool | None:
        """True if a body that is pinned to the ground turns fully and always one way; None if that is not decided."""
        return None if self._circuit is None else self._crank is not None

    @cached_property
    def driver(self) -> Driver | None:
        """Driver that turns this crank from the first position, so that the others follow in their order; or None.

        It is not among those of the mechanism: ``linkage.mechanism.replace(drivers=[linkage.driver])``. Its speed is
        the mechanism's parameter `speed of the crank`, one turn a second if nothing else is said.
        """
        if self._crank is None or self._circuit is None:
            return None
        poses, curve = self._shared.poses, self._circuit.curve
        angle = poses.turns[self._crank]
        body = angle.b.body if angle.a.body.is_ground else angle.a.body
        first, second = poses.angles(curve.points[:2], self._p)[:, self._crank]
        one_branch = bool(self.one_branch)
        sense = float(np.sign(second - first)) * (self._circuit.sense if one_branch else 1)
        start = float(poses.angles(self.independent_poses[:1], self._p)[0, self._crank])
        return Driver(f"crank {body.name}", body.phi, start + sense * self._shared.speed * time)

    @property
    def transmission_angle(self) -> float | None:
        """Least angle between coupler and follower over a turn of the crank, up to a right one, rad.

        None if no crank turns, or the linkage is no four-bar of a crank, a coupler and a follower.
        """
        if self._crank is None or self._circuit is None:
            return None
        return self._circuit.least_transmission(self._shared.poses, self._crank, self._p)

    # --- analyses --------------------------------------------------------------------------------
    def motion(self, speed: float = 2 * np.pi, outputs: int = OUTPUTS) -> Trajectory:
        """One turn of the crank at a constant speed, with reactions and the effort of the driver.

        Parameters
        ----------
        speed : float, default 2 pi
            Of the crank, rad/s; a negative one passes the positions backwards.
        outputs : int, default 201
            Number of times, with both ends.

        Returns
        -------
        Trajectory
            Of :func:`inverse_dynamics`; ``motion[linkage.driver.effort]`` is the torque.

        Raises
        ------
        ModelError
            If no crank turns.
        """
        return inverse_dynamics(*self._driven("motion", speed, outputs), parameters={self._shared.speed: speed})

    def _driven(self, what: str, speed: float, outputs: int) -> tuple[Mechanism, np.ndarray]:
        """Mechanism with the driver, and times of one turn."""
        speed, outputs = number(speed, what, "speed"), whole(outputs, what, "outputs", 2)
        if speed == 0:
            raise ModelError(f"{what}: speed must not be zero")
        if self.driver is None:
            raise ModelError(
                f"{what}: no body that is pinned to the ground turns fully, always one way; add a Driver of your own "
                "to linkage.mechanism, or choose by crank_turns"
            )
        return self.mechanism.replace(drivers=[self.driver]), np.linspace(0, 2 * np.pi / abs(speed), outputs)

    def draw(self, axes: Axes | None = None, *, trace: Any = (), **options: Any) -> Axes:
        """Draw the linkage in its first position.

        Parameters
        ----------
        axes : matplotlib.axes.Axes, optional
            Axes to draw into.
        trace : sequence of Marker, Body or expression (2,)
            Points whose path over a turn of the crank is drawn; needs a crank that turns.
        **options
            Of :func:`draw`.
        """
        source = kinematics(*self._driven("draw", 2 * np.pi, OUTPUTS)) if trace else self.state
        return draw(source, axes, trace=trace, **options)

    def __repr__(self) -> str:
        values = ", ".join(f"{p.label} = {value:.5g}" for p, value in self.parameters.items())
        return f"Linkage({values})"
