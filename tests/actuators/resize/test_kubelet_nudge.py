"""A kubelet that started after a resize has seen it, and does nothing about it until resources change again."""

from __future__ import annotations

import itertools

import pytest

from contextpolicy.actuators.resize.pauses import OVERLOOKED
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.policy.spec import Control
from tests.actuators.resize.rig import Rig
from tests.cluster.builders import a_pod, cpu

OVER = OVERLOOKED.first + 0.1
IN_PROGRESS = {"type": "PodResizeInProgress", "status": "True"}
DEFERRED = {"type": "PodResizePending", "status": "True", "reason": "Deferred"}


def overlook(rig, condition=None):
    """The kubelet starts: it has seen the newest spec and put nothing of it in force."""
    pod = rig.cluster.pods["uid-slam"]
    status, metadata = pod["status"], pod["metadata"]
    status["observedGeneration"] = metadata["generation"]
    status["conditions"] = [condition] if condition else []
    rig.cluster._commit("uid-slam")
    rig.watch()


def planned(share, **more):
    """A pod that was to get another share while its kubelet was away."""
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m")}))
    rig.plan(slam=share, **more)
    rig.work()
    rig.watch()
    return rig


def asked(rig):
    return [int(limits["slam"].removesuffix("m")) for _, limits in rig.cluster.resizes()]


@pytest.mark.parametrize(("share", "beside"), [(300, 301), (800, 799)], ids=["lower", "higher"])
def test_overlooked_resize_is_nudged_and_then_applied(share, beside):
    """With a value between what is and what should be, so that nothing ever sums to more."""
    rig = planned(share)
    overlook(rig)
    assert not rig.workers.jobs, "a kubelet that has just seen it may be at it"
    rig.wait(OVER)
    rig.work()
    rig.settle()
    assert asked(rig) == [share, beside, share]
    assert rig.witness.in_force == [("lab/slam/slam", share)]


def test_overlooked_request_is_nudged_too():
    rig = planned(300, control=Control.WEIGHT)
    overlook(rig)
    rig.wait(OVER)
    rig.work()
    [*_, (_, _, patch)] = rig.cluster.calls
    assert patch["spec"]["containers"][0]["resources"]["requests"]["cpu"] == "299m"
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"] == "300m"


def test_a_container_that_a_resize_restarts_is_not_nudged():
    pod = a_pod("slam", {"slam": cpu("100m", "500m")})
    pod["spec"]["containers"][0]["resizePolicy"] = [{"resourceName": "cpu", "restartPolicy": "RestartContainer"}]
    rig = Rig(pod)
    rig.plan(slam=300)
    rig.work()
    rig.watch()
    overlook(rig)
    rig.wait(60)
    assert asked(rig) == [300]


def test_repeated_nudges_back_off():
    rig, moments = planned(300), []
    for _ in range(600):
        overlook(rig)
        rig.wait(1.0)
        before = len(asked(rig))
        while rig.workers.jobs:
            rig.work()
        moments += [rig.scheduler.now] if len(asked(rig)) > before and asked(rig)[-1] == 301 else []
    gaps = [(later - earlier).total_seconds() for earlier, later in itertools.pairwise(moments)]
    assert len(moments) < 12
    assert gaps == sorted(gaps)
    assert gaps[-1] >= OVERLOOKED.longest


@pytest.mark.parametrize("condition", [IN_PROGRESS, DEFERRED], ids=["at it", "held back"])
def test_kubelet_with_a_resize_condition_is_not_nudged(condition):
    rig = planned(300)
    overlook(rig, condition=condition)
    rig.wait(60)
    assert asked(rig) == [300]


def test_kubelet_that_has_not_observed_the_resize_is_not_nudged():
    rig = planned(300)
    rig.wait(60)
    assert asked(rig) == [300]


def test_kubelet_without_observed_generation_is_not_nudged():
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m")}), observed_generation=False)
    rig.plan(slam=300)
    rig.work()
    rig.cluster.pods["uid-slam"]["status"].pop("observedGeneration")
    rig.cluster._commit("uid-slam")
    rig.watch()
    rig.wait(60)
    assert asked(rig) == [300]


def test_new_plan_replaces_the_nudge():
    rig = planned(300)
    overlook(rig)
    rig.wait(1.0)
    rig.plan(slam=400)
    rig.work()
    rig.settle()
    assert asked(rig) == [300, 400]


@pytest.mark.parametrize(
    ("spec", "kernel", "overlooked"),
    [("300m", "500m", True), ("304m", "310m", False), ("300m", "300m", False)],
    ids=["another limit", "rounded up by the systemd driver", "in force"],
)
def test_what_counts_as_overlooked(spec, kernel, overlooked):
    pod = a_pod("slam", {"slam": cpu("100m", spec)})
    pod["status"]["containerStatuses"][0]["resources"]["limits"]["cpu"] = kernel
    assert view(pod).overlooked is overlooked
