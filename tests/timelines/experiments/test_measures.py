"""What the measures say of runs whose every time is known."""

from __future__ import annotations

import pytest

from tests.timelines.experiments.synthetic import write_run
from timelines.experiments import measures
from timelines.experiments.measures import Fate
from timelines.experiments.raw_data import read_run

FAST, SLOW = {"slam": 0.05, "speech": 0.01}, {"slam": 0.2, "speech": 0.01}


@pytest.fixture
def run(tmp_path):
    def made(name="a", **options):
        folder = tmp_path / name
        folder.mkdir()
        return read_run(write_run(folder, "cfs-ca", "CFS CA", **options))

    return made


def test_the_clock_runs_until_the_last_input_is_done(run):
    assert measures.total_time(run(service=SLOW)) == pytest.approx(2.0)  # ten times 0.2 s


def test_a_run_takes_no_less_than_its_inputs(run):
    assert measures.total_time(run(service=FAST)) == pytest.approx(1.0)


def test_response_and_misses_by_what_the_robot_does(run):
    found = run(service=SLOW)
    standing, moving = (measures.response(found, "slam", moving=moving) for moving in (False, True))
    # Input i is published at i/10 and done at (i + 1)/5: all are later than 100 ms.
    assert (standing.due, standing.missed, moving.due, moving.misses) == (5, 5, 5, 1.0)
    assert standing.p50 == pytest.approx(0.4)
    assert moving.p99 == pytest.approx(1.1)
    assert measures.response(found, "speech").missed == 0


def test_inputs_during_a_suspension_are_counted_separately(run):
    skipped = [("speech", index) for index in (3, 4, 5, 6)]  # 3 waits at 0.35 s, 7 comes after 0.65 s
    plans = [(-1.0, (), 1.0), (0.35, ("speech",), 1.5), (0.65, (), 1.0)]
    found = run(service=FAST, skipped=skipped, plans=plans)
    assert measures.counts(found, "speech") == {
        Fate.PROCESSED: 6,
        Fate.SUSPENDED: 4,
        Fate.UNFINISHED: 0,
        Fate.LOST: 0,
    }
    assert measures.response(found, "speech").due == 6


def test_an_input_lost_without_suspension_is_a_miss(run):
    found = run(service=FAST, skipped=[("slam", 2)])
    assert measures.counts(found, "slam")[Fate.LOST] == 1
    assert (measures.response(found, "slam").due, measures.response(found, "slam").missed) == (10, 1)


def test_inputs_waiting_at_an_abort_are_unfinished(run):
    found = run(service=FAST, skipped=[("slam", 8), ("slam", 9)], drained=False)
    assert measures.counts(found, "slam")[Fate.UNFINISHED] == 2


def test_equal_work_counts_only_inputs_done_in_both_runs(run):
    everything = run("b", service=SLOW)
    half = run("c", service=SLOW, skipped=[("slam", index) for index in range(5, 10)])
    assert measures.equal_work(everything, half) == pytest.approx((1.0, 1.0))
    assert measures.total_time(everything) == pytest.approx(2.0)


def test_reaction_contexts_and_cpu(run):
    found = run(service=FAST, plans=[(-1.0, (), 1.0), (0.3, ("speech",), 1.5), (0.8, (), 1.0)])
    assert measures.reactions(found) == pytest.approx([0.05, 0.05])
    [(context, start, end)] = measures.contexts(found)
    assert context == "moving"
    assert (start, end) == pytest.approx((0.3, 0.8))
    assert measures.cpu_seconds(found, "slam") == pytest.approx(0.8)
    assert measures.cpu_of_others(found, ["slam", "speech"]) == pytest.approx(3.0 - 2 * 0.8)
    assert [cores for _, cores in measures.cores_used(found, "slam")] == pytest.approx([0.4] * 4)


def test_without_a_policy_there_is_no_reaction(run):
    found = run(service=FAST)
    assert (measures.reactions(found), measures.contexts(found), measures.suspensions(found, "slam")) == ([], [], [])
