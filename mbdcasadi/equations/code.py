"""The equations of motion as C code, for real-time targets and other simulators."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import casadi as ca

from ..errors import FileError, ModelError
from ..numerics.writing import whole_file
from .numeric import NumericEquations
from .saddle import forward_dynamics

if TYPE_CHECKING:
    from .derivation import Equations

#: Last lines of both files that CasADi writes.
_END = '#ifdef __cplusplus\n} /* extern "C" */\n#endif\n'
_NAMES = ["t", "q", "v", "a", "z", "lam", "u", "p"]


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
    generator = ca.CodeGenerator(target.name, {"with_header": True})
    for function in _functions(eom, stem):
        generator.add(function)
    header = target.with_suffix(".h")
    with whole_file(target) as source_part, whole_file(header) as header_part:
        source_text, header_text = _generated(generator, target)
        source_part.write_text(source_text, encoding="utf-8")
        header_part.write_text(header_text, encoding="utf-8")
    return target, header


def _generated(generator: ca.CodeGenerator, target: Path) -> tuple[str, str]:
    """Return source and header.

    CasADi writes them to files itself and reports no failure, so it is
    checked that neither was cut off by a full disk.
    """
    with tempfile.TemporaryDirectory(dir=target.resolve().parent, prefix=f".{target.stem}.") as folder:
        generator.generate(folder + "/")
        source, header = (
            (Path(folder) / target.with_suffix(ending).name).read_text(encoding="utf-8") for ending in (".c", ".h")
        )
    if generator.dump() not in source or not (source.endswith(_END) and header.endswith(_END)):
        raise FileError(f"{target}: the file cannot be written: the code was cut off, as by a full disk")
    return source, header


def _functions(eom: Equations, stem: str) -> list[ca.Function]:
    residual = ca.densify(
        ca.vertcat(
            eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q,
            eom.Phi,
            eom.Phi_q @ eom.v - eom.nu,
            eom.Phi_q @ eom.a - eom.gamma,
        )
    )
    unknown = dict(zip(_NAMES[1:6], eom.symbols[1:6], strict=True))
    slopes = [ca.densify(ca.jacobian(residual, symbol)) for symbol in unknown.values()]
    whole = list(eom.symbols)
    arguments, known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p], ["t", "q", "v", "z", "u", "p"]
    functions = [
        ca.Function(f"{stem}_mass_matrix", [eom.p], [ca.densify(eom.M)], ["p"], ["M"]),
        ca.Function(
            f"{stem}_constraints",
            [eom.t, eom.q, eom.p],
            [ca.densify(eom.Phi), ca.densify(eom.Phi_q), ca.densify(eom.nu)],
            ["t", "q", "p"],
            ["Phi", "Phi_q", "nu"],
        ),
        ca.Function(f"{stem}_residual", whole, [residual], _NAMES, ["r"]),
        ca.Function(f"{stem}_jacobians", whole, slopes, _NAMES, [f"r_{name}" for name in unknown]),
        ca.Function(f"{stem}_state_rates", whole, [ca.densify(eom.z_rate)], _NAMES, ["z_rate"]),
    ]
    forward = _forward(eom, f"{stem}_forward_dynamics")
    closed = forward.is_a("SXFunction")
    symbols = [(ca.SX if closed else ca.MX).sym(name, *s.shape) for name, s in zip(known, arguments, strict=True)]
    t, q, v, z, u, p = symbols
    a, lam = forward(*symbols)
    rates = ca.Function("z_rate", whole, [eom.z_rate])(t, q, v, a, z, lam, u, p)
    right = ca.Function(f"{stem}_right_side", symbols, [ca.densify(ca.vertcat(v, a, rates))], known, ["rate"])
    return [*functions, forward, right]


def _forward(eom: Equations, name: str) -> ca.Function:
    """Forward dynamics in the form that this mechanism needs, with solvers that can be written as C."""
    numeric = NumericEquations(eom, eom.parameter_values)
    redundant = numeric.has_redundant_rows(0.0, eom.estimate[0])
    function = forward_dynamics(eom, augmentation=numeric.augmentation, redundant=redundant, portable=True)
    symbols = function.sx_in() if function.is_a("SXFunction") else function.mx_in()
    results = [ca.densify(result) for result in function(*symbols)]
    return ca.Function(name, symbols, results, function.name_in(), function.name_out())
