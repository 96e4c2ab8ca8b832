"""Methods of integration: one strategy a file, and the list of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

from ..errors import SimulationError
from .base import ABSTOL, RELTOL, Integrator, required_compiler
from .bdf import BDF
from .dop853 import DOP853
from .idas import IDAS
from .rosenbrock import Rosenbrock
from .runge_kutta import RungeKutta

__all__ = ["BDF", "DOP853", "IDAS", "INTEGRATORS", "Integrator", "Rosenbrock", "RungeKutta", "as_integrator"]

#: Every method that ``method=`` takes by its name.
INTEGRATORS: tuple[type[Integrator], ...] = (IDAS, RungeKutta, Rosenbrock, DOP853, BDF)
_BY_NAME = {kind.name: kind for kind in INTEGRATORS}


def as_integrator(
    method: Any,
    reltol: float | None = None,
    abstol: float | None = None,
    *,
    jit: bool = False,
    options: Mapping[str, Any] | None = None,
    besides: tuple[str, ...] = (),
) -> Integrator:
    """Return the integrator that ``method=`` names, with its tolerances, or the object that it is.

    Parameters
    ----------
    method : str, Integrator or a class of these
        A name of :data:`INTEGRATORS`, a class, or an integrator, which carries its own settings.
    reltol, abstol, jit, options
        Settings of one that is given by name or class.
    besides : tuple of str
        Further names to list in the message of an error.

    Raises
    ------
    SimulationError
        For a name that is not in the list, and for settings beside an object.
    """
    if isinstance(method, Integrator):
        offered: dict[str, Any] = {"reltol": reltol, "abstol": abstol, "jit": jit or None, "options": options}
        settings = {name: value for name, value in offered.items() if value is not None}
        if settings:
            raise SimulationError(
                f"{', '.join(f'{name}=' for name in settings)} stands beside method={method!r}, which carries its own "
                "settings; give them there"
            )
        return method
    given = isinstance(method, type) and issubclass(method, Integrator)
    kind: type[Integrator] | None = method if given else _BY_NAME.get(method) if isinstance(method, str) else None
    if kind is None:
        names = ", ".join((*_BY_NAME, *besides))
        raise SimulationError(f"method must be one of {names}, or an integrator such as IDAS(), got {method!r}")
    tolerances = (RELTOL if reltol is None else reltol, ABSTOL if abstol is None else abstol)
    if options is not None or type(jit) is not bool or any(type(tolerance) is not float for tolerance in tolerances):
        return kind(*tolerances, jit=jit, options=options)
    if jit:
        required_compiler()
    return _with_tolerances(kind, *tolerances, jit)


@lru_cache
def _with_tolerances(kind: type[Integrator], reltol: float, abstol: float, jit: bool) -> Integrator:
    return kind(reltol, abstol, jit=jit)
