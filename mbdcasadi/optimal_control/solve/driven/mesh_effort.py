"""The effort of the motions on a mesh as a sum of squares, and the motion of which it is least."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ....numerics.banded_least_squares import LeastSquaresEnd, Linearisation, minimise
from ....numerics.collocation import gauss
from ....numerics.lazy import cached_property
from .effort import Effort
from .inverse_dynamics import InverseDynamics
from .spline import MotionSpline


class MeshEffort:
    """The effort of the motions on a mesh as a sum of squares, by a quadrature of twice as many points as stages.

    Parameters
    ----------
    dynamics : InverseDynamics
        Of the mechanism.
    effort : Effort
        Running cost.
    spline : MotionSpline
        The motions.
    sizes : numpy.ndarray
        Typical sizes of the accelerations (n,).
    """

    def __init__(self, dynamics: InverseDynamics, effort: Effort, spline: MotionSpline, sizes: np.ndarray):
        self.spline, self._dynamics, self._effort, self._sizes = spline, dynamics, effort, sizes
        rule = gauss(2 * spline.degree)
        self._times, self._shapes = spline.points(rule.points)
        self._weights = np.sqrt(np.outer(np.diff(spline.times), rule.weights)).ravel()

    def end(
        self, x: np.ndarray, tolerance: float, limit: int, stopped: Callable[[], bool] = lambda: False
    ) -> LeastSquaresEnd:
        """The least sum of squares near unknowns; arguments are those of :func:`minimise`."""
        search = partial(minimise, tolerance=tolerance, limit=limit, stopped=stopped)
        with np.errstate(over="ignore", invalid="ignore"):  # motions that are far too fast are only tried
            return search(self.residuals, partial(_Linearised, self), self._metric, x)

    def at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places, inputs and derivatives by the inputs at the points of the quadrature."""
        places = self.spline.places(x, self._shapes)
        return places, *self._dynamics.inputs(self._times, places)

    def weighted(self, places: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Residuals at the points of the quadrature, one after the other."""
        rows = self._effort.residuals(places[:, 0], places[:, 1], u)
        weighted: np.ndarray = (rows * self._weights[:, None]).ravel()
        return weighted

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """Residuals at unknowns."""
        places, u, _ = self.at(x)
        return self.weighted(places, u)

    def value(self, x: np.ndarray) -> float:
        """Sum of squares at unknowns."""
        residuals = self.residuals(x)
        return float(residuals @ residuals)

    def pulls(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the sum of squares by the first and the last state, each (2 n,)."""
        at = _Linearised(self, x)
        return self.spline.gathered_at_ends(at.by_interval(2 * at.residuals))

    def slopes(self, places: np.ndarray, u: np.ndarray, by_inputs: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals by what decides the motion in each interval (N, k r, (degree + 2) n)."""
        spline, n = self.spline, self.spline.n
        of_inputs = self._dynamics.slopes(self._times, places, u, by_inputs)
        slopes = self._effort.slopes(of_inputs) * self._weights[:, None, None]
        by_place = slopes.reshape(*slopes.shape[:2], 3, n)
        by_shape = np.einsum("kedn,kdf->kefn", by_place, self._shapes, optimize=True)
        return by_shape.reshape(spline.count, -1, spline.width)

    @cached_property
    def _metric(self) -> np.ndarray:
        """Integral of the squared accelerations over their sizes, as a lower band."""
        spline, weighted = self.spline, self._shapes[:, 2] * self._weights[:, None]
        by_interval = weighted.reshape(spline.count, -1, spline.degree + 2)
        of_one = np.swapaxes(by_interval, 1, 2) @ by_interval
        parts = np.einsum("ifg,nm->ifngm", of_one, np.diag(self._sizes**-2.0))
        return spline.band(parts.reshape(spline.count, spline.width, -1))


class _Linearised(Linearisation):
    """Residuals of a motion with their derivatives."""

    def __init__(self, search: MeshEffort, x: np.ndarray):
        self._spline = search.spline
        at = search.at(x)
        self.residuals = search.weighted(*at[:2])
        self._slopes = search.slopes(*at)

    @cached_property
    def normal(self) -> np.ndarray:
        return self._spline.band(np.swapaxes(self._slopes, 1, 2) @ self._slopes)

    def times(self, step: np.ndarray) -> np.ndarray:
        product: np.ndarray = (self._slopes @ self._spline.changes(step)[:, :, None]).ravel()
        return product

    def transposed(self, values: np.ndarray) -> np.ndarray:
        return self._spline.gathered(self.by_interval(values))

    def by_interval(self, values: np.ndarray) -> np.ndarray:
        """The same of what decides the motion in each interval (N, (degree + 2) n)."""
        products: np.ndarray = (values.reshape(self._spline.count, 1, -1) @ self._slopes)[:, 0]
        return products
