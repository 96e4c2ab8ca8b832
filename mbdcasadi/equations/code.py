"""The equations of motion as C code, for real-time targets and other simulators."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import casadi as ca

from ..errors import ModelError
from ..numerics.c_code import SIGNATURE, Tape, UnsupportedOperation, simplified, tape_of
from ..numerics.c_interface import definitions, interface
from ..numerics.writing import whole_file
from .derivation import Equations
from .newton_code import NewtonLoop, newton_step
from .numeric import NumericEquations

#: Frame of both files: C++ must not change the names, and ``casadi_real`` is the name CasADi's files have for double.
_FRAME = """/* Equations of motion in the calling convention of CasADi; matrices are stored by columns. */
{before}#ifdef __cplusplus
extern "C" {{
#endif

#ifndef casadi_real
#define casadi_real double
#endif

#ifndef casadi_int
#define casadi_int long long int
#endif

{content}
#ifdef __cplusplus
}} /* extern "C" */
#endif
"""
_SHOWN = """#include <math.h>

#ifdef _WIN32
#define SHOWN __declspec(dllexport)
#else
#define SHOWN
#endif

"""
#: Arguments of the residual, and those of the explicit functions.
_NAMES, _KNOWN = ["t", "q", "v", "a", "z", "lam", "u", "p"], ["t", "q", "v", "z", "u", "p"]


def generate_c(eom: Equations, path: str | Path) -> tuple[Path, Path]:
    """Write the equations of motion as one C file with its header; see :meth:`Equations.generate_c`."""
    if not isinstance(path, str | Path):
        raise ModelError(f"generate_c: takes the path of a file such as engine.c, got {path!r}")
    target = Path(path)
    stem = target.stem
    if target.suffix != ".c" or not re.fullmatch(r"[A-Za-z]\w*", stem):
        raise ModelError(
            f"generate_c: the file must be named as a C identifier that ends in .c, such as engine.c, got {str(path)!r}"
        )
    if not target.resolve().parent.is_dir():
        raise ModelError(f"generate_c: there is no folder {str(target.resolve().parent)!r}")
    numeric = NumericEquations(eom, eom.parameter_values)
    if (redundant := numeric.has_redundant_rows(0.0, eom.estimate[0])) and eom.Q_depends_on_lam:
        raise ModelError(f"generate_c: {eom.why_not_unique}")
    try:
        functions = [*_implicit(eom, stem), *_explicit(numeric, stem, redundant=redundant)]
    except UnsupportedOperation as error:
        raise ModelError(
            f"generate_c: the model contains the operation '{error.operation}', which has no C code"
        ) from None
    header = target.with_suffix(".h")
    source_text, header_text = _files(functions)
    with whole_file(target) as source_part:
        source_part.write_text(source_text, encoding="utf-8")
        with whole_file(header) as header_part:
            header_part.write_text(header_text, encoding="utf-8")
    return target, header


# --- the functions ----------------------------------------------------------------------------
def _tape(name: str, arguments: Mapping[str, ca.SX], results: Mapping[str, ca.SX]) -> Tape:
    function = ca.Function(name, list(arguments.values()), list(results.values()), list(arguments), list(results))
    return tape_of(simplified(function, densify=False))


def _implicit(eom: Equations, stem: str) -> list[Tape]:
    """Functions whose arguments are accelerations and multipliers, or neither depends on nor returns them."""
    residual = ca.vertcat(
        eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q,
        eom.Phi,
        eom.Phi_q @ eom.v - eom.nu,
        eom.Phi_q @ eom.a - eom.gamma,
    )
    changes = ca.depends_on(eom.mass_diagonal, eom.z)
    whole = dict(zip(_NAMES, eom.symbols, strict=True))
    slopes = {f"r_{name}": ca.jacobian(residual, whole[name]) for name in _NAMES[1:6]}
    return [
        _tape(f"{stem}_mass_matrix", {"z": eom.z, "p": eom.p} if changes else {"p": eom.p}, {"M": eom.M}),
        _tape(
            f"{stem}_constraints",
            {"t": eom.t, "q": eom.q, **({"z": eom.z} if eom.follows_states else {}), "p": eom.p},
            {"Phi": eom.Phi, "Phi_q": eom.Phi_q, "nu": eom.nu},
        ),
        _tape(f"{stem}_residual", whole, {"r": residual}),
        _tape(f"{stem}_jacobians", whole, slopes),
        _tape(f"{stem}_state_rates", whole, {"z_rate": eom.z_rate}),
    ]


def _explicit(numeric: NumericEquations, stem: str, *, redundant: bool) -> list[Tape | NewtonLoop]:
    """Forward dynamics and right side, in the form that this mechanism needs."""
    eom = numeric.eom
    known = {name: symbol for name, symbol in zip(_NAMES, eom.symbols, strict=True) if name in _KNOWN}
    unknown = ca.vertcat(eom.a, eom.lam)
    results = {
        f"{stem}_forward_dynamics": {"a": eom.a, "lam": eom.lam},
        f"{stem}_right_side": {"rate": ca.vertcat(eom.v, eom.a, eom.z_rate)},
    }
    if eom.Q_depends_on_lam:
        step = tape_of(simplified(newton_step(eom, f"{stem}_newton_step", numeric.augmentation)))
        arguments = known | {"unknown": unknown}
        return [NewtonLoop(name, step, _tape(f"{name}_results", arguments, of)) for name, of in results.items()]
    solution = ca.vertcat(*numeric.forward_dynamics(redundant=redundant)(*known.values()))
    return [
        _tape(name, known, dict(zip(of, ca.substitute([*of.values()], [unknown], [solution]), strict=True)))
        for name, of in results.items()
    ]


# --- the files ----------------------------------------------------------------------------------
def _files(functions: Sequence[Tape | NewtonLoop]) -> tuple[str, str]:
    """Return source and header."""
    bodies: dict[str, str] = {}
    declared: dict[str, str] = {}
    lengths = ""
    for function in functions:
        name, called = function.name, [function.step, function.results] if isinstance(function, NewtonLoop) else []
        bodies |= {code.name: code.as_c for code in (*called, function)}
        inputs, outputs = function.arguments
        declared |= {f"int {name}({SIGNATURE})": ""} | interface(name, inputs, outputs, function.work_in_c)
        sizes = {"ARG": len(inputs), "RES": len(outputs), "IW": 0, "W": function.work_in_c}
        lengths += "".join(f"#define {name}_SZ_{array} {size}\n" for array, size in sizes.items())
    around = {declaration: body for declaration, body in declared.items() if SIGNATURE not in declaration}
    shown = "".join(f"SHOWN {declaration};\n" for declaration in declared)
    content = "\n".join([shown, *bodies.values(), definitions(around)])
    prototypes = "".join(f"{declaration};\n" for declaration in declared)
    return _FRAME.format(before=_SHOWN, content=content), _FRAME.format(before="", content=prototypes + lengths)
