"""Policies of a run, asked by a run that is given."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mbdcasadi.integrators.compiled import IntegrationFailure
from mbdcasadi.simulation.path import Path
from mbdcasadi.simulation.policies import LOOKS, AcrossFolds, MeetLoads, UpToTouches, Way
from mbdcasadi.simulation.schedule import Piece
from mbdcasadi.simulation.stepping.compiled_stepper import NearSingularPose

FAILURE = IntegrationFailure("IDA_ERR_FAIL", np.zeros((0, 2)), np.zeros((0, 0)))


class Given:
    """A run that goes on by the ways that are given, in order, and keeps what it is asked."""

    def __init__(self, *ways):
        self.ways, self.asked, self.stops = list(ways), [], []

    def integrated(self, piece, *, stopped=None):
        self.asked.append((float(piece.times[-1]), stopped))
        return self.ways.pop(0) if self.ways else way_to(float(piece.times[-1]))

    def stop_at(self, *times):
        self.stops += [float(time) for part in times for time in part]

    def smooth_until(self, time):
        return 10.0


def way_to(end, failure=None):
    """The way of a motion at rest from 0 s, with an output each second and at its end."""
    times = np.append(np.arange(1.0, end), end)
    every = np.r_[0.0, times]
    piece = Piece(0.0, times, np.ones(times.size, bool), np.zeros(times.size, bool))
    return Way(piece, Path(every, np.zeros((every.size, 2)), np.zeros((times.size, 0))), failure)


def test_a_pose_in_which_the_form_fails_is_met_by_other_means_if_there_is_no_passage():
    near, run = NearSingularPose(FAILURE), Given(way_to(4.0))
    way = AcrossFolds(lambda path, smooth_until: None).followed(way_to(2.0, near), run)
    assert run.asked == [(2.0, near)] and way.path.times[-1] == 4.0 and not way.is_decided


def test_a_passage_decides():
    passages = iter([None, "passage"])
    way = AcrossFolds(lambda path, until: next(passages)).followed(way_to(2.0, NearSingularPose(FAILURE)), Given())
    assert way.passage == "passage" and way.is_decided


def test_a_piece_ends_at_the_first_contact_and_is_looked_at_again():
    touches = iter([(3.0, np.array([2.5])), (1.0, np.zeros(0)), None])
    run = Given()
    way = UpToTouches(SimpleNamespace(first_touch=lambda path: next(touches))).followed(way_to(4.0), run)
    assert way.piece.times[-1] == 1.0 and run.stops == [3.0, 2.5, 1.0]


def test_a_contact_at_the_start_leads_no_further():
    run = Given()
    way = UpToTouches(SimpleNamespace(first_touch=lambda path: (1e-9, np.zeros(0)))).followed(way_to(4.0), run)
    assert way.piece.times[-1] == 4.0 and not run.asked


@pytest.mark.parametrize(("interval", "end"), [(2, 2.0), (0, 4.0)])
def test_a_load_ends_a_piece_before_it_or_is_gone_across(interval, end):
    """Outputs up to it are kept; from its start on the way is integrated again, from stop to stop."""
    load = SimpleNamespace(interval=interval, stops=np.array([0.3, 0.6] if not interval else [2.3, 2.6]))
    loads = iter([load, None])
    run = Given(way_to(4.0))
    way = MeetLoads(SimpleNamespace(first=lambda path: next(loads))).followed(way_to(4.0), run)
    assert way.piece.times[-1] == end and run.stops[-2:] == load.stops.tolist()
    assert [asked for asked, _ in run.asked] == ([] if interval else [0.3])


def test_loads_are_left_after_some_looks_and_after_a_failure():
    load = SimpleNamespace(interval=0, stops=np.array([0.3, 0.6]))
    policy = MeetLoads(SimpleNamespace(first=lambda path: load))
    run = Given()
    policy.followed(way_to(4.0), run)
    assert len(run.asked) == LOOKS
    run = Given(way_to(4.0, FAILURE))
    assert policy.followed(way_to(4.0), run).is_decided and len(run.asked) == 1
