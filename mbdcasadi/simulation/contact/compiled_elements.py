"""Forces of many elements of one kind, and their watched quantities, in C: one formula, evaluated for near ones.

As expressions the equations contain every contact with all its
instructions, which are evaluated whether it is closed or not. Compiled, a loop goes over the
elements of a kind. It passes over those that are apart by a cheap test, and the
code is as long as one of them.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ...equations.batches import Values
from ...equations.numeric import NumericEquations
from ...integrators.native import build
from ...numerics.c_code import SIGNATURE, Tape, UnsupportedOperation, simplified, tape_of
from ...numerics.c_interface import constant_table, definitions, interface
from ...numerics.lazy import cached_property
from ...numerics.symbolic import LOCK
from .watched_terms import APART, COURSES, DISPLACEMENTS, FORCES, WatchedTerms, watched_terms

#: Instructions of all elements, a call of their forces and one of their rates, from which compiling them pays in most
#: runs: the interpreter takes some 0.1 ms for these, and the compiler a second.
LEAST_INSTRUCTIONS = 8_000
#: Elements of a kind, in the mean over the instructions, from which it pays.
LEAST_ALIKE = 4.0
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


class RepeatedElements:
    """Elements that are many of a kind, so that a loop in C over them pays.

    Attributes
    ----------
    pays : bool
        True if there are so many that compiling them pays in most runs.
    """

    def __init__(self, terms: WatchedTerms):
        self.terms = terms
        try:
            self._kinds = [_Kind(terms, number) for number in range(len(terms.batches))]
        except UnsupportedOperation:
            self._kinds = []
        written = sum(kind.size for kind in self._kinds)
        expanded = sum(len(kind.batch.places) * kind.size for kind in self._kinds)
        self.pays = expanded >= max(LEAST_INSTRUCTIONS, LEAST_ALIKE * written)

    @cached_property
    def rest(self) -> ca.Function:
        """``(t, q, v, z, lam, u, p) -> Q``: generalised forces of the other elements."""
        eom = self.terms.eom
        numbers = {int(number) for kind in self._kinds if kind.has_forces for number in kind.batch.numbers}
        compiled = [self.terms.elements[number] for number in numbers]
        others = [e for e in eom.mechanism.elements if e not in compiled]
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.u, eom.p]
        return ca.Function("rest_of_forces", arguments, [ca.densify(eom.generalised_forces(others))])

    @property
    def size(self) -> int:
        """Instructions of one element of each kind; those of its quantities watched at outputs are as many again."""
        return sum(2 * kind.size for kind in self._kinds)

    def loops(self, *, outputs: bool) -> tuple[str, int]:
        """Functions of a run in C, forces and rates of all kinds, and the length of their work array.

        With `outputs` also the quantities watched at outputs: a method that returns all its steps has many of these.
        """
        terms = self.terms
        text = ["#include <math.h>\n"]
        sizes = {"forces": terms.eom.q.numel(), "rates": terms.size}
        sizes |= {"gaps": 3 * len(terms.owners), "courses": 2 * len(terms.smoothings)} if outputs else {}
        loops = {name: _Loops() for name in sizes}
        for kind in self._kinds:
            number, batch = kind.number, kind.batch
            text.append(constant_table("int", f"places_{number}", batch.places.flat))
            text.append(constant_table("int", f"rate_places_{number}", batch.rate_places.flat))
            text.append(constant_table("double", f"constants_{number}", batch.constants.ravel().tolist()))
            if kind.apart is not None:
                text += [f"static inline int {kind.apart.name}({SIGNATURE});", kind.apart.as_c]
            for name in sizes:
                if name == "forces" and not kind.has_forces:
                    continue
                tape, rows = kind.results(name)
                text += [tape.as_c, constant_table("int", f"{name}_places_{number}", rows.flat)]
                is_gap = name == "gaps"  # gaps are needed of elements that are apart too
                loops[name].add(
                    kind, tape, rows, f"{name}_places_{number}", rates=is_gap or name == "rates", all_of_them=is_gap
                )
        work = max(loop.work for loop in loops.values())
        for name, size in sizes.items():
            text.append(loops[name].function(name, size))
            text.append(definitions(interface(name, {"values": (terms.values.size, 1)}, {name: (size, 1)}, work)))
        return "\n".join(text), work

    @cached_property
    def slopes(self) -> tuple[str, np.ndarray, np.ndarray, int]:
        """``jac_forces`` in C, with the forces compiled before it: slopes of the forces by the column of values.

        Besides the code the rows and columns of what it returns (k,), and the length of its work array.
        """
        n, slopes = self.terms.eom.q.numel(), _Loops()
        text: list[str] = []
        acting = [(kind, *kind.slopes()) for kind in self._kinds if kind.has_forces]
        entries = [columns * n + rows for _, _, rows, columns in acting]
        pattern = np.unique(np.concatenate([np.zeros(0, int), *(part.ravel() for part in entries)]))
        for (kind, tape, *_), entry_places in zip(acting, entries, strict=True):
            table, into = f"slope_places_{kind.number}", np.searchsorted(pattern, entry_places)
            # slopes are long code that is evaluated seldom: optimising it costs more time than it saves
            text += ['#pragma GCC push_options\n#pragma GCC optimize ("O0")\n', tape.as_c, "#pragma GCC pop_options\n"]
            text.append(constant_table("int", table, into.flat))
            slopes.add(kind, tape, into, table)
        columns, rows = np.divmod(pattern, n)
        text.append(slopes.function("jac_forces", pattern.size))
        return "\n".join(text), rows, columns, slopes.work

    def _source(self) -> str:
        """The library of IDAS: what a run needs, and ``jac_forces``, the Jacobian of the forces."""
        n, size = self.terms.eom.q.numel(), self.terms.values.size
        slopes, rows, columns, work = self.slopes
        sparsity = ca.Sparsity.triplet(n, size, rows.tolist(), columns.tolist())
        arguments = {"values": (size, 1), "out_forces": (n, 1)}
        around = definitions(interface("jac_forces", arguments, {"jac_forces_values": sparsity}, work))
        return "\n".join([self.loops(outputs=False)[0], slopes, around])

    def watch_by(self, library: str) -> None:
        """Evaluate the quantities watched at outputs by a library with the loops."""
        self.terms.use_compiled(ca.external("gaps", library), ca.external("courses", library))

    @cached_property
    def library(self) -> tuple[CompiledElements | None, str]:
        """The functions, compiled; or None; and how they were compiled, or why not."""
        using = build.compiler()
        if using is None:
            return None, f"{build.no_compiler()}: the contacts are interpreted; a run with this many is faster compiled"
        source = self._source()
        key = build.key_of(FORMAT, using.identity, OPTIMISATION, *build.FLAGS, source)
        began, library = time.perf_counter(), build.find(key)
        remark = "compiled contacts, kept from before"
        if library is None:
            try:
                library = build.build(key, source, OPTIMISATION, using)
            except build.CompilationError as error:
                return None, f"interpreted contacts: {error}"
            remark = f"contacts compiled by {using.name} in {time.perf_counter() - began:.2g} s"
        forces = ca.external("forces", library._name)
        # a method whose steps take slopes of the integrals too, as rosenbrock, finds those of what is only watched
        rates = ca.external("rates", library._name, {"enable_fd": True})
        return CompiledElements(self.terms.values, forces, rates, self.rest), remark


def repeated_elements(terms: WatchedTerms) -> RepeatedElements | None:
    """Return the elements of a mechanism that are many of a kind; None if there are too few; found once for it."""
    elements = terms.eom.mechanism.cache.get_or_create("repeated elements", lambda: RepeatedElements(terms))
    return elements if elements.pays else None


def compiled_elements(terms: WatchedTerms) -> tuple[CompiledElements | None, str]:
    """Return the compiled elements of a mechanism, or None, and a remark, which is empty if there are too few."""
    repeated = repeated_elements(terms)
    if repeated is None:
        return None, ""
    with LOCK:
        return repeated.library


def has_many_contacts(numeric: NumericEquations) -> bool:
    """Return True if no joint holds the bodies and so many elements are alike that loops over them in C pay."""
    eom = numeric.eom
    if eom.lam.numel() or numeric.massless or build.compiler() is None:
        return False
    return repeated_elements(watched_terms(eom)) is not None


class _Kind:
    """Elements of a batch, and what is evaluated of each of them in C.

    Attributes
    ----------
    apart : Tape or None
        Positive for an element whose results are all zero.
    has_forces : bool
        True if its forces depend on known quantities alone: not on accelerations and reactions.
    """

    def __init__(self, terms: WatchedTerms, number: int):
        self._terms, self.number, self.batch = terms, number, terms.batches[number]
        self._results: dict[str, tuple[Tape, np.ndarray]] = {}
        batch = self.batch
        apart = batch.parts[APART]
        self.apart = self._tape("apart", apart) if apart.numel() else None
        displacements, forces = batch.parts[DISPLACEMENTS], batch.parts[FORCES]
        unknown = batch.of_groups("a", "lam")
        self.has_forces = not (unknown and ca.depends_on(ca.vertcat(displacements, forces), batch.symbols[unknown]))
        coordinates = batch.of_groups("q")
        self._coordinates = terms.values.coordinate(batch.places[:, coordinates])
        self._force = ca.jtimes(displacements, batch.symbols[coordinates], forces, True) if coordinates else ca.SX(0, 1)

    def _tape(self, name: str, expression: ca.SX) -> Tape:
        batch = self.batch
        arguments = [batch.symbols, batch.rates, batch.parameters]
        return tape_of(simplified(ca.Function(f"{name}_{self.number}", arguments, [ca.densify(expression)])))

    @cached_property
    def size(self) -> int:
        """Instructions of the forces and the rates of one of them."""
        return self.results("rates")[0].size + (self.results("forces")[0].size if self.has_forces else 0)

    def results(self, name: str) -> tuple[Tape, np.ndarray]:
        """Tape of what one of the functions needs of an element, and entries of the result to which it adds (n, k)."""
        if name not in self._results:
            self._results[name] = self._result(name)
        return self._results[name]

    def _result(self, name: str) -> tuple[Tape, np.ndarray]:
        terms, k, batch = self._terms, self.number, self.batch
        arguments = [batch.symbols, batch.rates, batch.parameters]
        if name == "forces":
            return self._tape(name, self._force), self._coordinates
        if name == "rates":
            return self._tape(name, terms.rate_functions[k].call(arguments)[0]), terms.rate_places[k]
        if name == "gaps":
            return self._tape(name, terms.bounded_gaps[k].call(arguments)[0]), terms.gap_places[k]
        numbers = terms.numbered(COURSES)[k]
        tape = self._tape(name, terms.course_functions[k].call(arguments)[0])
        return tape, np.hstack([numbers, numbers + len(terms.smoothings)])

    def slopes(self) -> tuple[Tape, np.ndarray, np.ndarray]:
        """Nonzero slopes of the forces by the symbols, and their coordinates and places of symbols (n, k)."""
        slopes = ca.jacobian(ca.densify(self._force), self.batch.symbols)
        rows, columns = (np.array(part, int) for part in slopes.sparsity().get_triplet())
        tape = self._tape("slopes", slopes.nz[:])
        return tape, self._coordinates[:, rows], self.batch.places[:, columns]


# --- C ---------------------------------------------------------------------------------------
@dataclass
class _Loops:
    """Loops over the elements of kinds that add to one result."""

    body: list[str] = field(default_factory=list)
    work: int = 0

    def add(
        self, kind: _Kind, tape: Tape, rows: np.ndarray, table: str, *, rates: bool = False, all_of_them: bool = False
    ) -> None:
        """Add a loop that evaluates a tape for each element, and adds its results to entries of the result.

        Parameters
        ----------
        rows : numpy.ndarray
            Entries of the result (n, rows).
        table : str
            Name of the table in C with these.
        rates : bool
            True if the tape needs rates of the symbols.
        all_of_them : bool
            True if elements that are apart are evaluated too.
        """
        if not rows.size:
            return
        n, symbols = kind.batch.places.shape
        k = kind.number
        self.work = max(self.work, tape.work_in_c, 0 if kind.apart is None else kind.apart.work_in_c)
        lines = [
            f"for (int e = 0; e < {n}; ++e) {{",
            f"double s[{max(symbols, 1)}], r[{max(symbols, 1)}];",
            f"const double* in[] = {{s, r, constants_{k} + e * {kind.batch.constants.shape[1]}}};",
        ]
        if kind.apart is not None and not all_of_them:
            lines += [  # most elements are apart: what the test does not need is not gathered for them
                *(f"s[{i}] = values[places_{k}[e * {symbols} + {i}]];" for i in kind.apart.nonzeros_of(0)),
                "double apart;",
                "double* test[] = {&apart};",
                f"apart_{k}(in, test, iw, w, mem);",
                "if (apart > 0) continue;",
            ]
        lines.append(_gathered("s", f"places_{k}", symbols))
        if rates:
            lines.append(_gathered("r", f"rate_places_{k}", symbols))
        lines += [
            f"double y[{max(rows.shape[1], 1)}];",
            "double* out[] = {y};",
            f"{tape.name}(in, out, iw, w, mem);",
            f"for (int i = 0; i < {rows.shape[1]}; ++i) result[{table}[e * {rows.shape[1]} + i]] += y[i];",
            "}",
        ]
        self.body += lines

    def function(self, name: str, size: int) -> str:
        """Code of a function whose result is the sum over all loops."""
        head = f"int {name}({SIGNATURE}) {{\nconst double* values = arg[0];\n"
        head += "double* result = res[0];\nif (!result) return 0;\n"
        head += f"for (int i = 0; i < {size}; ++i) result[i] = 0;\n"
        return head + "\n".join(self.body) + "\nreturn 0;\n}\n"


def _gathered(name: str, places: str, count: int) -> str:
    return f"for (int i = 0; i < {count}; ++i) {name}[i] = values[{places}[e * {count} + i]];"
