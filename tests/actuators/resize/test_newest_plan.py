"""The newest plan wins over patches and resizes under way, and what the watch shows is reported."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.pod_state import SETTLING
from contextpolicy.actuators.resize.resizer import BOOKKEEPING
from contextpolicy.cluster.pod_parsing import view
from tests.actuators.resize.fake_cluster import refusal
from tests.actuators.resize.rig import MOMENT, POLICY, Rig, by_id, limits, two_pods
from tests.cluster.builders import a_pod


def test_plans_during_a_patch_collapse_into_the_newest():
    rig = Rig(a_pod("slam"))
    for share in (300, 350, 400, 450):
        rig.plan(slam=share)
    assert len(rig.workers.jobs) == 1
    rig.work()
    rig.cluster.confirm()
    rig.watch()
    assert len(rig.workers.jobs) == 1
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]
    assert rig.workers.jobs == []


def test_a_newer_plan_does_not_queue_up_behind_the_kubelets_last_resize():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    for share in (350, 400, 450):
        rig.plan(slam=share)
        assert rig.workers.jobs == []
    rig.cluster.confirm()
    rig.watch()
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]


def test_silent_kubelet_delays_the_newest_plan_only_briefly():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=450)
    rig.wait(SETTLING + 0.1)
    rig.work()
    assert [limits["slam"] for _, limits in rig.cluster.resizes()] == ["300m", "450m"]


def test_a_resize_that_the_kubelet_holds_back_does_not_hold_up_the_next():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    deferred = {"type": "PodResizePending", "status": "True", "reason": "Deferred"}
    rig.cluster.pods["uid-slam"]["status"]["conditions"] = [deferred]
    rig.cluster._commit("uid-slam")
    rig.watch()
    rig.plan(slam=450)
    rig.work()
    assert rig.cluster.limit("slam") == 450


def test_a_plan_made_while_a_patch_was_refused_is_sent_at_once():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.plan(slam=400)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    assert rig.cluster.limit("slam") == 400


def test_accepted_and_in_force_are_reported():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    assert (rig.witness.accepted, rig.witness.in_force) == ([("lab/slam/slam", 300)], [])
    rig.cluster.confirm()
    rig.watch()
    rig.cluster.report("uid-slam")
    rig.watch()
    assert rig.witness.in_force == [("lab/slam/slam", 300)]


def test_restored_limits_are_reported_too():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.release()
    rig.settle()
    assert rig.witness.accepted == [("lab/slam/slam", 300), ("lab/slam/slam", 500)]


def test_changes_of_unclaimed_pods_trigger_no_reconcile(monkeypatch):
    rig = Rig(a_pod("slam"), *(a_pod(f"other-{n}") for n in range(5)))
    rig.enforce(slam=300)
    looks = reconciles_of(rig, monkeypatch)
    for n in range(5):
        rig.cluster.report(f"uid-other-{n}")
    rig.watch()
    assert looks == []


def reconciles_of(rig, monkeypatch):
    """When the policy is reconciled: each time, all of its containers are looked at."""
    looks: list[float] = []
    reconciler = rig.resizer._reconcilers[POLICY]
    reconcile = reconciler.reconcile

    def look(now):
        looks.append(now)
        reconcile(now)

    monkeypatch.setattr(reconciler, "reconcile", look)
    return looks


def test_simultaneous_decreases_trigger_one_reconcile(monkeypatch):
    names = [f"task-{n}" for n in range(10)]
    rig = Rig(*(a_pod(name) for name in names))
    rig.order(POLICY, by_id(dict.fromkeys(names, 300)))
    while rig.workers.jobs:
        rig.work()
    rig.watch()
    looks = reconciles_of(rig, monkeypatch)
    rig.cluster.confirm()
    for feed in rig.cluster.feeds.values():
        rig.resizer.observe(view(feed.popleft()))
    rig.wait(MOMENT)
    assert len(looks) == 1


def test_answers_that_free_no_headroom_share_one_reconcile(monkeypatch):
    names = [f"task-{n}" for n in range(10)]
    rig = Rig(*(a_pod(name) for name in names))
    for share in (300, 200):
        rig.order(POLICY, by_id(dict.fromkeys(names, share)))
        with monkeypatch.context() as patched:
            looks = reconciles_of(rig, patched)
            while rig.workers.jobs:
                rig.work()
                rig.watch()
            assert looks == []
            rig.wait(BOOKKEEPING)
            assert len(looks) == 1
        rig.settle()


def test_plan_that_reverts_a_patch_is_sent_without_delay():
    """While the patch is under way, the API has what the new plan wants: only its end shows that it must be undone."""
    rig = two_pods()
    rig.plan(slam=800)
    rig.plan(slam=500)
    rig.work()
    rig.cluster.confirm("uid-slam")
    rig.watch("uid-slam")
    rig.work()
    assert rig.cluster.limit("slam") == 500


def test_new_operator_resizes_nothing_before_the_first_plan():
    rig = two_pods()
    rig.enforce(slam=800, speech=200)
    rig.kill()
    rig.wait(60.0)
    assert rig.workers.jobs == []


@pytest.mark.parametrize("observed_generation", [True, False])
def test_without_observed_generation_the_reported_resources_count(observed_generation):
    rig = two_pods(observed_generation=observed_generation)
    rig.cluster.confirm()
    rig.watch()
    rig.plan(slam=800, speech=200)
    rig.work()
    rig.watch()
    assert rig.workers.jobs == []
    rig.settle()
    assert limits(rig) == (800, 200)
