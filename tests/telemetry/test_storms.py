"""Constant changes: when a status is written, and when it is built."""

from __future__ import annotations

from itertools import pairwise

import pytest

from contextpolicy.telemetry.reporter import STATUS_DELAY, STATUS_INTERVAL, STATUS_RETRY
from contextpolicy.telemetry.status_budget import BURST, FOR_CONTEXTS, REFILL
from tests.actuators.resize.fake_cluster import UNREACHABLE


@pytest.mark.parametrize("contexts", [("-",), ("moving", "reading")])
def test_constantly_changing_statuses_are_written_at_the_refill_rate(desk, contexts):
    desk.storm(300, contexts=contexts)
    assert len(desk.statuses) <= BURST + 300 / REFILL
    times = [at for at, _, _ in desk.statuses]
    assert max(after - before for before, after in pairwise(times)) <= REFILL + 2 * STATUS_INTERVAL


def test_the_last_of_a_storm_is_written(desk):
    desk.storm(120)
    desk.wait(REFILL)
    written = len(desk.statuses)
    assert desk.statuses[-1][2] == 120 * 8 - 1
    desk.wait(5 * REFILL)
    assert len(desk.statuses) == written


def test_a_waiting_status_is_built_when_due(desk):
    for n in range(BURST - FOR_CONTEXTS):
        desk.status(n)
        desk.wait(STATUS_INTERVAL + STATUS_DELAY + 0.1)
    before = desk.made
    desk.status(-1)
    desk.wait(REFILL + 1)
    assert desk.statuses[-1][2] == -1
    assert desk.made == before + 2


def test_in_a_storm_statuses_are_made_once_a_second(desk):
    desk.storm(60)
    before, began = desk.made, desk.now()
    desk.storm(60)
    assert desk.made - before <= (desk.now() - began) / STATUS_INTERVAL + 1


def test_a_condition_does_not_wait_for_a_storm_to_end(desk):
    desk.storm(120, contexts=("moving", "reading"))
    desk.status(-1, ready="False")
    desk.wait(STATUS_DELAY + STATUS_INTERVAL + 0.1)
    assert desk.statuses[-1][2] == -1


def test_a_context_does_not_wait_for_weights_that_move_with_every_sample(desk):
    desk.storm(120)
    desk.status(-1, contexts="moving")
    desk.wait(STATUS_DELAY + STATUS_INTERVAL + 0.1)
    assert desk.statuses[-1][2] == -1


def test_conditions_that_flap_are_bounded_too(desk):
    for turn in range(300):
        desk.status(turn, ready=str(turn % 2 == 0))
        desk.wait(1)
    assert len(desk.statuses) <= BURST + 300 / REFILL


def test_after_a_quiet_time_a_status_is_written_at_once(desk):
    desk.storm(120)
    desk.wait((BURST + 1) * REFILL)
    desk.status(-1)
    desk.wait(STATUS_DELAY + 0.05)
    assert desk.statuses[-1][2] == -1


def test_failed_writes_do_not_use_the_budget(desk):
    desk.faults += [UNREACHABLE] * 2 * BURST
    desk.status(1)
    desk.wait(2 * BURST * STATUS_RETRY + 1)
    assert [n for _, _, n in desk.statuses] == [1]
