from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from prometheus_client import REGISTRY

from contextpolicy.actuators.resize.conflict import Conflict
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from contextpolicy.telemetry.resize_watch import ResizeWatch
from tests.actuators.resize.fake_cluster import refusal
from tests.cluster.builders import a_pod
from tests.planning.builders import a_plan as plan_of

POLICY = "lab/watched"


class Recorder:
    """A watch, and what it says."""

    def __init__(self):
        self.problems: list[tuple[str, str]] = []
        self.stages: list[tuple[str, str, float | None]] = []
        self.watch = ResizeWatch(self)

    def knows(self, _):
        return True

    def on_problem(self, _, reason, message):
        self.problems.append((reason, message))

    def on_stage(self, _, stage, container, cores, __):
        self.stages.append((stage, container, cores))


@pytest.fixture
def reported():
    return Recorder()


LABELS = dict(zip(("namespace", "name"), POLICY.split("/"), strict=True))


def held_back(message="node is full"):
    condition = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": message}
    return view(a_pod("slam", conditions=[condition]))


def a_plan(sequence, *, arrived=None, **shares):
    return plan_of(sequence, {f"lab/{name}/{name}": share for name, share in shares.items()}, arrived)


LEGS = ("sample_to_plan", "plan_to_patch", "patch_to_in_force", "reaction")


def count(leg, of="count"):
    return REGISTRY.get_sample_value(f"contextpolicy_{leg}_seconds_{of}", LABELS) or 0.0


def conflicts():
    return REGISTRY.get_sample_value("contextpolicy_conflicts_total", LABELS) or 0.0


def resizes(result):
    return REGISTRY.get_sample_value("contextpolicy_resizes_total", {**LABELS, "result": result}) or 0.0


@pytest.fixture
def clock(monkeypatch):
    """Monotonic time, as the test sets it."""
    now = SimpleNamespace(at=0.0)
    monkeypatch.setattr(time, "monotonic", lambda: now.at)
    return now


def test_each_leg_of_a_reaction_is_reported_and_measured(reported, clock):
    before = {leg: (count(leg), count(leg, of="sum")) for leg in LEGS}
    reported.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    reported.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 1.25)
    reported.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    clock.at = 4.0
    reported.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert reported.stages == [("accepted", "lab/slam/slam", 0.3), ("inForce", "lab/slam/slam", 0.3)]
    assert [count(leg) - before[leg][0] for leg in LEGS] == [1, 1, 1, 1]
    assert [count(leg, of="sum") - before[leg][1] for leg in LEGS] == pytest.approx([0.25, 1.25, 1.5, 3.0])
    assert reported.watch.recent(POLICY) == [3.0]


def test_an_agent_may_be_faster_than_the_answer_of_the_api(reported, clock):
    before = [count(leg) for leg in LEGS]
    reported.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    reported.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    clock.at = 2.0
    reported.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    reported.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    assert [count(leg) - n for leg, n in zip(LEGS, before, strict=True)] == [1, 1, 0, 1]


def test_reactions_of_a_deleted_policy_are_forgotten(reported):
    reported.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    reported.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    reported.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    reported.watch.forget(POLICY)
    assert reported.watch.recent(POLICY) == []


def test_a_resize_that_no_sample_asked_for_is_reported_and_not_measured(reported):
    """Another writer changes the limit an hour after the sample, and it is restored."""
    reported.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    reported.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    reported.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("vpa-updater", Cpu(100, 300), Cpu(100, 700)))
    before = [count(leg) for leg in LEGS]
    reported.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 3601.0)
    reported.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert [stage for stage, *_ in reported.stages] == ["accepted", "inForce"]
    assert [count(leg) for leg in LEGS] == before


def test_a_pod_that_replaces_another_of_its_name_reacts_to_no_earlier_sample(reported):
    """The plan stays the same, and so does the container's name in it."""
    reported.watch.planned(POLICY, a_plan(1, slam=500, speech=500), 1.0)
    reported.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300, speech=700), 2.0)
    before = [count(leg) for leg in LEGS]
    reported.watch.lose(view(a_pod("slam")))
    reported.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 3601.0)
    reported.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert [count(leg) for leg in LEGS] == before
    reported.watch.on_in_force(POLICY, "lab/speech/speech", 700)
    assert count("reaction") == before[-1] + 1


def test_a_plan_that_no_sample_made_is_not_measured(reported):
    before = count("sample_to_plan")
    reported.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    assert count("sample_to_plan") == before


def test_a_patch_without_any_plan_yet_is_not_measured(reported):
    before = count("plan_to_patch")
    reported.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(None, None), 2.5)
    assert (reported.stages, count("plan_to_patch")) == ([("accepted", "lab/slam/slam", 0.0)], before)


