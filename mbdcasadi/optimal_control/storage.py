"""Solutions in files: one NumPy file without pickle."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import FileError, ModelError
from ..results.archives import read_arrays, write_arrays
from .nlp.motion_program import MotionProgram
from .nlp.solver import Solver
from .preparation import Settings
from .problem import OptimalControlProblem
from .refinement.mesh import Mesh
from .solution import Solution
from .solve_statistics import Answer, Pass, SolveStatistics, Start, Step

_FORMAT = "mbdcasadi solution 2"
#: Difference of scaled rows and costs up to which two problems count as the same.
SAME = 1e-6


def save(solution: Solution, path: str | Path) -> None:
    """Write a solution; see :func:`read_solution`."""
    program = solution.program
    if not isinstance(solution.settings["transcription"], str):
        raise ModelError(
            f"save: the solution was found by the transcription {program.scheme.name!r}, which is no part of the "
            "package and so is not known where the file is read; save solution.trajectory, which can be a guess too"
        )
    content: dict[str, Any] = {
        "format": _FORMAT,
        "settings": json.dumps(solution.settings),
        "statistics": json.dumps(asdict(solution.statistics)),
        "cost": solution.cost,
        "x": solution.variables,
        "marks": solution.marks,
        "parameters": solution.numeric.p,
        "lam_x": solution.answer.lam_x,
        "lam_g": solution.answer.lam_g,
        "rows": solution.answer.rows,
        "row labels": np.array([row.label for row in program.rows], dtype=str),
    }
    content |= {f"phase {k}": shares for k, shares in enumerate(solution.shares.phases)}
    write_arrays(path, content)


def read_solution(path: str | Path, problem: OptimalControlProblem) -> Solution:
    """Read what ``Solution.save`` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    problem : OptimalControlProblem
        The problem that it solves: the rows of its program must be the same.

    Returns
    -------
    Solution
        With everything that it could do before.

    Raises
    ------
    FileError
        For what is no such file, and for a solution of another problem.
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"read_solution takes an OptimalControlProblem, got {problem!r}")
    if not isinstance(path, str | Path):
        raise FileError(f"read_solution takes the path of a file, got {path!r}")
    content = read_arrays(path, _FORMAT, "solution", "Solution.save")
    try:
        return _restored(path, problem, content)
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise FileError(f"{path}: an entry of the solution is missing or damaged: {error}") from None


def _restored(path: str | Path, problem: OptimalControlProblem, content: dict[str, np.ndarray]) -> Solution:
    settings = Settings(**json.loads(str(content["settings"])), options={}, progress=False)
    phases = [content[f"phase {k}"] for k in range(sum(name.startswith("phase ") for name in content))]
    mesh = Mesh(tuple(phases))
    if len(phases) != len(problem.waypoints) + 1:
        raise FileError(f"{path}: the solution has {len(phases) - 1} waypoints, the problem {len(problem.waypoints)}")
    program = Solver(problem, settings, None).layout(mesh)
    labels = [row.label for row in program.rows]
    theirs = content["row labels"].tolist()
    if program.size != content["x"].size or labels != theirs:
        other = next((f"'{a}' where the problem has '{b}'" for a, b in zip(theirs, labels, strict=False) if a != b), "")
        raise FileError(f"{path}: the solution belongs to another problem: {other or 'its size is another one'}")
    parameters = NumericEquations(problem.equations, content["parameters"])
    _check_values(path, program, parameters, mesh, content)
    statistics = json.loads(str(content["statistics"]))
    for name, kind in (("starts", Start), ("passes", Pass), ("steps", Step)):
        statistics[name] = [kind(**one) for one in statistics[name]]
    return Solution(
        problem,
        program,
        settings.plain,
        parameters,
        mesh,
        content["x"],
        content["marks"],
        float(content["cost"]),
        SolveStatistics(**statistics),
        Answer(content["lam_x"], content["lam_g"], content["rows"]),
    )


def _check_values(
    path: str | Path, program: MotionProgram, numeric: NumericEquations, mesh: Mesh, content: dict[str, np.ndarray]
) -> None:
    """Refuse a solution whose cost or rows are others in this problem."""
    low, high = program.problem.duration
    duration = float(content["marks"][-1])
    if not low * (1 - SAME) <= duration <= high * (1 + SAME):
        raise FileError(f"{path}: the solution takes {duration:g} s, the problem {low:g} … {high:g} s")
    data = program.data(numeric, mesh, content["marks"])
    cost, rows = program.program.evaluate()(content["x"] / program.scale, data)
    off = abs(float(cost) * program.cost_scale - float(content["cost"]))
    if off > SAME * (abs(float(content["cost"])) + program.cost_scale):
        raise FileError(f"{path}: the solution belongs to another problem: its cost there would differ by {off:.3g}")
    difference = np.abs(rows.full().ravel() - content["rows"])
    worst = int(np.argmax(difference))
    if difference[worst] > SAME:
        raise FileError(
            f"{path}: the solution belongs to another problem, which differs in: {program.rows[worst].label}"
        )
