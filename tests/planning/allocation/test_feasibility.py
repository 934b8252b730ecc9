"""Needs of running tasks that are not met."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.policy.bandwidth import throttle_gap
from tests.planning.builders import Story, a_policy, a_task, on_node


def shortfalls(needs, other="1", **container):
    tasks = [a_task("slam", priority=1, needs=needs), a_task("rest", priority=float(other))]
    story = Story(a_policy(tasks=tasks), on_node("slam", "rest", cores=2, **container))
    return [shortfall.message for shortfall in story.last.shortfalls if shortfall.task == "slam"]


def test_met_needs_are_not_reported():
    assert shortfalls({"cores": 1, "memory": "100Mi", "deadline": "50ms"}) == []


def test_too_little_memory_where_the_limit_is_known():
    [reported] = shortfalls({"memory": "100Mi"}, memory=1 << 20)
    assert reported == "needs 104857600 bytes of memory, but its limit is 1048576"
    assert shortfalls({"memory": "1Mi"}, memory=1 << 20) == []
    assert shortfalls({"memory": "100Mi"}) == []


def test_a_deadline_shorter_than_the_throttle_gap():
    assert shortfalls({"deadline": "20ms"}, other="3") == [
        "needs results within 0.02 s, but with 500m it may stall for 0.05 s"
    ]


def test_a_deadline_as_long_as_the_throttle_gap_is_met():
    assert shortfalls({"deadline": "50ms"}, other="3") == []


def test_a_suspended_task_needs_nothing():
    tasks = [a_task("slam", idle=0, needs={"cores": 2}), a_task("rest")]
    assert Story(a_policy(tasks=tasks)).last.shortfalls == ()


def test_needs_are_not_checked_without_a_plan():
    tasks = [a_task("slam", needs={"cores": 2}), a_task("rest")]
    [shortfall] = Story(a_policy(tasks=tasks), on_node("slam", "rest", cores=0.01)).last.shortfalls
    assert shortfall.message.startswith("node robot keeps its last plan")


@pytest.mark.parametrize("control", ["Limit", "Suspend"])
def test_a_request_that_keeps_a_suspended_task_running_is_reported(control):
    tasks = [a_task("slam", idle=0), a_task("rest")]
    policy = a_policy(tasks=tasks, enforcement={"control": control})
    story = Story(policy, on_node("slam", "rest", cores=2, request=300))
    assert [(s.task, s.message) for s in story.last.shortfalls] == [
        ("slam", "is suspended but its CPU request of 300m keeps its limit at 300m")
    ]


@pytest.mark.parametrize(
    ("share", "gap"),
    [(1000, 0.0), (2000, 0.0), (250, 0.075), (10, 0.099)],
)
def test_the_throttle_gap_is_the_rest_of_the_period(share, gap):
    assert throttle_gap(share) == pytest.approx(gap)


class TestRealtime:
    """Cores are cores under both schedulers: of four processors each gives a part of its period."""

    def story(self, slam, **enforcement):
        tasks = [a_task("slam", **slam), a_task("rest", priority=9)]
        policy = a_policy(tasks=tasks, enforcement={"scheduler": "Realtime", **enforcement})
        return Story(policy, on_node("slam", "rest", cores=4))

    def test_a_min_of_two_of_four_cores_is_half_of_each_period(self):
        assert self.story({"min": 2}).shares() == {"slam": 2000, "rest": 1800}

    def test_a_max_of_two_of_four_cores_is_half_of_each_period(self):
        assert self.story({"max": 2, "priority": 99}).shares() == {"slam": 2000, "rest": 1800}

    def test_needs_are_cores_too(self):
        assert self.story({"min": 2, "needs": {"cores": 2}}).last.shortfalls == ()
        [shortfall] = self.story({"min": 1, "needs": {"cores": 2}}).last.shortfalls
        assert shortfall.message == "needs 2 cores, but gets 1"

    def test_the_budget_counts_processors_not_allocatable_cpu(self):
        placement = replace(on_node("slam", "rest", cores=3.8), processors={"robot": 4})
        policy = a_policy(
            tasks=[a_task("slam", min=2), a_task("rest", priority=9)], enforcement={"scheduler": "Realtime"}
        )
        assert Story(policy, placement).shares() == {"slam": 2000, "rest": 1800}

    @pytest.mark.parametrize(("period", "gap"), [("1s", "0.5"), ("10ms", None), (None, "0.05")])
    def test_the_period_decides_for_how_long_a_task_may_stand_still(self, period, gap):
        story = self.story({"min": 2, "needs": {"deadline": "20ms"}}, **({"period": period} if period else {}))
        wanted = f"needs results within 0.02 s, but with 2000m it may stall for {gap} s"
        assert [s.message for s in story.last.shortfalls] == ([wanted] if gap else [])


@pytest.mark.parametrize(("found", "gap"), [({"robot": 0.02}, None), ({"elsewhere": 0.02}, "0.2"), ({}, "0.2")])
def test_cfs_uses_the_kubelets_period_if_known(found, gap):
    policy = a_policy(
        tasks=[a_task("slam", needs={"deadline": "30ms"}), a_task("rest")], enforcement={"period": "400ms"}
    )
    story = Story(policy, replace(on_node("slam", "rest"), quota_periods=found))
    wanted = f"needs results within 0.03 s, but with 500m it may stall for {gap} s"
    assert [s.message for s in story.last.shortfalls] == ([wanted] if gap else [])
