"""States and disturbances of the last samples that fit the measurements best: weighted least squares on a window."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stage:
    """A sample in linear form: ``dx' = A dx + B dd + c`` and ``H dx' + D dd = r``, in deviations of the noise.

    Attributes
    ----------
    by_state, by_disturbance : numpy.ndarray
        Slopes A (n_x, n_x) and B (n_x, n_d) of the state at the end.
    gap : numpy.ndarray
        What the state at the end is short of the motion from that at the start, c (n_x,).
    output, output_by_disturbance : numpy.ndarray
        Slopes H (n_y, n_x) and D (n_y, n_d) of the measurements at the end; zero for those that are missing.
    miss : numpy.ndarray
        Measurements without their model, r (n_y,).
    disturbance : numpy.ndarray
        Disturbances about which this holds (n_d,).
    """

    by_state: np.ndarray
    by_disturbance: np.ndarray
    gap: np.ndarray
    output: np.ndarray
    output_by_disturbance: np.ndarray
    miss: np.ndarray
    disturbance: np.ndarray


@dataclass(frozen=True)
class Arrival:
    """What is known of the first state of the window: mean (n_x,), and a root L of the covariance ``L L^T``."""

    mean: np.ndarray
    root: np.ndarray

    def after(self, stage: Stage, start: np.ndarray, end: np.ndarray, deviation: np.ndarray) -> Arrival:
        """That of the next state: a step of the square-root Kalman filter about the states of the window.

        Parameters
        ----------
        stage : Stage
            The sample between them.
        start, end : numpy.ndarray
            States of the window (n_x,) about which the stage is linear.
        deviation : numpy.ndarray
            Deviations of the disturbances (n_d,).
        """
        rows = stage.miss.size
        at_end = np.hstack([stage.by_state @ self.root, stage.by_disturbance * deviation])
        seen = stage.output @ at_end
        seen[:, self.root.shape[1] :] += stage.output_by_disturbance * deviation
        both = np.vstack([np.hstack([np.eye(rows), seen]), np.hstack([np.zeros((end.size, rows)), at_end])])
        root = _triangle(both.T).T
        step = stage.by_state @ (self.mean - start) - stage.by_disturbance @ stage.disturbance + stage.gap
        miss = stage.miss - stage.output @ step + stage.output_by_disturbance @ stage.disturbance
        gain = np.linalg.solve(root[:rows, :rows], miss)
        return Arrival(end + step + root[rows:, :rows] @ gain, root[rows:, rows:])


def best_changes(
    arrival: Arrival, first: np.ndarray, stages: Sequence[Stage], deviation: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Changes of states and disturbances that make the sum of squares of the linear window least.

    The sum is that of the normed first state, of disturbances and of misses of measurements, each in deviations.
    Backwards over the window, orthogonal factors take out the disturbance of each stage.

    Parameters
    ----------
    arrival : Arrival
        Mean and covariance of the first state.
    first : numpy.ndarray
        First state of the window (n_x,).
    stages : sequence of Stage
        Samples of the window, in order.
    deviation : numpy.ndarray
        Deviations of the disturbances (n_d,).

    Returns
    -------
    states : list of numpy.ndarray
        Changes at the ends of stages, one more than these.
    disturbances : list of numpy.ndarray
        Changes in each stage.
    """
    n, m = first.size, deviation.size
    slopes, rest = np.zeros((0, n)), np.zeros(0)
    laws = []
    for stage in reversed(stages):
        to_come = np.vstack([slopes, stage.output])
        direct = np.vstack([np.zeros((len(slopes), m)), stage.output_by_disturbance])
        wanted = np.concatenate([rest, stage.miss]) - to_come @ stage.gap
        rows = np.hstack([to_come @ stage.by_disturbance + direct, to_come @ stage.by_state, wanted[:, None]])
        weighed = np.hstack([np.diag(1 / deviation), np.zeros((m, n)), -(stage.disturbance / deviation)[:, None]])
        factor = _triangle(np.vstack([weighed, rows]))
        laws.append(np.linalg.solve(factor[:m, :m], factor[:m, m:]))
        slopes, rest = factor[m : m + n, m:-1], factor[m : m + n, -1]
    off = arrival.mean - first
    system = np.vstack([np.eye(arrival.root.shape[1]), slopes @ arrival.root])
    normed = np.linalg.lstsq(system, np.concatenate([np.zeros(arrival.root.shape[1]), rest - slopes @ off]))[0]
    states, disturbances = [off + arrival.root @ normed], []
    for stage, law in zip(stages, reversed(laws), strict=True):
        disturbances.append(law[:, -1] - law[:, :-1] @ states[-1])
        states.append(stage.by_state @ states[-1] + stage.by_disturbance @ disturbances[-1] + stage.gap)
    return states, disturbances


def _triangle(matrix: np.ndarray) -> np.ndarray:
    """R of the orthogonal factors, with ``R^T R = A^T A``."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))
