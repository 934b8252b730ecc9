from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace

import pytest
from prometheus_client import REGISTRY

from contextpolicy.actuators.resize.conflict import Conflict
from contextpolicy.cluster.pods import Cpu, view
from contextpolicy.telemetry.resize_watch import ResizeWatch
from tests.actuators.resize.fake_cluster import refusal
from tests.cluster.builders import a_pod
from tests.planning.builders import a_plan as plan_of

POLICY = "lab/watched"


class Told:
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
def told():
    return Told()


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


def test_each_leg_of_a_reaction_is_told_and_measured(told, clock):
    before = {leg: (count(leg), count(leg, of="sum")) for leg in LEGS}
    told.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    told.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 1.25)
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    clock.at = 4.0
    told.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert told.stages == [("accepted", "lab/slam/slam", 0.3), ("inForce", "lab/slam/slam", 0.3)]
    assert [count(leg) - before[leg][0] for leg in LEGS] == [1, 1, 1, 1]
    assert [count(leg, of="sum") - before[leg][1] for leg in LEGS] == pytest.approx([0.25, 1.25, 1.5, 3.0])
    assert told.watch.recent(POLICY) == [3.0]


def test_an_agent_may_be_faster_than_the_answer_of_the_api(told, clock):
    before = [count(leg) for leg in LEGS]
    told.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    told.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    clock.at = 2.0
    told.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    assert [count(leg) - n for leg, n in zip(LEGS, before, strict=True)] == [1, 1, 0, 1]


def test_a_policy_that_is_gone_leaves_no_reactions(told):
    told.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    told.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    told.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    told.watch.forget(POLICY)
    assert told.watch.recent(POLICY) == []


def test_a_resize_that_no_sample_asked_for_is_told_and_not_measured(told):
    """An hour after the sample somebody changes the limit, and it is put back."""
    told.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    told.watch.planned(POLICY, a_plan(2, arrived=1.0, slam=300), 2.0)
    told.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("vpa-updater", Cpu(100, 300), Cpu(100, 700)))
    before = [count(leg) for leg in LEGS]
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 3601.0)
    told.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert [stage for stage, *_ in told.stages] == ["accepted", "inForce"]
    assert [count(leg) for leg in LEGS] == before


def test_a_plan_that_no_sample_made_is_not_measured(told):
    before = count("sample_to_plan")
    told.watch.planned(POLICY, a_plan(1, slam=500), 1.0)
    assert count("sample_to_plan") == before


def test_a_patch_without_any_plan_yet_is_not_measured(told):
    before = count("plan_to_patch")
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(None, None), 2.5)
    assert (told.stages, count("plan_to_patch")) == ([("accepted", "lab/slam/slam", 0.0)], before)


def test_a_failure_is_told_once_and_its_end_too(told):
    failures = resizes("Forbidden")
    for _ in range(3):
        told.watch.on_problem(POLICY, "slam", refusal("Forbidden"))
    assert told.problems == [("ResizeFailed", "slam: Forbidden: no")]
    assert told.watch.problems(POLICY) == {"slam": "slam: Forbidden: no"}
    assert resizes("Forbidden") == failures + 3
    told.watch.on_problem(POLICY, "slam", None)
    told.watch.on_problem(POLICY, "slam", None)
    assert told.problems[1:] == [("ResizeRecovered", "slam can be resized again")]
    assert told.watch.problems(POLICY) == {}


def test_another_failure_of_the_same_pod_is_news(told):
    told.watch.on_problem(POLICY, "slam", refusal("Forbidden"))
    told.watch.on_problem(POLICY, "slam", refusal("Invalid"))
    assert [message for _, message in told.problems] == ["slam: Forbidden: no", "slam: Invalid: no"]


def test_what_the_kubelet_holds_back_is_told_to_the_policies_that_asked_for_it(told):
    for _ in range(2):
        told.watch.observe(held_back(), {POLICY})
    [(reason, message)] = told.problems
    assert reason == "ResizePending"
    assert message.startswith("slam: Deferred: node is full; its CPU request doesn't fit beside the node's other pods")
    assert told.watch.problems(POLICY) == {"lab/slam": message}
    assert told.watch.problems("lab/other") == {}


def test_what_the_kubelet_holds_back_no_more_is_told_too(told):
    told.watch.observe(held_back(), {POLICY})
    for _ in range(2):
        told.watch.observe(view(a_pod("slam")), {POLICY})
    assert told.problems[1:] == [("ResizeRecovered", "slam: no resize is held back any more")]
    assert told.watch.problems(POLICY) == {}


def test_a_resize_of_somebody_else_that_is_held_back_is_no_news(told):
    told.watch.observe(held_back(), set())
    assert (told.problems, told.watch.problems(POLICY)) == ([], {})


def test_a_contest_is_told_with_who_did_what(told):
    before = conflicts()
    conflict = Conflict("vpa-updater", Cpu(100, 300), Cpu(150, 700))
    told.watch.on_conflict(POLICY, "lab/slam/slam", conflict)
    [(reason, message)] = told.problems
    assert reason == "ResizedByOther"
    assert message.startswith(
        "lab/slam/slam: vpa-updater changed its CPU limit from 300m to 700m, CPU request from 100m to 150m; "
        "it gets what the plan says again; set updateMode"
    )
    assert told.watch.problems(POLICY) == {"lab/slam/slam": message}
    assert conflicts() == before + 1


def test_a_writer_who_does_the_same_again_is_counted_and_told_once(told):
    before = conflicts()
    for _ in range(3):
        told.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    assert len(told.problems) == 1
    assert conflicts() == before + 3
    told.watch.on_conflict(POLICY, "lab/slam/slam", None)
    told.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    assert [reason for reason, _ in told.problems] == ["ResizedByOther", "ResizeRecovered", "ResizedByOther"]


def test_a_contest_that_is_over_is_no_problem_any_more(told):
    told.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(None, 300), Cpu(None, None)))
    for _ in range(2):
        told.watch.on_conflict(POLICY, "lab/slam/slam", None)
    assert [reason for reason, _ in told.problems] == ["ResizedByOther", "ResizeRecovered"]
    assert "somebody changed its CPU limit from 300m to none" in told.problems[0][1]
    assert told.watch.problems(POLICY) == {}


def test_a_pod_takes_its_problems_along(told):
    told.watch.on_problem(POLICY, "slam", refusal())
    told.watch.on_problem("elsewhere/other", "slam", refusal())
    told.watch.on_conflict(POLICY, "lab/slam/slam", Conflict("", Cpu(100, 300), Cpu(100, 700)))
    told.watch.observe(held_back(), {POLICY})
    told.watch.lose(held_back())
    assert told.watch.problems(POLICY) == {}
    assert told.watch.problems("elsewhere/other") == {"slam": "slam: Invalid: no"}


def test_a_policy_takes_its_problems_along(told):
    told.watch.on_problem(POLICY, "slam", refusal())
    told.watch.forget(POLICY)
    assert told.watch.problems(POLICY) == {}


def test_a_contest_that_we_yield_is_told_once_more(told):
    conflict = Conflict("vpa-updater", Cpu(100, 300), Cpu(100, 700))
    for one in (conflict, conflict, replace(conflict, yielded=True), replace(conflict, yielded=True)):
        told.watch.on_conflict(POLICY, "lab/slam/slam", one)
    [first, last] = told.problems
    assert "it gets what the plan says again" in first[1]
    assert "that goes on, so it is left like that, and the plan's value tried again every 10 min" in last[1]
