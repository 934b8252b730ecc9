from __future__ import annotations

import pytest
from prometheus_client import REGISTRY

from contextpolicy.cluster.pods import Cpu, view
from contextpolicy.telemetry.resizing import ResizeWatch
from tests.actuators.fake_cluster import refusal
from tests.api.builders import a_pod

POLICY = "lab/watched"


class Told:
    """A watch, and what it says."""

    def __init__(self):
        self.problems, self.stages = [], []
        self.watch = ResizeWatch(
            lambda _, reason, message: self.problems.append((reason, message)),
            lambda _, stage, container, cores, __: self.stages.append((stage, container, cores)),
        )


@pytest.fixture
def told():
    return Told()


def held_back(message="node is full"):
    condition = {"type": "PodResizePending", "status": "True", "reason": "Deferred", "message": message}
    return view(a_pod("slam", conditions=[condition]))


def count(stage, of="count"):
    labels = {"policy": POLICY, "stage": stage}
    return REGISTRY.get_sample_value(f"contextpolicy_stage_seconds_{of}", labels) or 0.0


def resizes(result):
    return REGISTRY.get_sample_value("contextpolicy_resizes_total", {"policy": POLICY, "result": result}) or 0.0


def test_each_stage_is_told_and_measured(told):
    before = [count(stage) for stage in ("plan", "patch", "status")]
    until_patch = count("patch", of="sum")
    told.watch.planned(POLICY, 1.0)
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    told.watch.on_in_force(POLICY, "lab/slam/slam", 300)
    assert told.stages == [("accepted", "lab/slam/slam", 0.3), ("inForce", "lab/slam/slam", 0.3)]
    assert [count(stage) for stage in ("plan", "patch", "status")] == [n + 1 for n in before]
    assert count("patch", of="sum") - until_patch == pytest.approx(1.5)


def test_a_patch_without_any_plan_yet_is_not_measured(told):
    before = count("patch")
    told.watch.on_accepted("lab/other", "lab/slam/slam", Cpu(None, None), 2.5)
    assert (told.stages, count("patch")) == ([("accepted", "lab/slam/slam", 0.0)], before)


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
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    for _ in range(2):
        told.watch.observe(held_back())
    assert told.problems == [("ResizePending", "slam: Deferred: node is full")]
    assert told.watch.problems(POLICY) == {"lab/slam": "lab/slam: Deferred: node is full"}
    assert told.watch.problems("lab/other") == {}
    told.watch.observe(view(a_pod("slam")))
    assert told.watch.problems(POLICY) == {}


def test_a_resize_of_somebody_else_that_is_held_back_is_no_news(told):
    told.watch.observe(held_back())
    assert (told.problems, told.watch.problems(POLICY)) == ([], {})


def test_a_pod_takes_its_problems_along(told):
    told.watch.on_accepted(POLICY, "lab/slam/slam", Cpu(100, 300), 2.5)
    told.watch.on_problem(POLICY, "slam", refusal())
    told.watch.on_problem("elsewhere/other", "slam", refusal())
    told.watch.observe(held_back())
    told.watch.lose(held_back())
    assert told.watch.problems(POLICY) == {}
    assert told.watch.problems("elsewhere/other") == {"slam": "slam: Invalid: no"}


def test_a_policy_takes_its_problems_along(told):
    told.watch.on_problem(POLICY, "slam", refusal())
    told.watch.forget(POLICY)
    assert told.watch.problems(POLICY) == {}
