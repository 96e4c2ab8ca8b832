"""Accelerations and multipliers in C if forces depend on reactions: Newton's method around two functions."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..numerics.c_code import SIGNATURE, Tape
from ..numerics.tolerances import ACCURACY, CONVERGED
from .derivation import Equations
from .dynamics import dynamics_saddle, term_sizes

#: Steps of Newton's method, at most; those after which a change that does not shrink below rounding is accepted.
STEPS, MANY = 60, 8


def newton_step(eom: Equations, name: str, augmentation: np.ndarray | None) -> ca.Function:
    """Return ``(t, q, v, z, u, p, [a; lam]) -> ([a; lam], left over)``: one step of Newton's method.

    What the unknowns before the step leave over of the equations is relative to the size of their terms.
    """
    residual, n = eom.residual(), eom.q.numel()
    left_over = ca.mmax(ca.densify(ca.fabs(residual) / term_sizes(eom)))
    unknown = ca.vertcat(eom.a, eom.lam)
    saddle = dynamics_saddle(eom, augmentation, under_reactions=True)
    stepped = ca.densify(unknown - ca.vertcat(*saddle.solve(residual[:n, :], residual[n:, :])))
    known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    return ca.Function(name, [*known, unknown], [stepped, left_over])


@dataclass(frozen=True)
class NewtonLoop:
    """A function ``(t, q, v, z, u, p) -> results`` in C that first solves for ``(a, lam)``.

    It returns 1, and results of unknowns that are NaN, if the method does not converge.

    Attributes
    ----------
    name : str
        The function.
    step : Tape
        ``(t, q, v, z, u, p, [a; lam]) -> ([a; lam], left over)``, see :func:`newton_step`.
    results : Tape
        ``(t, q, v, z, u, p, [a; lam]) -> results``.
    """

    name: str
    step: Tape
    results: Tape

    @property
    def _unknowns(self) -> int:
        return int(self.step.function.numel_out(0))

    @property
    def arguments(self) -> tuple[dict[str, tuple[int, int]], dict[str, tuple[int, int]]]:
        """Shapes of the arguments and results by name, in order."""
        inputs, outputs = self.results.arguments
        return dict(list(inputs.items())[:-1]), outputs

    @property
    def work_in_c(self) -> int:
        """Length of ``w`` that the function in C needs."""
        return 2 * self._unknowns + max(self.step.work_in_c, self.results.work_in_c)

    @property
    def as_c(self) -> str:
        """Definition of the function in C, which calls those of both tapes."""
        return f"""int {self.name}({SIGNATURE}) {{
  double *found = w, *next = w + {self._unknowns}, *work = next + {self._unknowns};
  const double* known[] = {{arg[0], arg[1], arg[2], arg[3], arg[4], arg[5], found}};
  double off = 0.0;
  double* given[] = {{next, &off}};
  int solved = 0, i, k;
  for (i = 0; i < {self._unknowns}; ++i) found[i] = 0.0;
  for (k = 0; k < {STEPS} && !solved; ++k) {{
    double change = 0.0, size = 1.0;
    {self.step.name}(known, given, iw, work, mem);
    for (i = 0; i < {self._unknowns}; ++i) {{
      const double moved = fabs(next[i] - found[i]);
      if (moved > change || moved != moved) change = moved;
      size = fmax(size, fabs(next[i]));
      found[i] = next[i];
    }}
    solved = off <= {CONVERGED} && (change <= {ACCURACY} * size || (k > {MANY} && change <= {CONVERGED} * size));
  }}
  for (i = 0; i < {self._unknowns} && !solved; ++i) found[i] = NAN;
  {self.results.name}(known, res, iw, work, mem);
  return !solved;
}}
"""
