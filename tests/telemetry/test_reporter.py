"""What is written when, in virtual time; the worker runs when the test says so."""

from __future__ import annotations

from itertools import pairwise

import pytest

from contextpolicy.telemetry.reporter import STATUS_DELAY, STATUS_INTERVAL, STATUS_RETRY
from tests.actuators.resize.fake_cluster import UNREACHABLE, refusal
from tests.actuators.resize.rig import MOMENT
from tests.telemetry.reporting import POLICY


def test_a_status_is_delayed_behind_its_plans_resizes(desk):
    desk.status(1)
    assert desk.worker.jobs == []
    desk.wait(1)
    assert desk.statuses == [(STATUS_DELAY, POLICY, 1)]


def test_the_newest_status_is_written_once_per_interval(desk):
    for n in range(100):
        desk.status(n)
        desk.wait(0.01)
    desk.wait(1)
    written = [n for _, _, n in desk.statuses]
    times = [at for at, _, _ in desk.statuses]
    assert written[-1] == 99
    assert all(after - before > STATUS_INTERVAL - 0.001 for before, after in pairwise(times))
    assert len(written) <= 1 / STATUS_INTERVAL + 2


def test_an_unchanged_status_is_not_written(desk):
    for n in (1, 1, 2, 1, 1):
        desk.status(n)
        desk.wait(3)
    assert [n for _, _, n in desk.statuses] == [1, 2, 1]


def test_a_refused_status_is_written_later(desk):
    desk.faults += [refusal("Invalid")]
    for _ in range(2):
        desk.status(1)
        desk.wait(3)
    assert [n for _, _, n in desk.statuses] == [1]


def test_a_status_is_made_when_it_is_written_not_when_it_is_announced(desk):
    desk.status(0)
    desk.wait(STATUS_DELAY + 0.05)
    facts = {"n": 1}
    desk.reporter.status(POLICY, lambda: dict(facts))
    facts["n"] = 2
    desk.wait(STATUS_INTERVAL + 0.1)
    assert [n for _, _, n in desk.statuses] == [0, 2]


def test_policies_do_not_wait_for_each_other(desk):
    desk.status(1)
    desk.status(2, "lab/other")
    desk.wait(STATUS_DELAY + 0.05)
    assert [policy for _, policy, _ in desk.statuses] == [POLICY, "lab/other"]


def test_a_status_that_could_not_be_written_is_written_later(desk):
    desk.faults += [UNREACHABLE, UNREACHABLE]
    desk.status(1)
    desk.wait(3 * STATUS_RETRY)
    [(at, _, n)] = desk.statuses
    assert n == 1
    assert at == pytest.approx(2 * STATUS_RETRY, abs=0.1)


def test_a_newer_status_takes_the_place_of_one_that_could_not_be_written(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.wait(0.5)
    desk.status(2)
    desk.wait(2 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [2]


def test_a_newer_status_during_a_failing_write_replaces_it(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.scheduler.advance_by(STATUS_DELAY + 0.01)
    desk.status(2)
    desk.wait(2 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [2]


@pytest.mark.parametrize("reason", ["NotFound", "Invalid", "Forbidden"])
def test_a_status_that_is_refused_is_given_up(desk, reason):
    desk.faults += [refusal(reason)]
    desk.status(1)
    desk.wait(5)
    assert desk.statuses == []
    desk.status(2)
    desk.wait(1)
    assert [n for _, _, n in desk.statuses] == [2]


def test_no_status_is_written_for_a_deleted_policy(desk):
    desk.status(1)
    desk.wait(STATUS_DELAY + 0.05)
    desk.status(2)
    desk.reporter.forget(POLICY)
    desk.wait(1)
    assert [n for _, _, n in desk.statuses] == [1]


def test_a_failed_status_of_a_deleted_policy_is_not_retried(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.reporter.forget(POLICY)
    desk.wait(5)
    assert desk.statuses == []


def test_a_policy_of_the_same_name_starts_over(desk):
    desk.faults += [UNREACHABLE]
    desk.status(1)
    desk.reporter.forget(POLICY)
    desk.status(2)
    desk.wait(5)
    assert [n for _, _, n in desk.statuses] == [2]


@pytest.mark.parametrize("running", [False, True], ids=["waits", "fails"])
def test_a_recreated_policy_does_not_wait_for_old_writes(desk, running):
    desk.faults += [UNREACHABLE] * running
    desk.status(1)
    desk.scheduler.advance_by((STATUS_DELAY + 0.01) * running)
    desk.reporter.forget(POLICY)
    desk.wait(1)
    desk.status(2)
    desk.wait(STATUS_DELAY + 0.05)
    assert [n for _, _, n in desk.statuses] == [2]


def test_equal_events_are_not_deduplicated(desk):
    for _ in range(2):
        desk.event("no tasks")
    desk.wait(0.1)
    assert desk.events == [("lab", "Invalid", "no tasks")] * 2


def test_an_unexpected_failure_is_retried_like_any_other(desk):
    desk.faults += [RuntimeError("token file is gone"), RuntimeError("still")]
    desk.status(1)
    desk.wait(3 * STATUS_RETRY)
    assert [n for _, _, n in desk.statuses] == [1]
    desk.faults += [RuntimeError("and again")]
    desk.event("a")
    desk.event("b")
    desk.wait(0.1)
    assert [message for _, _, message in desk.events] == ["b"]


def test_a_refused_event_does_not_block_the_status(desk):
    desk.faults += [refusal("Forbidden")]
    desk.event("a")
    desk.status(1)
    desk.wait(STATUS_DELAY + 0.05)
    assert [n for _, _, n in desk.statuses] == [1]


def test_closing_drops_what_waits(desk):
    desk.status(1)
    desk.reporter.close()
    desk.wait(MOMENT)
    assert (desk.statuses, desk.worker.ended) == ([], True)
