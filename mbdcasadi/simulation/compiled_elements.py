"""Forces of many elements of one kind, and what is watched of them, as C: one formula for all, called for near ones.

In the equations as expressions every contact is there with all its
instructions, evaluated whether it is closed or not. Compiled, a loop goes over the
elements of a kind. It passes over those that are apart by a cheap test, and the
code is as long as one of them.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..equations.batches import Batch, Values
from ..integrators.dop853 import build
from ..numerics.c_code import SIGNATURE, Tape, UnsupportedOperation, simplified, tape_of
from .watched_terms import APART, DISPLACEMENTS, FORCES, WatchedTerms

#: Instructions of all elements, a call of their forces and one of their rates, from which compiling them pays in most
#: runs: the interpreter takes some 0.1 ms for these, and the compiler a second.
LEAST_INSTRUCTIONS = 8_000
#: Optimisation: that of other equations.
OPTIMISATION = "-O1"
#: Changes whenever what is written changes.
FORMAT = "1"


@dataclass(frozen=True, eq=False)
class CompiledElements:
    """Functions of a library.

    Attributes
    ----------
    values : Values
        The column that the functions take.
    forces : casadi.Function
        Generalised forces (n,) of the compiled elements from a column of values, with its Jacobian.
    rates : casadi.Function
        Rates that are integrated along (size,), from the same column.
    rest : casadi.Function
        ``(t, q, v, z, lam, u, p) -> Q``: generalised forces of the other elements.
    """

    values: Values
    forces: ca.Function
    rates: ca.Function
    rest: ca.Function


def compiled_elements(terms: WatchedTerms) -> tuple[CompiledElements | None, str]:
    """Return the compiled elements of a mechanism, or None, and a remark; made once for it.

    Compiled are elements that are many of a kind; the remark is empty if there are not so many that it pays.
    """
    return terms.eom.mechanism.cache.get_or_create("compiled elements", lambda: _compiled(terms))


def _compiled(terms: WatchedTerms) -> tuple[CompiledElements | None, str]:
    try:
        kinds = [_Kind(terms, number) for number in range(len(terms.batches))]
    except UnsupportedOperation:
        return None, ""
    if sum(kind.expanded_size for kind in kinds) < LEAST_INSTRUCTIONS:
        return None, ""
    using = build.compiler()
    if using is None:
        return None, "no C compiler was found: with so many contacts a compiled run is some ten times faster"
    source = _source(terms, kinds)
    key = build.key_of(FORMAT, using.identity, OPTIMISATION, *build.FLAGS, source)
    began, library = time.perf_counter(), build.find(key)
    remark = "compiled contacts, kept from before"
    if library is None:
        try:
            library = build.build(key, source, OPTIMISATION, using)
        except build.CompilationError as error:
            return None, f"interpreted contacts: {error}"
        remark = f"contacts compiled by {using.name} in {time.perf_counter() - began:.2g} s"
    forces, rates = (ca.external(name, library._name) for name in ("forces", "rates"))
    own = {int(number) for kind in kinds if kind.has_forces for number in kind.batch.numbers}
    return CompiledElements(terms.values, forces, rates, _rest(terms, own)), remark


def _rest(terms: WatchedTerms, compiled: set[int]) -> ca.Function:
    """Generalised forces of elements that are not compiled."""
    eom = terms.eom
    watched = [terms.elements[number] for number in compiled]
    others = [e for e in eom.mechanism.elements if not any(e is own for own in watched)]
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.u, eom.p]
    return ca.Function("rest_of_forces", arguments, [ca.densify(eom.generalised_forces(others))])


class _Kind:
    """Elements of a batch in C."""

    def __init__(self, terms: WatchedTerms, number: int):
        self.number, self.batch = number, terms.batches[number]
        batch = self.batch
        self.rates = _tape(batch, f"rates_{number}", terms.rates_of(number).call(_arguments(batch))[0])
        self.result_places = terms.rate_places[number]
        self.apart = None
        if batch.parts[APART].numel():
            self.apart = _tape(batch, f"apart_{number}", batch.parts[APART])
        work = ca.vertcat(batch.parts[DISPLACEMENTS], batch.parts[FORCES])
        free = batch.of_groups("a", "lam")
        self.has_forces = not (free and ca.depends_on(work, batch.symbols[free]))
        own = batch.of_groups("q")
        coordinates = batch.symbols[own]
        force = ca.jtimes(batch.parts[DISPLACEMENTS], coordinates, batch.parts[FORCES], True) if own else ca.SX(0, 1)
        self.coordinates = terms.values.coordinate(batch.places[:, own])
        self.forces = _tape(batch, f"forces_{number}", force)
        self._force = force
        self.slopes: ca.SX = ca.jacobian(ca.densify(force), batch.symbols)

    @property
    def expanded_size(self) -> int:
        """Instructions of all its elements."""
        return len(self.batch.places) * (self.rates.size + self.forces.size * self.has_forces)

    def slopes_tape(self) -> Tape:
        """Nonzero slopes of the forces by the symbols."""
        return _tape(self.batch, f"slopes_{self.number}", self.slopes.nz[:])

    def slope_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Coordinates and places of the symbols of the nonzero slopes (n, nnz)."""
        rows, columns = (np.array(part, int) for part in self.slopes.sparsity().get_triplet())
        return self.coordinates[:, rows], self.batch.places[:, columns]