def test_a_failure_is_reported_once_and_its_end_too(reported):
    failures = resizes("Forbidden")
    for _ in range(3):
        reported.watch.on_problem(POLICY, "slam", refusal("Forbidden"))
    assert reported.problems == [("ResizeFailed", "slam: Forbidden: no")]
    assert reported.watch.problems(POLICY) == {"slam": "slam: Forbidden: no"}
    assert resizes("Forbidden") == failures + 3
    reported.watch.on_problem(POLICY, "slam", None)
    reported.watch.on_problem(POLICY, "slam", None)
    assert reported.problems[1:] == [("ResizeRecovered", "slam: updates succeed again")]
    assert reported.watch.problems(POLICY) == {}


def test_a_different_failure_of_the_same_pod_is_reported(reported):
    reported.watch.on_problem(POLICY, "slam", refusal("Forbidden"))
    reported.watch.on_problem(POLICY, "slam", refusal("Invalid"))
    assert [message for _, message in reported.problems] == ["slam: Forbidden: no", "slam: Invalid: no"]


def test_deferred_resizes_are_reported_to_their_policies(reported):
    for _ in range(2):
        reported.watch.observe(held_back(), {POLICY})
    [(reason, message)] = reported.problems
    assert reason == "ResizePending"
    assert message.startswith("slam: Deferred: node is full; its CPU request does not fit on the node")
    assert reported.watch.problems(POLICY) == {"lab/slam": message}
    assert reported.watch.problems("lab/other") == {}


def test_the_end_of_a_deferred_resize_is_reported(reported):
    reported.watch.observe(held_back(), {POLICY})
    for _ in range(2):
        reported.watch.observe(view(a_pod("slam")), {POLICY})
    assert reported.problems[1:] == [("ResizeRecovered", "slam: the kubelet no longer holds back a resize")]
    assert reported.watch.problems(POLICY) == {}


def test_a_resize_of_another_writer_that_is_held_back_is_ignored(reported):
    reported.watch.observe(held_back(), set())
    assert (reported.problems, reported.watch.problems(POLICY)) == ([], {})


def test_a_conflict_is_reported_with_writer_and_change(reported):
    before = conflicts()
    conflict = Conflict("vpa-updater", Cpu(100, 300), Cpu(150, 700))
    reported.watch.on_conflict(POLICY, "lab/slam/slam", conflict)
    [(reason, message)] = reported.problems
    assert reason == "ResizedByOther"
    assert message.startswith(
        "lab/slam/slam: vpa-updater changed its CPU limit from 300m to 700m, CPU request from 100m to 150m; "
        "the operator writes the plan's value again; set updateMode"
    )
    assert reported.watch.problems(POLICY) == {"lab/slam/slam": message}
    assert conflicts() == before + 1


def test_a_repeated_conflict_is_counted_but_reported_once(reported):
    before = conflicts()
    for _ in range(3):
        reported.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    assert len(reported.problems) == 1
    assert conflicts() == before + 3
    reported.watch.on_conflict(POLICY, "lab/slam/slam", None)
    reported.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    assert [reason for reason, _ in reported.problems] == ["ResizedByOther", "ResizeRecovered", "ResizedByOther"]


def test_a_resolved_conflict_is_no_longer_a_problem(reported):
    reported.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(None, 300), Cpu(None, None)))
    for _ in range(2):
        reported.watch.on_conflict(POLICY, "lab/slam/slam", None)
    assert [reason for reason, _ in reported.problems] == ["ResizedByOther", "ResizeRecovered"]
    assert "another writer changed its CPU limit from 300m to none" in reported.problems[0][1]
    assert reported.watch.problems(POLICY) == {}


def test_problems_of_a_removed_pod_are_cleared(reported):
    reported.watch.on_problem(POLICY, "slam", refusal())
    reported.watch.on_problem("elsewhere/other", "slam", refusal())
    reported.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    reported.watch.observe(held_back(), {POLICY})
    reported.watch.lose(held_back())
    assert reported.watch.problems(POLICY) == {}
    assert reported.watch.problems("elsewhere/other") == {"slam": "slam: Invalid: no"}


def test_problems_of_a_deleted_policy_are_cleared(reported):
    reported.watch.on_problem(POLICY, "slam", refusal())
    reported.watch.forget(POLICY)
    assert reported.watch.problems(POLICY) == {}


def test_a_yielded_conflict_is_reported_once_more(reported):
    conflict = Conflict("vpa-updater", Cpu(100, 300), Cpu(100, 700))
    for one in (conflict, conflict, replace(conflict, yielded=True), replace(conflict, yielded=True)):
        reported.watch.on_conflict(POLICY, "lab/slam/slam", one)
    [first, last] = reported.problems
    assert "the operator writes the plan's value again" in first[1]
    assert (
        "as this keeps happening, the operator leaves the change in place and retries the plan's value every 10 min"
        in last[1]
    )
