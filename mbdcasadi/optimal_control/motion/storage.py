"""Solutions in files: one NumPy file without pickle."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...errors import FileError, ModelError
from ...numerics.tolerances import MET
from ...results.archives import Archive, read_arrays, write_arrays
from ..problem import OptimalControlProblem
from ..program.collocation_program import CollocationProgram
from ..program.problem_setup import ProblemSetup
from ..program.setup import Settings
from ..program.statistics import Answer, Attempt, SolveStatistics
from ..statement.known_inputs import KnownInputs, inputs_of, read_known_inputs
from ..transcription import TRANSCRIPTIONS
from ..transcription.mesh import Mesh
from .solved_motion import SolvedMotion

_FORMAT = "mbdcasadi solution 4"


def save(solution: SolvedMotion, path: str | Path) -> None:
    """Write a solution; :func:`restored` reads it."""
    program, scheme = solution.program, solution.settings.transcription
    if type(scheme) not in TRANSCRIPTIONS.values():
        raise ModelError(
            f"save: the solution was found by the transcription {scheme.name!r}, which is not part of the "
            "package, and not known when the file is read; save solution.trajectory, which can be a guess too"
        )
    settings = {"transcription": scheme.name, "degree": scheme.degree, "control": solution.settings.control}
    settings["angles"] = solution.settings.angles
    content: dict[str, Any] = {
        "format": _FORMAT,
        "settings": json.dumps(settings),
        "statistics": json.dumps(asdict(solution.statistics)),
        "held": json.dumps(program.held),
        "cost": solution.cost,
        "x": solution.variables,
        "lam_x": solution.answer.lam_x,
        "lam_g": solution.answer.lam_g,
        "rows": solution.answer.rows,
        "row labels": np.array([row.label for row in program.rows], dtype=str),
    }
    for number, part in enumerate(solution.phases):
        prefix = _prefix(solution.problem, number)
        content |= {f"{prefix}segment times": part.segment_times, f"{prefix}parameters": part.numeric.p}
        content |= {f"{prefix}mesh {k}": fractions for k, fractions in enumerate(part.mesh.segments)}
        content[f"{prefix}moving mesh points"] = np.array(part.mesh.moving, int)
        content[f"{prefix}pinned mesh points"] = np.array(part.mesh.pinned, int)
    for place, symbol in solution.settings.known.symbols(solution.problem):
        course = solution.inputs[symbol]
        content |= {f"input {place} times": course.breaks, f"input {place}": course.coefficients}
    write_arrays(path, content)


def _prefix(problem: OptimalControlProblem, number: int) -> str:
    """Beginning of the names of the entries of a phase."""
    return f"phase {number} " if len(problem.phases) > 1 else ""


def restored(path: str | Path, problem: OptimalControlProblem) -> tuple[Any, ...]:
    """Return the arguments of a solution of a problem from what :func:`save` wrote.

    A :class:`FileError` is raised for what is not such a file, and for a solution of another problem.
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"read_solution takes an OptimalControlProblem, got {problem!r}")
    if not isinstance(path, str | Path):
        raise FileError(f"read_solution takes the path of a file, got {path!r}")
    content = read_arrays(path, _FORMAT, "solution", "Solution.save")
    try:
        return _restored(problem, content)
    except FileError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise FileError(f"{path}: an entry of the solution is missing or damaged: {error}") from None


def _restored(problem: OptimalControlProblem, content: Archive) -> tuple[Any, ...]:
    try:
        chosen = {**content.json("settings")}
        angles = chosen.pop("angles", False)
        settings = replace(Settings.read(**chosen, options=None, progress=False), angles=angles)
    except ModelError as error:
        raise FileError(
            f"{content.path}: the settings of the solution are damaged, or of another version: {error}"
        ) from None
    meshes, times, parameters = _phases(problem, content)
    settings = replace(settings, known=_known_inputs(problem, content))
    setup = ProblemSetup(problem, settings)
    held = tuple((int(phase), str(label), float(tau)) for phase, label, tau in content.json("held"))
    program = setup.transcribe(meshes, held)
    labels = [row.label for row in program.rows]
    theirs, count = content.names("row labels"), len(labels)
    if program.size != content["x"].size or labels != theirs:
        other = next((f"'{a}' where the problem has '{b}'" for a, b in zip(theirs, labels, strict=False) if a != b), "")
        raise _another(content, other or "its size is another one")
    _check_values(problem, program, program.data(parameters, meshes, times, settings.known), times, content)
    statistics = content.json("statistics")
    statistics.pop("solver", None)  # earlier versions had several
    for name in ("starts", "passes", "steps", "stages"):
        statistics[name] = [_attempt(one) for one in statistics.get(name, [])]
    return (
        problem,
        program,
        settings,
        setup.initial,
        parameters,
        meshes,
        times,
        content["x"],
        float(content["cost"]),
        SolveStatistics(**statistics),
        Answer(content.numbers("lam_x", program.size), content.numbers("lam_g", count), content["rows"]),
    )


