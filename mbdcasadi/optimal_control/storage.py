"""Solutions in files: one NumPy file without pickle."""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import FileError
from ..results.writing import whole_file
from .mesh import Mesh
from .problem import OptimalControlProblem
from .solution import Pass, Solution, SolveStatistics, Start

if TYPE_CHECKING:
    from .solver import Solver

_FORMAT = "mbdcasadi solution 1"


def save(solution: Solution, path: str | Path) -> None:
    """Write a solution; see :func:`read_solution`."""
    program = solution.program
    content: dict[str, Any] = {
        "format": _FORMAT,
        "settings": json.dumps(solution.settings),
        "statistics": json.dumps(asdict(solution.statistics)),
        "cost": solution.cost,
        "x": solution._x,
        "marks": solution.marks,
        "parameters": solution.numeric.p,
        "lam_x": solution.multipliers[0],
        "lam_g": solution.multipliers[1],
        "row labels": np.array([row[0] for row in program.rows], dtype=str),
    }
    content |= {f"phase {k}": shares for k, shares in enumerate(solution.shares.phases)}
    with whole_file(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, allow_pickle=False, **content)


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
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except (OSError, ValueError, zipfile.BadZipFile) as error:
        raise FileError(f"{path}: cannot be read as a solution: {error}") from None
    if str(content.get("format")) != _FORMAT:
        raise FileError(f"{path}: no solution that this package wrote")
    return _restored(path, problem, content)


def _restored(path: str | Path, problem: OptimalControlProblem, content: dict[str, np.ndarray]) -> Solution:
    from .preparation import Settings
    from .solver import Solver

    settings = Settings(**json.loads(str(content["settings"])), options={}, progress=False)
    phases = [content[f"phase {k}"] for k in range(sum(name.startswith("phase ") for name in content))]
    mesh = Mesh(tuple(phases))
    if len(phases) != len(problem.waypoints) + 1:
        raise FileError(f"{path}: the solution has {len(phases) - 1} waypoints, the problem {len(problem.waypoints)}")
    solver: Solver = Solver(problem, settings, None)
    program = solver.layout(mesh)
    labels = [row[0] for row in program.rows]
    theirs = content["row labels"].tolist()
    if program.size != content["x"].size or labels != theirs:
        other = next((f"'{a}' where the problem has '{b}'" for a, b in zip(theirs, labels, strict=False) if a != b), "")
        raise FileError(f"{path}: the solution belongs to another problem: {other or 'its size is another one'}")
    statistics = json.loads(str(content["statistics"]))
    statistics["starts"] = [Start(**start) for start in statistics["starts"]]
    statistics["passes"] = [Pass(**one) for one in statistics["passes"]]
    return Solution(
        problem,
        program,
        settings.plain,
        NumericEquations(problem.equations, content["parameters"]),
        mesh,
        content["x"],
        content["marks"],
        float(content["cost"]),
        SolveStatistics(**statistics),
        (content["lam_x"], content["lam_g"]),
    )
