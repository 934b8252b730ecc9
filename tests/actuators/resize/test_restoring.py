"""What was there before is written down, and comes back when a policy lets go."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.originals import Original
from contextpolicy.cluster.pods import Cpu
from tests.actuators.resize.fake_cluster import UNREACHABLE, Killed, Unanswered, refusal
from tests.actuators.resize.rig import MOMENT, OTHER, POLICY, Rig, believed, limits, one_pod_for_two, two_pods
from tests.cluster.builders import NODE, a_pod

# the note of what was there


def test_the_originals_are_written_once_and_before_the_first_resize():
    rig = Rig(a_pod("slam"))
    for share in (300, 400, 450):
        rig.enforce(slam=share)
    assert [call for call, *_ in rig.cluster.calls] == ["store", "resize", "resize", "resize"]
    slam = {"slam": {"request": "100m", "limit": "500m"}}
    assert rig.cluster.policies == {POLICY: {"uid-slam": {"pod": "slam", "containers": slam}}}


def test_the_originals_of_all_pods_cost_one_write():
    rig = Rig(*(a_pod(name) for name in ("slam", "speech", "nav")))
    rig.enforce(slam=300, speech=400, nav=500)
    rig.enforce(slam=400, speech=300, nav=300)
    assert [(call, name) for call, name, _ in rig.cluster.calls if call != "resize"] == [("store", "robot")]
    assert rig.cluster.originals("uid-nav") == {"nav": Original(POLICY, Cpu(100, 500))}


def test_nothing_is_resized_before_its_original_is_stored():
    rig = Rig(a_pod("slam"), stores=True)
    rig.plan(slam=300)
    assert len(rig.workers.jobs) == 1
    rig.cluster.faults.append(UNREACHABLE)
    rig.work()
    rig.wait(1.0)
    rig.work()
    assert [call for call, *_ in rig.cluster.calls] == ["store", "store"]
    rig.work()
    assert rig.cluster.limit("slam") == 300
    assert rig.witness.problems == [(POLICY, "its status", "Unreachable"), (POLICY, "its status", "recovered")]


def test_release_restores_limits_before_it_removes_the_originals():
    rig = two_pods()
    rig.enforce(slam=300, speech=700)
    rig.cluster.calls.clear()
    rig.release()
    assert rig.released == []
    rig.settle()
    speech, slam = ("resize", "speech"), ("resize", "slam")
    assert [call[:2] for call in rig.cluster.calls] == [speech, ("store", "robot"), slam]
    assert limits(rig) == (500, 500)
    assert rig.cluster.originals("uid-slam") == rig.cluster.originals("uid-speech") == {}
    assert rig.released == [POLICY]


def test_a_release_with_nothing_to_do_is_done_at_once():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=500)
    rig.release()
    assert (rig.released, rig.cluster.calls) == ([POLICY], [])


def test_a_release_waits_for_the_first_patch_that_is_under_way():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.release()
    assert rig.released == []
    rig.work()
    assert rig.cluster.limit("slam") == 300
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam"), rig.released) == (500, {}, [POLICY])


def test_a_release_after_a_first_patch_without_an_answer_restores():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.cluster.faults += [None, Unanswered(UNREACHABLE)]
    rig.work()
    rig.release()
    assert rig.released == []
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.cluster.originals("uid-slam"), rig.released) == (500, {}, [POLICY])


def test_a_late_answer_about_a_released_policy_says_nothing_about_the_next_of_its_name():
    rig = Rig(a_pod("slam"), stores=True)
    rig.plan(slam=300)
    rig.workers.run()  # the API server has stored it; the answer is still on its way
    rig.release()
    assert rig.released == [POLICY]
    rig.plan(slam=400)
    rig.wait(MOMENT)
    assert len(rig.workers.jobs) == 1, "nothing is resized before its original is stored"
    rig.work()
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}
    rig.work()
    assert rig.cluster.limit("slam") == 400


def test_release_removes_the_original_of_a_refused_resize():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.cluster.faults += [None, refusal()]
    rig.work()
    rig.release()
    rig.settle()
    assert (rig.cluster.originals("uid-slam"), rig.released) == ({}, [POLICY])


def test_a_release_does_not_wait_for_pods_that_vanish_or_end():
    rig = two_pods()
    rig.enforce(slam=300, speech=300)
    rig.release()
    rig.cluster.pods["uid-slam"]["status"]["phase"] = "Failed"  # evicted pods stay as objects
    rig.cluster._commit("uid-slam")
    rig.watch("uid-slam")
    rig.remove("uid-speech")
    assert rig.released == [POLICY]


def test_late_plan_does_not_hold_an_unclaimed_container():
    """It still has a share for a container that the policy has lost, and for one whose pod is gone."""
    rig = two_pods()
    rig.enforce(slam=300, speech=300)
    shares = {"lab/slam/slam": 400, "lab/speech/speech": 300, "lab/gone/gone": 100}
    rig.apply(Order(POLICY, frozenset({"lab/slam/slam"}), shares, {NODE: 1000}))
    rig.settle()
    assert limits(rig) == (400, 500)
    assert rig.cluster.originals("uid-speech") == {}


def test_a_claimed_container_without_a_share_keeps_what_it_has():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.order(POLICY, {})
    rig.order(POLICY, {"lab/slam/slam": 300})
    rig.settle()
    assert rig.cluster.limit("slam") == 300


@pytest.mark.parametrize("fault", [None, Killed(), Unanswered(Killed()), UNREACHABLE, Unanswered(UNREACHABLE)])
@pytest.mark.parametrize(("heir_first", "at"), [*((True, at) for at in range(2)), *((False, at) for at in range(4))])
def test_a_container_passed_between_policies_keeps_its_first_original(fault, at, heir_first):
    """Whatever happens to the writes that this takes: while it is moved, some status knows what it had."""
    rig = Rig(a_pod("slam"), stores=True)
    rig.enforce(slam=300)
    rig.cluster.faults += [None] * at + [fault]
    acts = [lambda: rig.plan(OTHER, slam=400), lambda: rig.hold(POLICY)]

    def hand_over():
        for act in acts if heir_first else reversed(acts):
            act()
        rig.settle()

    rig.cluster.on_call = lambda: known_or_back(rig)
    while not rig.survive(hand_over):
        pass
    assert not rig.cluster.faults, "it took fewer calls"
    assert rig.cluster.originals("uid-slam") == {"slam": Original(OTHER, Cpu(100, 500))}
    rig.release(OTHER)
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [OTHER])


def known_or_back(rig):
    known = rig.cluster.originals("uid-slam")
    assert known["slam"].cpu == Cpu(100, 500) if known else rig.cluster.limit("slam") == 500


def test_stale_watch_is_not_recorded_as_the_original():
    """Claimed again while the watch still shows what the container had by the policy."""
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300)
    rig.release()
    rig.work()
    assert rig.cluster.feeds["uid-slam"], "the watch has not reported the restore"
    rig.enforce(slam=400)
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


DAMAGED: list[object] = [
    *(None, [], "{", 5, {"uid-slam": None}, {"uid-slam": {}}, {"uid-slam": {"pod": "slam", "containers": []}}),
    {"uid-slam": {"pod": "slam", "containers": {"slam": {"limit": "lots"}}}},
    {"uid-slam": {"pod": "slam", "containers": {"slam": 5}}},
]


@pytest.mark.parametrize("stored", DAMAGED, ids=str)
def test_a_damaged_status_does_not_keep_the_pod_from_being_resized(stored):
    rig = Rig(a_pod("slam"))
    rig.cluster.policies[POLICY] = stored if isinstance(stored, dict) else {}
    rig.resizer.recall(POLICY, believed({"metadata": {}, "status": {"originals": stored}}))
    rig.enforce(slam=300)
    assert rig.cluster.limit("slam") == 300
    assert rig.cluster.originals("uid-slam") == {"slam": Original(POLICY, Cpu(100, 500))}


def test_status_counts_only_for_pods_of_its_own_namespace():
    rig = Rig(a_pod("slam"))
    stored = {"uid-slam": {"pod": "slam", "containers": {"slam": {"limit": "64"}}}}
    rig.resizer.recall("attack/robot", believed({"metadata": {}, "status": {"originals": stored}}))
    rig.release("attack/robot")
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, ["attack/robot"])


def test_pod_annotations_change_nothing():
    note = '{"slam": {"policy": "lab/robot", "request": "1", "limit": "64"}}'
    rig = Rig(a_pod("slam", annotations={"contextpolicy.dev/original-resources": note}))
    rig.enforce(slam=300)
    rig.release()
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


def test_originals_of_deleted_pods_leave_the_status():
    rig = two_pods()
    rig.enforce(slam=300, speech=300)
    rig.remove("uid-slam")
    rig.settle()
    assert rig.cluster.policies[POLICY].keys() == {"uid-speech"}
    rig.cluster.remove("uid-speech")  # while no operator runs
    rig.kill()
    rig.enforce()
    assert rig.cluster.policies[POLICY] == {}


# two policies in one pod


def test_policies_sharing_a_pod_do_not_wait_for_each_other():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.plan(OTHER, slam__map=300)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    assert rig.cluster.limits("uid-slam") == {"slam": 500, "map": 300}


def test_each_policy_restores_its_own_containers():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.enforce(OTHER, slam__map=300)
    rig.release()
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 500, "map": 300}
    assert rig.cluster.originals("uid-slam").keys() == {"map"}


def test_a_refused_restore_is_not_repeated_when_another_policy_plans():
    rig = one_pod_for_two()
    rig.plan(slam__slam=300)
    rig.enforce(OTHER, slam__map=300)
    rig.cluster.faults.append(refusal())
    rig.plan()  # claims nothing any more
    rig.work()
    for _ in range(3):
        rig.plan(OTHER, slam__map=300)
    assert rig.workers.jobs == []