def _another(content: Archive, reason: str) -> FileError:
    return FileError(f"{content.path}: the solution belongs to another problem: {reason}")


def _attempt(entry: dict[str, Any]) -> Attempt:
    """An attempt from its entry; files of earlier versions name a start by its guess, and lack what it did not have."""
    lacking = {"description": entry.pop("guess", ""), "cost": np.nan, "status": "", "seconds": np.nan, "intervals": 0}
    return Attempt(**(lacking | entry))


def _phases(problem: OptimalControlProblem, content: Archive) -> tuple[list[Mesh], list[np.ndarray], list[np.ndarray]]:
    """Meshes, times of start, waypoints and end, s, and parameters by phase."""
    meshes, times, parameters = [], [], []
    for number, phase in enumerate(problem.phases):
        prefix = _prefix(problem, number)
        parameters.append(content.numbers(f"{prefix}parameters", len(phase.mechanism.parameters)))
        count = sum(name.startswith(f"{prefix}mesh ") for name in content)
        if phase.is_instant and count == 1:
            meshes.append(Mesh.instant())
            times.append(content.numbers(f"{prefix}segment times", 2))
            continue
        segments = [_increasing(content, f"{prefix}mesh {k}") for k in range(count)]
        if len(segments) != len(phase.waypoints) + 1:
            raise FileError(
                f"{content.path}: the solution has {len(segments) - 1} waypoints, the problem {len(phase.waypoints)}"
                if segments
                else f"{content.path}: the solution does not have the phase '{phase.name}' of the problem"
            )
        names = (f"{prefix}{kind} mesh points" for kind in ("moving", "pinned"))  # earlier versions have none
        moving, pinned = (tuple(content.numbers(name, None).tolist()) if name in content else () for name in names)
        meshes.append(Mesh(tuple(segments), moving, pinned))
        times.append(_increasing(content, f"{prefix}segment times", len(segments) + 1))
    return meshes, times, parameters


def _known_inputs(problem: OptimalControlProblem, content: Archive) -> KnownInputs:
    """Inputs that were given, with their courses in the solution."""
    known: dict[Any, Any] = {}
    for place, symbol in enumerate(inputs_of(problem)):
        if f"input {place}" in content:
            course = PiecewisePolynomial(_increasing(content, f"input {place} times"), content[f"input {place}"])
            known[symbol] = course.coefficients[0, 0] if problem.has_free_times else course
    return read_known_inputs(problem, known)


def _increasing(content: Archive, name: str, count: int | None = None) -> np.ndarray:
    """Numbers of an entry, each larger than the one before."""
    values = content.numbers(name, count)
    if values.size < 2 or np.any(np.diff(values) <= 0):
        raise content.refuse(f"the entry '{name}' does not increase")
    return values


def _check_values(
    problem: OptimalControlProblem,
    program: CollocationProgram,
    data: np.ndarray,
    times: list[np.ndarray],
    content: Archive,
) -> None:
    """Refuse a solution whose cost or rows are others in this problem."""
    low, high = np.sum([phase.span for phase in problem.phases], axis=0).tolist()
    duration = float(times[-1][-1])
    if not low * (1 - MET) <= duration <= high * (1 + MET):
        raise FileError(f"{content.path}: the solution takes {duration:g} s, the problem {low:g} … {high:g} s")
    x, theirs = content.numbers("x", program.size), float(content.numbers("cost"))
    cost, rows = program.nlp.evaluate(x / program.scale, data)
    off = abs(float(cost) * program.cost_scale - theirs)
    if not off <= MET * (abs(theirs) + program.cost_scale):
        raise _another(content, f"its cost there would differ by {off:.3g}")
    difference = np.abs(rows.full().ravel() - content.numbers("rows", len(program.rows)))
    worst = int(np.argmax(difference))
    if difference[worst] > MET:
        raise _another(content, f"it differs in: {program.rows[worst].label}")
