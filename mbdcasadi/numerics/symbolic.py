"""Operations on expressions that CasADi does not do safely in several threads at the same time.

References to its nodes are counted safely, and so are functions made, called and differentiated. Measured with
eight threads on CasADi 3.8.2: only ``substitute`` and ``simplify`` corrupt memory.
"""

from __future__ import annotations

import threading
from typing import Any

import casadi as ca

_LOCK = threading.Lock()


def substitute(expressions: Any, symbols: Any, values: Any) -> Any:
    """Return expressions with values for symbols, as ``casadi.substitute`` does."""
    with _LOCK:
        return ca.substitute(expressions, symbols, values)


def simplify(expression: ca.SX) -> ca.SX:
    """Return a simpler form of an expression, as ``casadi.simplify`` does."""
    with _LOCK:
        return ca.simplify(expression)
