"""Smooth curves near samples that carry noise: splines of degree five that bend as little as may be."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...errors import ModelError
from ..symbols import Numbers, positive
from .splines import sampled

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Degree of the curve, order of the derivative that is kept small, nodes by which its square is integrated exactly.
DEGREE, ORDER, NODES = 5, 3, 3


def smoothing_spline(
    times: Numbers, values: Numbers, *, cutoff: float | None = None, noise: float | None = None
) -> BSpline:
    """Return the smooth curve near samples of a motion that carry noise.

    The curve f of degree five with which ``∫ (y - f)² dt + (2 π cutoff)^-6 ∫ f'''² dt`` is least, the first integral
    over the samples by the trapezoidal rule. Samples of frequency ν pass by the share ``1 / (1 + (ν / cutoff)^6)``
    without any delay, as through a Butterworth filter of third order that runs forward and backward; a parabola passes
    unchanged. At its ends the curve is free: accelerations are not drawn to zero there, but within about half a period
    of the cut-off they follow the noise more than elsewhere; measure that long before and after what matters.

    Parameters
    ----------
    times : sequence of float
        Times of the samples, at least six, increasing, evenly spaced or not, s. Samples that are missing are left out.
    values : sequence of float
        Samples of a marker's coordinate or of an angle, m or rad.
    cutoff : float, optional
        Frequency of which half the amplitude passes, Hz: above those of the motion, below half the rate of the samples.
        For the gait of humans 6 Hz is usual.
    noise : float, optional
        Instead: the standard deviation of the noise, in the unit of the values. The cut-off is then the one with which
        the samples miss the curve by that root mean square.

    Returns
    -------
    scipy.interpolate.BSpline
        A function of time, with ``.derivative(n)``. Drivers take it as their value, and ``inverse_dynamics`` in
        ``motion=``. It is not defined outside the samples.

    Raises
    ------
    ModelError
        For samples that are not finite, not increasing or too few; unless one of `cutoff` and `noise` is given; for a
        cut-off beyond half the rate of the samples.

    References
    ----------
    H. J. Woltring, "A Fortran package for generalized, cross-validatory spline smoothing and differentiation",
    Advances in Engineering Software 8 (1986) 104, doi:10.1016/0141-1195(86)90098-7.

    Examples
    --------
    >>> import numpy as np
    >>> times = np.linspace(0, 1, 101)
    >>> noise = 0.003 * np.random.default_rng(1).standard_normal(101)
    >>> curve = smoothing_spline(times, 0.4 * np.sin(3 * times) + noise, cutoff=4)
    >>> bool(abs(curve(0.5) - 0.4 * np.sin(1.5)) < 0.002)
    True
    """
    xs, ys = sampled(times, values, "smoothing_spline")
    if (cutoff is None) == (noise is None):
        raise ModelError(
            "smoothing_spline: give either cutoff=, in Hz, or noise=, the standard deviation of the values"
        )
    highest = 0.5 / float(np.median(np.diff(xs)))
    if cutoff is not None:
        cutoff = positive(cutoff, "smoothing_spline", "cutoff")
        if cutoff > highest:
            raise ModelError(
                f"smoothing_spline: a cut-off of {cutoff:.6g} Hz is beyond half the rate of the samples, "
                f"{highest:.6g} Hz, where nothing is smoothed; give a lower one"
            )
        return _smooth(xs, ys, cutoff)
    return _within_noise(xs, ys, positive(noise, "smoothing_spline", "noise"), highest)


def _smooth(xs: np.ndarray, ys: np.ndarray, cutoff: float) -> BSpline:
    """The curve with a cut-off: linear least squares, both integrals as sums of squares."""
    from scipy.interpolate import BSpline
    from scipy.sparse import block_array, csc_array, diags_array, eye_array, vstack
    from scipy.sparse.linalg import spsolve

    unit = 2 * np.pi * cutoff
    x = unit * (xs - xs[0])  # without a unit, in which both sums weigh the same
    steps = np.diff(x)
    knots = np.r_[[x[0]] * DEGREE, x, [x[-1]] * DEGREE]
    places, shares = np.polynomial.legendre.leggauss(NODES)
    nodes = (x[:-1, None] + steps[:, None] * (1 + places) / 2).ravel()
    slopes, inner = eye_array(x.size + DEGREE - 1, format="csr"), knots
    for degree in range(DEGREE, DEGREE - ORDER, -1):  # coefficients of the derivative of a spline
        slopes = diags_array(degree / (inner[degree + 1 : -1] - inner[1 : -degree - 1])) @ (slopes[1:] - slopes[:-1])
        inner = inner[1:-1]
    third = BSpline.design_matrix(nodes, inner, DEGREE - ORDER) @ slopes
    roots = np.sqrt(np.r_[steps / 2, 0] + np.r_[0, steps / 2])
    bends = np.sqrt(np.outer(steps / 2, shares).ravel())
    rows = csc_array(vstack([diags_array(roots) @ BSpline.design_matrix(x, knots, DEGREE), diags_array(bends) @ third]))
    # least squares with the residuals as unknowns: the normal equations would square the ratio of frequencies
    right = np.r_[roots * ys, np.zeros(bends.size + rows.shape[1])]
    system = block_array([[eye_array(rows.shape[0]), rows], [rows.T, None]], format="csc")
    coefficients = spsolve(system, right)[rows.shape[0] :]
    return BSpline(np.r_[[xs[0]] * DEGREE, xs, [xs[-1]] * DEGREE], coefficients, DEGREE, extrapolate=False)


def _within_noise(xs: np.ndarray, ys: np.ndarray, noise: float, highest: float) -> BSpline:
    """The smoothest curve that the samples miss by no more than their noise."""
    from scipy.interpolate import make_lsq_spline
    from scipy.optimize import brentq

    parabola = make_lsq_spline(xs, ys, np.r_[[xs[0]] * ORDER, [xs[-1]] * ORDER], k=ORDER - 1)
    parabola.extrapolate = False

    def excess(curve: BSpline) -> float:
        return float(np.sqrt(np.mean((ys - curve(xs)) ** 2)) / noise - 1)

    if excess(parabola) <= 0:
        return parabola
    if excess(_smooth(xs, ys, highest)) >= 0:
        raise ModelError(
            f"smoothing_spline: samples of a noise of {noise:.6g} are met closer than that by no curve with a cut-off "
            f"below half their rate, {highest:.6g} Hz; give the noise that they have, or a cut-off"
        )
    low = highest
    while excess(_smooth(xs, ys, low)) < 0:
        low /= 2
    cutoff = np.exp(brentq(lambda log: excess(_smooth(xs, ys, np.exp(log))), np.log(low), np.log(2 * low)))
    return _smooth(xs, ys, float(cutoff))
