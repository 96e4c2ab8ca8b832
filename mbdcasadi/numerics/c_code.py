"""The writer of C: straight-line code from the instructions of ``SX`` functions, in pieces that compilers like.

A compiler needs more than linear time for a long function. Cut into pieces of a
few hundred instructions, which hand on values through an array, the equations of
a chain of 100 links compile in a third of the time that one function takes.

The functions have the calling convention of CasADi's own generator,
``int f(const double** arg, double** res, long long int* iw, double* w, int mem)``,
and the same rounding as its interpreter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..errors import MechanismError
from .lazy import cached_property
from .operations import OPERATIONS, operation_name

#: Instructions in a piece.
PIECE = 400
#: Instructions of a function up to which those come first that most others wait for: a processor then works on
#: several chains of operations side by side (chain of 10 links: 0.30 -> 0.23 µs). In longer functions too many values
#: would wait in memory (chain of 40: 1.4 -> 1.7 µs).
SHORT = 2000

#: Entries of a tape besides the operations.
CONSTANT, INPUT, OUTPUT = 0, 1, 2
_WRITTEN = {operation: row.c for operation, row in OPERATIONS.items() if row.c}
_CODES = {operation: code for code, operation in enumerate(_WRITTEN, start=3)}
_CODES |= {ca.OP_CONST: CONSTANT, ca.OP_INPUT: INPUT, ca.OP_OUTPUT: OUTPUT}
_TEMPLATES = dict(enumerate(_WRITTEN.values(), start=3))
_OPERATIONS = {code: operation for operation, code in _CODES.items()}
_SINE, _COSINE = _CODES[ca.OP_SIN], _CODES[ca.OP_COS]
#: Cycles until the result of an operation is there, roughly: calls, divisions, others.
_CYCLES = {code: 40 if "(" in text else 13 if "/" in text else 4 for code, text in _TEMPLATES.items()}

#: Parameters of every function that is written.
SIGNATURE = "const double** arg, double** res, long long int* iw, double* w, int mem"


class UnsupportedOperation(MechanismError):
    """An operation that is not written as C; carries its name."""

    def __init__(self, function: ca.Function, operation: str):
        super().__init__(f"{function.name()}: the operation '{operation}' is not written as C")
        self.operation = operation


@dataclass(frozen=True)
class Tape:
    """Instructions of an ``SX`` function as arrays.

    Attributes
    ----------
    function : casadi.Function
        The function.
    instructions : numpy.ndarray of int32
        (n, 4): operation, result, first and second operand. A constant has its place among
        `constants` as operand, an input its argument and nonzero; of an output the result is
        its number, and the operands are the value and the nonzero.
    constants : numpy.ndarray
        Numbers (k,).
    work : int
        Number of values that are kept.
    """

    function: ca.Function
    instructions: np.ndarray
    constants: np.ndarray
    work: int

    @property
    def name(self) -> str:
        """Name of the function."""
        return str(self.function.name())

    @property
    def arguments(self) -> tuple[dict[str, tuple[int, int]], dict[str, tuple[int, int]]]:
        """Shapes of the arguments and results by name, in order; in C all are dense."""
        f = self.function
        return (
            {f.name_in(k): f.size_in(k) for k in range(f.n_in())},
            {f.name_out(k): f.size_out(k) for k in range(f.n_out())},
        )

    @property
    def size(self) -> int:
        """Number of instructions."""
        return len(self.instructions)

    def nonzeros_of(self, argument: int) -> list[int]:
        """Nonzeros of an argument on which the results depend, in order."""
        is_read = (self.instructions[:, 0] == INPUT) & (self.instructions[:, 2] == argument)
        return np.unique(self.instructions[is_read, 3]).tolist()

    @cached_property
    def _writer(self) -> _Writer:
        return _Writer(self)

    @property
    def as_c(self) -> str:
        """Definition of the function in C, named as the function."""
        return self._writer.text()

    @property
    def work_in_c(self) -> int:
        """Length of ``w`` that the function in C needs."""
        return self._writer.work


def tape_of(function: ca.Function) -> Tape:
    """Return the instructions of an ``SX`` function.

    Raises
    ------
    UnsupportedOperation
        For an operation without C, as the call of another function.
    """
    if not function.is_a("SXFunction"):
        raise UnsupportedOperation(function, function.class_name())
    instructions: list[tuple[int, int, int, int]] = []
    constants: list[float] = []
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        if operation not in _CODES:
            raise UnsupportedOperation(function, operation_name(operation))
        code, results = _CODES[operation], function.instruction_output(k)
        if code == CONSTANT:
            instructions.append((code, results[0], len(constants), 0))
            constants.append(float(function.instruction_constant(k)))
        else:
            operands = function.instruction_input(k)
            instructions.append((code, results[0], operands[0], results[1] if code == OUTPUT else operands[-1]))
    table = np.array(instructions, np.int32).reshape(-1, 4)
    return Tape(function, table, np.array(constants), function.sz_w())


def applied(code: int, first: ca.SX, second: ca.SX) -> ca.SX:
    """Return the result of an operation of a tape on expressions."""
    operation = _OPERATIONS[code]
    return ca.SX.binary(operation, first, second) if "{y}" in _TEMPLATES[code] else ca.SX.unary(operation, first)


def simplified(function: ca.Function, *, densify: bool = True) -> ca.Function:
    """Return a function whose common subexpressions are evaluated once."""
    arguments = function.sx_in()
    results = ca.cse([ca.densify(result) if densify else result for result in function.call(arguments)])
    return ca.Function(function.name(), arguments, results, function.name_in(), function.name_out())


def interpreter_in_c() -> str:
    """Return the cases of a ``switch`` in C over the operations of tapes, ``i`` an instruction and ``w`` the values."""
    lines = []
    for code, template in _TEMPLATES.items():
        lines.append(f"case {code}: w[i[1]] = {template.format(x='w[i[2]]', y='w[i[3]]')}; break;")
    return "\n".join(lines)


class _Writer:
    """C code of one tape; results that are sparse are written as dense ones.

    Every instruction defines a value of its own. A value that is used in its own
    piece alone is a local variable; others have a place in ``w``, which is
    taken again once the last piece that uses them is past. What only the last
    result needs is left out if that is not asked for.
    """

    def __init__(self, tape: Tape):
        self.tape = tape
        self.name = tape.name
        patterns = [tape.function.sparsity_out(k) for k in range(tape.function.n_out())]
        self.sparse = {k: pattern for k, pattern in enumerate(patterns) if not pattern.is_dense()}
        self.lines = self._numbered()
        self.last = tape.function.n_out() - 1
        others = [k for k, line in enumerate(self.lines) if line[0] == OUTPUT and line[1] != self.last]
        self.tail = others[-1] + 1 if others else 0
        if len(self.lines) <= SHORT:
            self.lines = _paired(_most_urgent_first(self.lines[: self.tail])) + self.lines[self.tail :]
        self._place()

    def _numbered(self) -> list[tuple[int, int, int, int]]:
        """Instructions, with those that define their operands."""
        instructions = self.tape.instructions.tolist()
        last: dict[int, int] = {}
        lines: list[tuple[int, int, int, int]] = []
        dense = {k: pattern.find() for k, pattern in self.sparse.items()}
        self.constants: dict[int, str] = {}
        self.inputs: dict[int, tuple[int, int]] = {}
        for k, (code, result, first, second) in enumerate(instructions):
            if code == CONSTANT:
                self.constants[k] = literal(self.tape.constants[first])
            elif code == INPUT:
                self.inputs[k] = first, second
            elif code == OUTPUT:
                place = dense[result][second] if result in dense else second
                lines.append((code, result, last[first], place))
                continue
            else:
                lines.append((code, k, last[first], last[second]))
            last[result] = k
        return _paired(lines)

    def _operands(self, line: tuple[int, int, int, int]) -> tuple[int, ...]:
        return line[2:3] if line[0] == OUTPUT else line[2:]

    def _place(self) -> None:
        """Places in ``w`` of the values that are used in later pieces."""
        lines = self.lines
        self.pieces = [lines[k : k + PIECE] for k in range(0, len(lines), PIECE)] or [[]]
        defined: dict[int, int] = {}
        last_use: dict[int, int] = {}
        for number, piece in enumerate(self.pieces):
            for line in piece:
                for operand in self._operands(line):
                    if operand in defined:
                        last_use[operand] = number
                if line[0] != OUTPUT:
                    defined[line[1]] = number
        self.places: dict[int, int] = {}
        free: list[int] = []
        ending: dict[int, list[int]] = {}
        size = 0
        for number, piece in enumerate(self.pieces):
            for line in piece:
                value = line[1]
                if line[0] == OUTPUT or last_use.get(value, number) == number:
                    continue
                if free:
                    self.places[value] = free.pop()
                else:
                    self.places[value], size = size, size + 1
                ending.setdefault(last_use[value], []).append(self.places[value])
            free += ending.pop(number, [])
        self.work = size

    def text(self) -> str:
        """The function, with the pieces before it."""
        zeros = "".join(
            f"  if (res[{k}]) for (int i = 0; i < {pattern.numel()}; ++i) res[{k}][i] = 0.0;\n"
            for k, pattern in self.sparse.items()
        )
        if len(self.pieces) == 1:
            return f"int {self.name}({SIGNATURE}) {{\n{zeros}{self._piece(0, 'return 0')}  return 0;\n}}\n"
        parts = []
        for number in range(len(self.pieces)):
            head = f"static void {self.name}_{number}(const double** arg, double** res, double* w)"
            parts.append(f"{head} {{\n{self._piece(number, 'return')}}}\n")
        calls = "".join(f"  {self.name}_{number}(arg, res, w);\n" for number in range(len(self.pieces)))
        parts.append(f"int {self.name}({SIGNATURE}) {{\n{zeros}{calls}  return 0;\n}}\n")
        return "\n".join(parts)

    def _piece(self, number: int, end: str) -> str:
        known: dict[int, str] = dict(self.constants)
        text = []

        def value(operand: int) -> str:
            if operand not in known:
                source = self._source(operand)
                known[operand] = f"v{operand}"
                text.append(f"  const double v{operand} = {source};\n")
            return known[operand]

        for k, line in enumerate(self.pieces[number], start=number * PIECE):
            code = line[0]
            if k == max(self.tail, number * PIECE):
                text.append(f"  if (!res[{self.last}]) {end};\n")
            if code == OUTPUT:
                text.append(f"  if (res[{line[1]}]) res[{line[1]}][{line[3]}] = {value(line[2])};\n")
                continue
            x, y = value(line[2]), value(line[3])
            known[line[1]] = f"v{line[1]}"
            text.append(f"  const double v{line[1]} = {_TEMPLATES[code].format(x=x, y=y)};\n")
            if line[1] in self.places:
                text.append(f"  w[{self.places[line[1]]}] = v{line[1]};\n")
        return "".join(text)

    def _source(self, operand: int) -> str:
        if operand in self.inputs:
            argument, nonzero = self.inputs[operand]
            return f"arg[{argument}] ? arg[{argument}][{nonzero}] : 0.0"
        return f"w[{self.places[operand]}]"


def _most_urgent_first(lines: Sequence[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    """Instructions by the time at which they must begin if the last one is to end as early as it can."""
    begin: dict[int, int] = {}
    needed: dict[int, int] = {}
    for code, result, *operands in reversed(lines):
        if code != OUTPUT:
            begin[result] = needed.get(result, 0) - _CYCLES[code]
            for operand in operands:
                needed[operand] = min(needed.get(operand, 0), begin[result])
    # a result is handed on as soon as it is there
    return sorted(lines, key=lambda line: begin.get(line[2] if line[0] == OUTPUT else line[1], 0))


def _paired(lines: Sequence[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    """Instructions with the cosine of an angle beside its sine: compilers make one call of both."""
    both: dict[int, list[tuple[int, int, int, int]]] = {}
    for line in lines:
        if line[0] in (_SINE, _COSINE):
            both.setdefault(line[2], []).append(line)
    return [at for line in lines for at in ([line] if line[0] not in (_SINE, _COSINE) else both.pop(line[2], []))]


def literal(value: float) -> str:
    """Return a number in C, to the last digit."""
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    text = repr(float(value))
    return f"({text})" if text.startswith("-") else text
