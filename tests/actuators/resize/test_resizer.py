"""From orders to patches: what is sent, and what is not."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.order import Order
from contextpolicy.policy.spec import Control
from tests.actuators.resize.rig import POLICY, Rig, by_id, one_pod_for_two, two_pods
from tests.cluster.builders import NODE, a_pod, cpu


def test_nothing_is_sent_when_nothing_changes():
    rig = two_pods()
    rig.plan(slam=500, speech=500)
    rig.watch()
    rig.plan(slam=500, speech=500)
    assert rig.workers.jobs == []


def test_the_same_plan_again_sends_nothing_while_the_watch_is_late():
    rig = Rig(a_pod("slam"))
    rig.plan(slam=300)
    rig.work()
    rig.plan(slam=300)
    assert rig.workers.jobs == []


def test_several_containers_of_a_pod_move_in_one_patch_and_sidecars_with_them():
    rig = Rig(a_pod("slam", {"slam": cpu("10m", "500m")}, sidecars={"map": cpu("10m", "400m")}))
    rig.enforce(slam__slam=300, slam__map=200)
    assert rig.cluster.resizes() == [("slam", {"slam": "300m", "map": "200m"})]
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 200}


def test_container_not_named_in_the_order_is_unchanged():
    rig = one_pod_for_two()
    rig.enforce(slam__slam=300)
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 500}


@pytest.mark.parametrize(
    ("control", "resources"),
    [
        (Control.LIMIT, {"requests": {"cpu": "100m"}, "limits": {"cpu": "300m"}}),
        (Control.WEIGHT, {"requests": {"cpu": "300m"}, "limits": {"cpu": "800m"}}),
    ],
)
def test_the_policy_chooses_what_moves_and_all_of_it_is_restored(control, resources):
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m", None)}))
    before = rig.cluster.pods["uid-slam"]["spec"]
    rig.enforce(slam=300, control=control)
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"] == resources
    assert rig.witness.in_force == [("lab/slam/slam", 300)]
    rig.release()
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"] == before


def test_going_back_to_limits_brings_the_request_back():
    rig = Rig(a_pod("slam"))
    rig.enforce(slam=300, control=Control.WEIGHT)
    rig.enforce(slam=400)
    resources = rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]
    assert (resources["requests"]["cpu"], resources["limits"]["cpu"]) == ("100m", "400m")


def test_a_guaranteed_pod_keeps_its_class_both_ways():
    rig = Rig(a_pod("slam", {"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, qos="Guaranteed"))
    for share in (800, 200):
        rig.enforce(slam=share)
        resources = rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]
        assert resources["requests"]["cpu"] == resources["limits"]["cpu"] == f"{share}m"


def free(*tasks: str, **limits: int) -> Order:
    """Nothing is enforced but these limits."""
    named = by_id({**dict.fromkeys(tasks, 500), **limits})
    capped = by_id(limits)
    return Order(
        POLICY,
        frozenset(named),
        named,
        {NODE: 1000},
        {identity: capped.get(identity) for identity in named},
        bounded=False,
        nodes=dict.fromkeys(named, NODE),
    )


def test_a_container_that_is_left_alone_is_never_written():
    rig = Rig(a_pod("slam"), a_pod("speech"))
    rig.apply(free("slam", speech=10))
    rig.settle()
    assert (rig.cluster.limits("uid-slam"), rig.cluster.limits("uid-speech")) == ({"slam": 500}, {"speech": 100})
    assert not rig.cluster.originals("uid-slam")


def test_owner_may_change_an_unenforced_limit():
    rig = Rig(a_pod("slam"))
    rig.apply(free("slam"))
    rig.settle()
    rig.cluster.edit("uid-slam", "slam", cpu="700m")
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 700}
    assert rig.witness.conflicts == []


def test_resumed_container_regains_its_original_limit():
    rig = Rig(a_pod("slam", {"slam": cpu("1m", "500m", None)}))
    rig.apply(free(slam=10))
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 10}
    rig.apply(free("slam"))
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 500}
    assert rig.witness.conflicts == []


def test_a_request_is_the_floor_of_a_limit():
    rig = Rig(a_pod("slam", {"slam": cpu("100m", "500m", None)}))
    rig.apply(free(slam=10))
    rig.settle()
    assert rig.cluster.limits("uid-slam") == {"slam": 100}
