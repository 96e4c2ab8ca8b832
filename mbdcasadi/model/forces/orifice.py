"""Flow of oil through orifices and valves."""

from __future__ import annotations

from typing import Any

from ..quantities import quantity
from ..symbols import Scalar


def orifice_flow(
    area: Scalar, drop: Scalar, transition: Scalar, density: Scalar = 860.0, discharge: Scalar = 0.62
) -> Any:
    """Return the flow through an orifice or a valve: ``Q = Cd A √(2/ρ) Δp / (Δp² + Δp_t²)^(1/4)``.

    For ``|Δp| >> Δp_t`` it is Bernoulli's ``±Cd A √(2 |Δp|/ρ)``, with a relative error of ``(Δp_t/Δp)²/4``; about zero
    it is laminar, of the slope ``Cd A √(2/(ρ Δp_t))``, and so has finite derivatives there.

    Parameters
    ----------
    area : float or expression
        A, m², at least 0; of a valve in inputs or states, of a check valve in the pressures.
    drop : float or expression
        Δp, the pressure before less that behind, Pa.
    transition : float or expression
        Δp_t, above 0, Pa; of the critical number Re of Reynolds, the viscosity ν and the diameter D,
        ``ρ/2 (Re ν/(Cd D))²``.
    density : float or expression, default 860
        ρ, kg/m³; 860 is that of mineral oil.
    discharge : float or expression, default 0.62
        Cd; 0.62 is that of a sharp edge.

    Returns
    -------
    float or casadi.SX
        Q, m³/s, with the sign of Δp.

    Raises
    ------
    ModelError
        For numbers out of their limits.

    References
    ----------
    Merritt, *Hydraulic Control Systems*, 1967, sections 3-2 and 3-4.

    Examples
    --------
    Oil of 20 bar that leaves by a hole of 2 mm²:

    >>> f"{orifice_flow(2e-6, 2e6, transition=1e3):.3e}"
    '8.457e-05'
    """
    what = "orifice_flow"
    area = quantity(area, what, "area", at_least=0.0)
    drop = quantity(drop, what, "drop")
    transition = quantity(transition, what, "transition", above=0.0)
    density = quantity(density, what, "density", above=0.0)
    discharge = quantity(discharge, what, "discharge", above=0.0)
    return discharge * area * (2 / density) ** 0.5 * drop / (drop**2 + transition**2) ** 0.25
