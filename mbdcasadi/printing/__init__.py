r"""Expressions as in a textbook: plain text and LaTeX.

CasADi prints the graph of an expression, with ``sq(x)``, a pair of parentheses
for each operation, and names ``@1`` for shared parts. Here these are
written out, sums and products are flat with like terms and repeated factors
collected, parentheses are set if precedence asks for them, and LaTeX knows
the coordinates of bodies: ``crank.vx`` is ``\dot{x}_{\mathrm{crank}}``.
"""

from .latex import to_latex
from .matrices import matrix_to_latex, matrix_to_text
from .text import LIMIT, to_text

__all__ = ["LIMIT", "matrix_to_latex", "matrix_to_text", "to_latex", "to_text"]
