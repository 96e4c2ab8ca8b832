"""Ranges of quantities of the model that vary along a motion: capacities, coefficients of friction, loads, lengths."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..equations import Equations
from ..model.mechanism import Mechanism
from ..numerics.tolerances import MET


class Ranges:
    """Checks of limited quantities that depend on time, inputs or states.

    Parameters
    ----------
    eom : Equations
        Equations, perhaps in one mode.
    p : numpy.ndarray
        Values of the parameters.
    mechanism : Mechanism
        The whole, whose quantities are looked at.

    Attributes
    ----------
    limits : list of Limit
        Those whose symbols the equations have.
    """

    def __init__(self, eom: Equations, p: np.ndarray, mechanism: Mechanism):
        self._eom, self._p = eom, p
        self.limits = [x for x in mechanism.varying_limits if eom.contains(x.expression)]

    def first_broken(self, block: tuple[np.ndarray, ...]) -> tuple[int, str] | None:
        """Index and message of the first of some outputs at which a quantity is out of its range, or has no value.

        Parameters
        ----------
        block : tuple of numpy.ndarray
            ``t, q, v, a, z, lam, u`` by row.
        """
        if not self.limits:
            return None
        t, *others = block
        function = self._eom.function(ca.vertcat(*[x.expression for x in self.limits]))
        values = function(t[None, :], *[x.T for x in others], self._p[:, None]).full()
        return self.first_among(np.broadcast_to(values, (len(values), t.size)))

    def first_among(self, values: np.ndarray) -> tuple[int, str] | None:
        """The same of values of the quantities of :attr:`limits`, by row (n, k)."""
        slack = MET * (1 + np.max(np.abs(values), axis=1, initial=0.0, where=np.isfinite(values)))
        found = []
        for limit, course, rounding in zip(self.limits, values, slack, strict=True):
            low = -np.inf if limit.at_least is None else limit.at_least - rounding
            bad = ~(np.isfinite(course) & (course >= low))
            if limit.above is not None:
                bad |= ~(course > limit.above)
            if np.any(bad):
                k = int(np.argmax(bad))
                found.append((k, limit.objection(float(course[k]))))
        return min(found, default=None)
