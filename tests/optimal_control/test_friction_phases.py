"""Phases of an order of modes: what cannot be in one is left out."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.friction.pattern import Piece
from mbdcasadi.optimal_control.friction.phases import PhaseMaker
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.search.first_mesh import first_meshes
from mbdcasadi.optimal_control.search.given_guess import read_guess
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver


def maker_of(*, driven):
    """Phases of two blocks that touch; a force moves the first, or a driver at 1 m/s."""
    force = mbd.Input("force")
    first, second = (mbd.Body(name, mass=1, inertia=1, pose=(x, 0, 0)) for name, x in (("first", 0), ("second", 0.2)))
    rails = [mbd.Translational(f"rail of {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (first, second)]
    law = mbd.DryFriction(0.3)
    rubs = [mbd.JointFriction(f"rub of {rail.name}", rail, law) for rail in rails[driven:]]
    touch = mbd.RigidContact("touch", mbd.Circle(second.at(0, 0), 0.2), mbd.HalfPlane(first.at(0, 0, angle=-np.pi / 2)))
    push = mbd.Force("push", (second if driven else first).at(0, 0), (force, 0))
    model = mbd.Mechanism(
        [first, second], rails, forces=[mbd.Gravity(), push, *rubs, touch], inputs=[force],
        drivers=[mbd.Driver("drive", rails[0].displacement, mbd.t)] if driven else [],
    )  # fmt: skip
    problem = mbd.OptimalControlProblem(model, 1.0, running_cost=force**2, final=[second.x == 1.2])
    relaxed, relaxation = problem.relaxed
    settings = Settings.read("gauss-legendre", 3, "polynomial", None, False)
    solver = ProblemSolver(relaxed, settings, {relaxation.share: 1.0})
    guess = read_guess(solver, {first.x: [0, 1], second.x: [0.2, 1.2]})
    return PhaseMaker(problem, relaxation, solver.unsolved(first_meshes(solver.setups, 4), guess))


@pytest.mark.slow
def test_what_slides_into_a_block_at_rest_is_left_out():
    """Only a block that slides away from one that stands still, or both, can be."""
    maker, both, open_ = maker_of(driven=False), ("forth", "forth", "closed"), ("sticks", "forth", "open")
    pieces = [Piece(0.0, 0.4, both), Piece(0.4, 0.5, ("sticks", "forth", "closed")), Piece(0.5, 1.0, open_)]
    found = maker.possible(pieces)
    assert [(piece.begin, piece.end, piece.senses) for piece in found] == [(0, 0.5, both), (0.5, 1.0, open_)]
    assert maker.possible(pieces[1:2]) == pieces[1:2]

    # at rest a contact neither opens nor closes
    rest = "sticks", "sticks"
    for before, modes in ((both, "closed"), (("forth", "sticks", "open"), "open")):
        pieces = [Piece(0.0, 0.5, before), Piece(0.5, 0.8, (*rest, "closed")), Piece(0.8, 1.0, (*rest, "open"))]
        found = maker.possible(pieces)
        assert [(piece.begin, piece.end, piece.senses) for piece in found] == [
            (0, 0.5, before),
            (0.5, 1, (*rest, modes)),
        ]


@pytest.mark.slow
@pytest.mark.parametrize(("sense", "count"), [("forth", 2), ("back", 1)])
def test_what_a_driver_moves_slides_in_its_sense(sense, count):
    """A block that touches a driven one has its speed, which is not zero."""
    pieces = [Piece(0.0, 0.5, ("forth", "open")), Piece(0.5, 1.0, (sense, "closed"))]
    assert len(maker_of(driven=True).possible(pieces)) == count
