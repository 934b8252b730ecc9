"""What running tasks need and do not get."""

from __future__ import annotations

import pytest

from contextpolicy.policy.bandwidth import throttle_gap
from tests.planning.builders import Story, a_policy, a_task, on_node


def shortfalls(needs, other="1", **container):
    tasks = [a_task("slam", priority=1, needs=needs), a_task("rest", priority=float(other))]
    story = Story(a_policy(tasks=tasks), on_node("slam", "rest", cores=2, **container))
    return [shortfall.message for shortfall in story.last.shortfalls if shortfall.task == "slam"]


def test_enough_is_no_shortfall():
    assert shortfalls({"cores": 1, "memory": "100Mi", "deadline": "50ms"}) == []


def test_too_few_cores():
    assert shortfalls({"cores": 1}, other="3") == ["needs 1 cores, gets 500m"]


def test_too_little_memory_where_the_limit_is_known():
    assert shortfalls({"memory": "100Mi"}, memory=1 << 20) == ["needs 104857600 bytes of memory, its limit is 1048576"]
    assert shortfalls({"memory": "100Mi"}) == []


def test_a_deadline_shorter_than_the_throttle_gap():
    assert shortfalls({"deadline": "20ms"}, other="3") == [
        "needs results within 0.02 s, with 500m it may stand still for 0.05 s"
    ]


def test_a_suspended_task_needs_nothing():
    tasks = [a_task("slam", idle=0, needs={"cores": 2}), a_task("rest")]
    assert Story(a_policy(tasks=tasks)).last.shortfalls == ()


def test_a_request_that_keeps_a_suspended_task_running_is_told():
    tasks = [a_task("slam", idle=0), a_task("rest")]
    story = Story(a_policy(tasks=tasks), on_node("slam", "rest", cores=2, request=300))
    assert [(s.task, s.message) for s in story.last.shortfalls] == [
        ("slam", "is suspended but its CPU request of 300m keeps its limit at 300m")
    ]


@pytest.mark.parametrize(
    ("share", "gap"),
    [(1000, 0.0), (2000, 0.0), (250, 0.075), (10, 0.099)],
)
def test_the_throttle_gap_is_the_rest_of_the_period(share, gap):
    assert throttle_gap(share) == pytest.approx(gap)