def _arguments(batch: Batch) -> list[ca.SX]:
    return [batch.symbols, batch.rates, batch.parameters]


def _tape(batch: Batch, name: str, expression: ca.SX) -> Tape:
    return tape_of(simplified(ca.Function(name, _arguments(batch), [ca.densify(expression)])))


# --- C ---------------------------------------------------------------------------------------
@dataclass
class _Loops:
    """Loops over the elements of kinds that add to one result."""

    body: list[str] = field(default_factory=list)
    work: int = 0

    def add(self, kind: _Kind, tape: Tape, rows: np.ndarray, table: str, *, rates: bool = False) -> None:
        """Add a loop that evaluates a tape for each element, and adds its results to entries of the result.

        Parameters
        ----------
        rows : numpy.ndarray
            Entries of the result (n, rows).
        table : str
            Name of the table in C with these.
        """
        n, symbols = kind.batch.places.shape
        k = kind.number
        self.work = max(self.work, tape.work_in_c, 0 if kind.apart is None else kind.apart.work_in_c)
        lines = [f"for (int e = 0; e < {n}; ++e) {{", _gathered("s", f"places_{k}", symbols)]
        taken = "s, 0, "
        if rates:
            lines.append(_gathered("r", f"rate_places_{k}", symbols))
            taken = "s, r, "
        lines.append(f"const double* in[] = {{{taken}constants_{k} + e * {kind.batch.constants.shape[1]}}};")
        if kind.apart is not None:
            lines += [
                "double apart;",
                "double* test[] = {&apart};",
                f"apart_{k}(in, test, iw, w, mem);",
                "if (apart > 0) continue;",
            ]
        lines += [
            f"double y[{max(rows.shape[1], 1)}];",
            "double* out[] = {y};",
            f"{tape.function.name()}(in, out, iw, w, mem);",
            f"for (int i = 0; i < {rows.shape[1]}; ++i) result[{table}[e * {rows.shape[1]} + i]] += y[i];",
            "}",
        ]
        self.body += lines

    def function(self, name: str, size: int) -> str:
        """Text of a function whose result is what the loops add up to."""
        head = f"int {name}({SIGNATURE}) {{\nconst double* values = arg[0];\n"
        head += "double* result = res[0];\nif (!result) return 0;\n"
        head += f"for (int i = 0; i < {size}; ++i) result[i] = 0;\n"
        return head + "\n".join(self.body) + "\nreturn 0;\n}\n"


