"""How many intervals each phase has."""

import re

import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def push_touch_slide():
    """A block that is pushed, comes to an instant, and slides on."""
    problem, u, block = rest_to_rest()
    sliding = problem.mechanism.replace(forces=[], inputs=[])
    push = mbd.Phase("push", problem.mechanism, 1.0, [block.x == 0, block.vx == 0], running_cost=u**2)
    slide = mbd.Phase("slide", sliding, 0.5, final=[block.x == 1], waypoints=[mbd.Waypoint(0.2)])
    return mbd.OptimalControlProblem(phases=[push, mbd.Phase("touch", sliding, 0), slide]), push


def test_one_number_for_each_phase():
    """In the order of those that last, by name, by the phase, or one for all."""
    problem, push = push_touch_slide()
    for intervals, counts in (([4, 6], (4, 6)), ({"slide": 5, push: 3}, (3, 5)), (6, (6, 6)), ("auto", (40, 40))):
        solution = mbd.optimize(problem, intervals=intervals)
        assert [mesh.count for mesh in solution.meshes] == [counts[0], 0, counts[1]]
        # with x + v / 2 = 1 at the end of the push: 1 / ∫ (3/2 - t)² dt
        assert solution.cost == pytest.approx(12 / 13, rel=1e-6)


@pytest.mark.parametrize(
    "wrong, words",
    [
        ([4], "has 1 numbers for the phases that last, 'push', 'slide'"),
        ([4, 4, 4], "has 3 numbers"),
        ({"push": 4}, "takes a number for each of the phases 'push', 'slide', got {'push': 4}"),
        ({"push": 4, "slide": 4, "fly": 4}, "takes a number for each of the phases"),
        ([4, 3], "at least 4 with 1 waypoints in phase 'slide', got 3"),
        (["auto", 4], "at least 2 in phase 'push', got 'auto'"),
        (4.5, "at least 2 in phase 'push', got 4.5"),
        ("many", "got 'many'"),
        (None, "got None"),
    ],
)
def test_what_is_no_number_for_each_phase(wrong, words):
    with pytest.raises(mbd.ModelError, match="intervals.*" + re.escape(words)):
        mbd.optimize(push_touch_slide()[0], intervals=wrong)
