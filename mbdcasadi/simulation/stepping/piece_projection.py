"""States of a piece of a run on the constraints, and the failure if they cannot be brought there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...integrators.compiled import IntegrationFailure
from ..outputs import Outputs
from ..path import Path
from ..schedule import Piece
from ..stepper import Stepper

#: Violation of a constraint (m or rad) that projection cannot remove, from which the mechanism counts as apart.
PHI_TOLERANCE = 1e-8
#: Change of the correction by projection from one output to the next, relative to the sizes of the coordinates and in
#: relative tolerances, from which a constraint counts as one that jumps.
LEAP, LEAP_IN_TOLERANCES = 1e-3, 30.0
#: Points of an output interval by which a jump is distinguished from drift.
CLOSER_LOOK = 32


class PieceProjection:
    """Projection of integrated states onto the constraints, piece by piece.

    Parameters
    ----------
    only_requested : bool
        True if only the outputs that are kept, and the last state, are projected: no event is looked for.
    """

    def __init__(self, stepper: Stepper, *, only_requested: bool):
        self._stepper, self._only_requested = stepper, only_requested

    def states(
        self, piece: Piece, path: Path, outputs: Outputs, *, across: bool
    ) -> tuple[np.ndarray, IntegrationFailure | None]:
        """Return states of a piece on the constraints, up to the first that cannot be brought there, and the failure.

        Parameters
        ----------
        piece : Piece
            Times of the states.
        path : Path
            States of the integrator, from the start of the piece.
        across : bool
            True if the path leads across a singular pose.
        """
        times, x = path.times[1:], path.x[1:]
        if piece.ends_at_jump and times.size == piece.times.size:  # what is prescribed there belongs to the time after
            times = np.r_[times[:-1], piece.inside[1][-1]]
        rows = np.ones(times.size, bool)
        if self._only_requested:
            rows[:-1] = piece.requested[: times.size][:-1]
        for chosen in (rows, np.ones(times.size, bool)):
            if not times.size:
                break
            moved = outputs.projected(times[chosen], x[chosen])
            together = outputs.recovery.left_over <= PHI_TOLERANCE
            part = replace(piece, times=times[chosen])
            leap = self._leap(part, path.x[0], x[chosen], moved) if together and not across else None
            if together and leap is None:
                projected = x.copy()
                projected[chosen] = moved
                return projected, None
            if np.all(chosen):
                return leap if leap is not None else self._together(times, path.x[0], moved)
        return x, None

    def _together(
        self, times: np.ndarray, start: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, IntegrationFailure | None]:
        """Outputs up to the first one that cannot be brought onto the constraints, and the failure there."""
        numeric = self._stepper.numeric
        eom, n = numeric.eom, numeric.eom.q.numel()
        for k, time in enumerate(times):
            phi = np.abs(numeric.position(float(time), x[k, :n], x[k, 2 * n :])[0])
            if np.max(phi) > PHI_TOLERANCE:
                rows = [eom.row_names[eom.position_rows[r]] for r in np.argsort(-phi) if phi[r] > PHI_TOLERANCE]
                return _until(
                    k, times, start, x, f"the constraints {', '.join(rows[:6])} cannot be met together any more"
                )
        return x, None

    def _leap(
        self, piece: Piece, start: np.ndarray, integrated: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, IntegrationFailure] | None:
        """Outputs up to one to which only a jump of a constraint leads, and the failure there; None without a jump.

        A row that jumps with the coordinates (an angle by ``atan2``) has a derivative
        without the jump: the integrator passes by it, and the projection makes up for it at once. Jumps in time
        are known beforehand.
        """
        times = piece.times[: len(x) - 1 if piece.ends_at_jump else len(x)]
        x, integrated = x[: times.size], integrated[: times.size]
        numeric, n = self._stepper.numeric, self._stepper.numeric.eom.q.numel()
        correction = np.abs(np.diff((x - integrated)[:, :n] / numeric.column_scale, axis=0, prepend=0.0))
        limit = min(max(LEAP, LEAP_IN_TOLERANCES * self._stepper.integrator.reltol), 1.0)
        begins = np.append(piece.start, times)
        states = np.vstack([start, x])
        leaps = (
            int(k)
            for k in np.flatnonzero(correction.max(axis=1, initial=0.0) > limit)
            if self._jumps_within(begins[k : k + 2], states[k], limit)
        )
        k = next(leaps, -1)
        if k < 0:
            return None
        phi = np.abs(numeric.position(float(times[k]), integrated[k, :n], integrated[k, 2 * n :])[0])
        row = numeric.eom.row_names[numeric.eom.position_rows[int(np.argmax(phi))]]
        moved = int(np.argmax(correction[k]))
        message = (
            f"the constraints are not continuous: '{row}' jumps before t = {times[k]:.6g} s, where "
            f"{numeric.eom.coordinate_names[moved]} would have to leap by {(x - integrated)[k, moved]:.3g}"
        )
        return _until(k, times, start, x, message)

    def _jumps_within(self, interval: np.ndarray, x: np.ndarray, limit: float) -> bool:
        """True if the correction by projection jumps between two outputs; drift grows little by little instead."""
        n = self._stepper.numeric.eom.q.numel()
        times = np.linspace(interval[0], interval[1], CLOSER_LOOK + 1)[1:]
        try:
            integrated = self._stepper.unprojected(float(interval[0]), x, times)
        except IntegrationFailure:
            return True
        correction = self._stepper.outputs.projected(times, integrated) - integrated
        moved = correction[:, :n] / self._stepper.numeric.column_scale
        return bool(np.max(np.abs(np.diff(moved, axis=0, prepend=0.0))) > limit)


def _until(
    k: int, times: np.ndarray, start: np.ndarray, x: np.ndarray, message: str
) -> tuple[np.ndarray, IntegrationFailure]:
    """States before the one at an index, and the failure there."""
    last = x[k - 1] if k else start
    return x[:k], IntegrationFailure(message, x[:k], x[:k, :0], float(times[k - 1]) if k else None, last)
