"""Methods of integration: one strategy a file, and the list of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..errors import SimulationError
from .base import Integrator
from .bdf import BDF
from .dop853 import DOP853
from .idas import IDAS
from .rosenbrock import Rosenbrock
from .runge_kutta import RungeKutta

__all__ = ["BDF", "DOP853", "IDAS", "INTEGRATORS", "Integrator", "Rosenbrock", "RungeKutta", "as_integrator"]

#: Every method that ``method=`` takes by its name.
INTEGRATORS: tuple[type[Integrator], ...] = (IDAS, RungeKutta, Rosenbrock, DOP853, BDF)


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
    method : str or Integrator
        A name of :data:`INTEGRATORS`, or an integrator, which carries its own settings.
    reltol, abstol, jit, options
        Settings of one that is given by name.
    besides : tuple of str
        Further names to list in the message of an error.

    Raises
    ------
    SimulationError
        For a name that is not in the list, and for settings beside an object.
    """
    settings: dict[str, Any] = {"reltol": reltol, "abstol": abstol, "jit": jit or None, "options": options}
    settings = {name: value for name, value in settings.items() if value is not None}
    if isinstance(method, Integrator):
        if settings:
            raise SimulationError(
                f"{', '.join(f'{name}=' for name in settings)} stands beside method={method!r}, which carries its own "
                "settings; give them there"
            )
        return method
    for kind in INTEGRATORS:
        if isinstance(method, str) and method == kind.name:
            return kind(**settings)
    names = ", ".join((*(kind.name for kind in INTEGRATORS), *besides))
    raise SimulationError(f"method must be one of {names}, or an integrator such as IDAS(), got {method!r}")
