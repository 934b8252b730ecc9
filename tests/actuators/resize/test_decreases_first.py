"""A limit rises only when the decreases that pay for it are in force."""

from __future__ import annotations

from contextpolicy.actuators.order import Order
from contextpolicy.policy.spec import Control
from tests.actuators.resize.rig import POLICY, Rig, limits, two_pods
from tests.cluster.builders import NODE, a_pod


def test_an_increase_waits_until_the_decrease_is_in_force():
    rig = two_pods()
    rig.plan(slam=800, speech=200)
    assert len(rig.workers.jobs) == 1
    rig.work()
    rig.watch()
    assert limits(rig) == (500, 200)
    assert rig.workers.jobs == [], "the API has it, the kubelet does not"
    rig.cluster.kubelet("uid-speech")
    rig.watch()
    assert rig.workers.jobs == [], "the kubelet has it and has not reported it"
    rig.cluster.report("uid-speech")
    rig.watch()
    rig.work()
    assert limits(rig) == (800, 200)


def test_limit_rounded_up_by_the_cgroup_driver_counts_as_in_force():
    rig = two_pods()
    rig.plan(slam=500, speech=333)
    rig.work()
    rig.cluster.kubelet("uid-speech")
    rig.cluster._specs["uid-speech"][0][1]["speech"] = 340
    rig.cluster.report("uid-speech")
    rig.watch()
    rig.plan(slam=660, speech=333)
    assert len(rig.workers.jobs) == 1


def test_increase_waits_for_a_container_not_yet_seen():
    """A new pod starts with the limit of its template; the plan counts on it already."""
    rig = Rig(a_pod("slam"))
    rig.plan(slam=800, speech=200)
    assert rig.workers.jobs == []
    rig.cluster.create(a_pod("speech"))
    rig.watch()
    rig.work()
    assert limits(rig) == (500, 200)
    rig.settle()
    assert limits(rig) == (800, 200)


def test_unseen_container_holds_back_increases_on_its_own_node_only():
    rig = Rig(a_pod("slam"))
    shares, far = {"lab/slam/slam": 800, "lab/speech/speech": 200}, "robot-2"
    nodes = {"lab/slam/slam": NODE, "lab/speech/speech": far}
    rig.apply(Order(POLICY, frozenset(shares), shares, {NODE: 1000, far: 1000}, nodes=nodes))
    rig.work()
    assert rig.cluster.limit("slam") == 800


def test_a_pod_keeps_its_share_until_its_containers_have_ended():
    rig = two_pods()
    rig.enforce(slam=600, speech=400)
    rig.cluster.terminate("uid-speech")
    rig.watch()
    rig.plan(slam=1000)
    assert rig.workers.jobs == []
    rig.remove("uid-speech")
    rig.work()
    assert rig.cluster.limit("slam") == 1000


def test_a_pod_whose_containers_have_ended_takes_no_room():
    rig = two_pods()
    rig.enforce(slam=600, speech=400)
    rig.cluster.pods["uid-speech"]["status"]["containerStatuses"][0]["state"] = {"terminated": {}}
    rig.cluster.terminate("uid-speech")
    rig.watch()
    rig.plan(slam=1000)
    rig.work()
    assert rig.cluster.limit("slam") == 1000


def test_weights_need_no_order():
    rig = two_pods()
    rig.plan(slam=800, speech=200, control=Control.WEIGHT)
    assert len(rig.workers.jobs) == 2
