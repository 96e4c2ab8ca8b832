"""Rows of programs: what each says, of what and where, apart from the text for people."""

from motions import rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.limit_sides import LimitSides
from mbdcasadi.optimal_control.transcription.rows import BOUNDARY, FINAL, PATH, RowKind, RowName


def _program():
    problem, u, block = rest_to_rest(1.0, 1.0)
    power = mbd.positive_part(u * block.vx)
    problem = problem.replace(
        final=[block.x == 1], path=[block.vx <= 5], boundary=[mbd.at_end(block.vx) == 0], running_cost=u**2 + power
    )
    return mbd.optimize(problem, intervals=3).program


def test_kinds_owners_and_places():
    """Rows are told apart by what they are; labels are made of it."""
    rows = _program().rows
    names = dict.fromkeys(row.name for row in rows)
    assert RowName(RowKind.CONTINUITY, "block.x", PATH) in names
    assert RowName(RowKind.CONDITION, "block.vx <= 5", PATH) in names
    assert RowName(RowKind.CONDITION, "block.x == 1", FINAL) in names
    (boundary,) = [name for name in names if name.place == BOUNDARY]
    assert boundary.label == "boundary: at_end(block.vx) == 0"
    definitions = [row for row in rows if row.kind is RowKind.DEFINITION]
    assert definitions and not any(row.is_stated for row in definitions)
    assert RowName(RowKind.VELOCITY_CONTINUITY, "block.x", PATH).label == "continuity of the velocity of block.x"


def test_limits_by_their_places():
    """Limits of the path are limits; what is stated at a place counts as a condition."""
    program = _program()
    assert [name.owner for name in LimitSides(program).sides] == ["block.vx <= 5"]
    stated = {name.label for name in LimitSides(program, conditions=True).sides}
    assert stated == {"block.vx <= 5", "final: block.x == 1", "boundary: at_end(block.vx) == 0"}