def _gathered(name: str, places: str, count: int) -> str:
    return (
        f"double {name}[{max(count, 1)}];\n"
        f"for (int i = 0; i < {count}; ++i) {name}[i] = values[{places}[e * {count} + i]];"
    )


def _table(kind: str, name: str, entries: np.ndarray) -> str:
    content = ", ".join(map(repr, entries.ravel().tolist())) or "0"
    return f"static const {kind} {name}[] = {{{content}}};\n"


def _source(terms: WatchedTerms, kinds: Sequence[_Kind]) -> str:
    """The library: ``forces``, its Jacobian ``jac_forces``, and ``rates``."""
    n, size = terms.eom.q.numel(), terms.values.size
    acting = [kind for kind in kinds if kind.has_forces and kind.forces.size]
    text = ["#include <math.h>\n"]
    forces, slopes, rates = _Loops(), _Loops(), _Loops()
    for kind in kinds:
        text += [tape.as_c for tape in (kind.rates, kind.apart) if tape is not None]
        text.append(_table("int", f"places_{kind.number}", kind.batch.places))
        text.append(_table("int", f"rate_places_{kind.number}", kind.batch.rate_places))
        text.append(_table("double", f"constants_{kind.number}", kind.batch.constants))
        text.append(_table("int", f"into_{kind.number}", kind.result_places))
        rates.add(kind, kind.rates, kind.result_places, f"into_{kind.number}", rates=True)
    places = [kind.slope_places() for kind in acting]
    entries = [columns * n + rows for rows, columns in places]
    pattern = np.unique(np.concatenate([np.zeros(0, int), *(part.ravel() for part in entries)]))
    for kind, own in zip(acting, entries, strict=True):
        tape, into = kind.slopes_tape(), np.searchsorted(pattern, own)
        text += [kind.forces.as_c, tape.as_c]
        text.append(_table("int", f"coordinates_{kind.number}", kind.coordinates))
        text.append(_table("int", f"slope_places_{kind.number}", into))
        forces.add(kind, kind.forces, kind.coordinates, f"coordinates_{kind.number}")
        slopes.add(kind, tape, into, f"slope_places_{kind.number}")
    columns, rows = np.divmod(pattern, n)
    sparsity = ca.Sparsity.triplet(n, size, rows.tolist(), columns.tolist())
    text.append(forces.function("forces", n))
    text.append(_interface("forces", [_dense(size)], [_dense(n)], forces.work))
    text.append(slopes.function("jac_forces", pattern.size))
    text.append(_interface("jac_forces", [_dense(size), _dense(n)], [_sparse(sparsity)], slopes.work))
    text.append(rates.function("rates", terms.size))
    text.append(_interface("rates", [_dense(size)], [_dense(terms.size)], rates.work))
    return "\n".join(text)


def _dense(size: int) -> list[int]:
    return [size, 1, 1]


def _sparse(pattern: ca.Sparsity) -> list[int]:
    return [pattern.size1(), pattern.size2(), *pattern.colind(), *pattern.row()]


def _interface(name: str, inputs: Sequence[list[int]], outputs: Sequence[list[int]], work: int) -> str:
    """What CasADi asks of a function in a library beside itself."""
    text = []
    for what, patterns in (("in", inputs), ("out", outputs)):
        tables = []
        for k, pattern in enumerate(patterns):
            tables.append(f"{name}_{what}_{k}")
            text.append(_table("long long int", tables[-1], np.array(pattern)))
        choice = "".join(f"if (i == {k}) return {table}; " for k, table in enumerate(tables))
        text.append(f"long long int {name}_n_{what}(void) {{ return {len(patterns)}; }}\n")
        text.append(f"const long long int* {name}_sparsity_{what}(long long int i) {{ {choice}return 0; }}\n")
    sizes = f"*arg = {len(inputs)}; *res = {len(outputs)}; *iw = 0; *w = {work};"
    parameters = "long long int* arg, long long int* res, long long int* iw, long long int* w"
    text.append(f"int {name}_work({parameters}) {{ {sizes} return 0; }}\n")
    return "".join(text)
