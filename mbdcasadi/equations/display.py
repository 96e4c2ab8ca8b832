"""Equations of motion printed as in the textbook."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..printing import matrix_to_latex, matrix_to_text, to_latex, to_text
from .derivation import Equations

#: Larger systems are printed by their sizes and the constraint rows alone.
LARGEST_MATRIX = 30


def equations_as_text(eom: Equations) -> str:
    """Equations in plain text: the general form, then each term by rows."""
    n, m, velocity_level = eom.q.numel(), eom.lam.numel(), eom.velocity_rows.numel()
    of_these = f", {velocity_level} of them at velocity level" if velocity_level else ""
    constrained = [
        "Constrained equations of motion",
        f"  M a + Phi_q^T lam = Q        n = {n} coordinates",
        f"  Phi(q, t) = 0                m = {m} constraint rows{of_these}",
        "  Phi_q v = nu",
        "  Phi_q a = gamma",
    ]
    free = ["Equations of motion, without constraints", f"  M a = Q        n = {n} coordinates"]
    lines = [*(constrained if m else free), "", "q = [" + ", ".join(eom.coordinate_names) + "]"]
    masses = [to_text(eom.mass_diagonal[k]) for k in range(n)]
    lines += ["M = diag(" + ", ".join(masses) + ")", "", "Q"]
    lines += _rows(eom.coordinate_names, [eom.Q[k] for k in range(n)])
    if m:
        lines += _constraints_as_text(eom)
    if eom.z.numel():
        names = [z.label for z in eom.mechanism.states]
        lines += ["", "rates of first-order states", *_rows(names, [eom.z_rate[k] for k in range(len(names))])]
    return "\n".join(lines)


def _constraints_as_text(eom: Equations) -> list[str]:
    """Rows, Jacobian and right sides."""
    n, m = eom.q.numel(), eom.lam.numel()
    lines = []
    if eom.position_names:
        lines += ["", "Phi", *_rows(eom.position_names, ca.vertsplit(eom.Phi))]
    if eom.velocity_rows.numel():
        names = np.delete(eom.row_names, eom.position_rows).tolist()
        lines += ["", "velocity-level rows, zero", *_rows(names, ca.vertsplit(eom.velocity_rows))]
    if n <= LARGEST_MATRIX:
        lines += ["", "Phi_q", matrix_to_text(eom.Phi_q, list(eom.row_names), list(eom.coordinate_names))]
    lines += ["", "nu", *_rows(eom.row_names, [eom.nu[k] for k in range(m)])]
    return [*lines, "", "gamma", *_rows(eom.row_names, [eom.gamma[k] for k in range(m)])]


def _rows(names, entries) -> list[str]:
    width = max((len(name) for name in names), default=0)
    return [f"  {name:<{width}}  {to_text(entry)}" for name, entry in zip(names, entries, strict=True)]


def equations_as_latex(eom: Equations) -> str:
    """Equations in LaTeX for a notebook."""
    if not eom.lam.numel():
        return "\n".join(f"$${part}$$" for part in [r"\mathbf{M}\,\mathbf{a} = \mathbf{Q}", *_forces_as_latex(eom)])
    general = (
        r"\mathbf{M}\,\mathbf{a} + \boldsymbol{\Phi}_q^T \boldsymbol{\lambda} = \mathbf{Q}, \quad "
        r"\boldsymbol{\Phi} = \mathbf{0}, \quad \boldsymbol{\Phi}_q \mathbf{v} = \boldsymbol{\nu}, \quad "
        r"\boldsymbol{\Phi}_q \mathbf{a} = \boldsymbol{\gamma}"
    )
    parts = [
        general,
        *_forces_as_latex(eom),
        r"\boldsymbol{\Phi} = " + matrix_to_latex(eom.Phi),
        *([matrix_to_latex(eom.velocity_rows) + r" = \mathbf{0}"] if eom.velocity_rows.numel() else []),
        r"\boldsymbol{\Phi}_q = " + matrix_to_latex(eom.Phi_q),
        r"\boldsymbol{\nu} = " + matrix_to_latex(eom.nu),
        r"\boldsymbol{\gamma} = " + matrix_to_latex(eom.gamma),
    ]
    return "\n".join(f"$${part}$$" for part in parts)


def _forces_as_latex(eom: Equations) -> list[str]:
    """Coordinates, masses and applied forces."""
    masses = ", ".join(to_latex(x) for x in eom.mass_diagonal.elements())
    return [
        r"\mathbf{q} = " + matrix_to_latex(eom.q),
        r"\mathbf{M} = \mathrm{diag}\left(" + masses + r"\right)",
        r"\mathbf{Q} = " + matrix_to_latex(eom.Q),
    ]
