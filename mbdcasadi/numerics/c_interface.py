"""Functions around one in C by which CasADi's ``external`` and other programs find its arguments."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import casadi as ca

#: Parameters of the functions that return lengths of the four arrays of a call.
LENGTHS = "long long int* arg, long long int* res, long long int* iw, long long int* w"


def interface(
    name: str,
    inputs: Mapping[str, ca.Sparsity | tuple[int, int]],
    outputs: Mapping[str, ca.Sparsity | tuple[int, int]],
    work: int,
) -> dict[str, str]:
    """Return declarations with their bodies: sizes, names and sparsities, in CasADi's convention.

    Parameters
    ----------
    name : str
        The function.
    inputs, outputs : mapping of str to casadi.Sparsity or shape
        Arguments and results, in order; those of a shape are dense.
    work : int
        Length of ``w``.
    """
    lengths = {"arg": len(inputs), "res": len(outputs), "iw": 0, "w": work}
    types = {"arg": "const double*", "res": "double*", "iw": "long long int", "w": "double"}
    functions = {
        f"int {name}_checkout(void)": "return 0;",
        f"void {name}_release(int mem)": "(void)mem;",
        f"void {name}_incref(void)": "",
        f"void {name}_decref(void)": "",
        f"double {name}_default_in(long long int i)": "(void)i; return 0;",
        f"int {name}_work({LENGTHS})": _filled(lengths),
        f"int {name}_work_bytes({LENGTHS})": _filled({x: f"{n} * sizeof({types[x]})" for x, n in lengths.items()}),
    }
    for side, patterns in (("in", inputs), ("out", outputs)):
        functions |= {
            f"long long int {name}_n_{side}(void)": f"return {len(patterns)};",
            f"const char* {name}_name_{side}(long long int i)": _chosen("char* const", [f'"{x}"' for x in patterns]),
            f"const long long int* {name}_sparsity_{side}(long long int i)": _sparsities([*patterns.values()]),
        }
    return functions


def definitions(declared: Mapping[str, str]) -> str:
    """Return the code of declarations with their bodies."""
    return "".join(f"{declaration} {{ {body} }}\n" for declaration, body in declared.items())


def constant_table(kind: str, name: str, entries: Iterable[object]) -> str:
    """Return a constant table in C, which knows none without entries."""
    return f"static const {kind} {name}[] = {{{', '.join(map(str, entries)) or '0'}}};"


def _filled(values: Mapping[str, object]) -> str:
    return " ".join(f"if ({name}) *{name} = {value};" for name, value in values.items()) + " return 0;"


def _chosen(kind: str, entries: Sequence[str]) -> str:
    """Body of a function that returns one of some entries."""
    return constant_table(kind, "entries", entries) + f" return i >= 0 && i < {len(entries)} ? entries[i] : 0;"


def _sparsities(patterns: Sequence[ca.Sparsity | tuple[int, int]]) -> str:
    """Body of a function that returns a pattern: rows and columns, and 1 if it is dense, else its entries by column."""
    names = [f"pattern_{k}" for k in range(len(patterns))]
    compressed = [[*p, 1] if isinstance(p, tuple) else p.compress() for p in patterns]
    tables = (constant_table("long long int", *named) for named in zip(names, compressed, strict=True))
    return " ".join([*tables, _chosen("long long int* const", names)])
