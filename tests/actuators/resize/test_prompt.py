"""`transition: Prompt`: all limits of a plan at once, and back again where a fall is refused."""

from __future__ import annotations

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.pauses import REFUSED
from contextpolicy.policy.spec import Transition
from tests.actuators.resize.fake_cluster import refusal
from tests.actuators.resize.rig import POLICY, Rig, by_id, limits, two_pods
from tests.cluster.builders import NODE, a_pod, cpu


def prompt(rig: Rig, n: int = 1000, **shares: int) -> None:
    named = by_id(shares)
    nodes = dict.fromkeys(named, NODE)
    rig.apply(Order(POLICY, frozenset(named), named, {NODE: n}, nodes=nodes, transition=Transition.PROMPT))


def test_increases_do_not_wait_and_decreases_go_first():
    rig = two_pods()
    prompt(rig, slam=800, speech=200)
    assert len(rig.workers.jobs) == 2
    rig.work()
    assert limits(rig) == (500, 200)
    rig.work()
    assert limits(rig) == (800, 200)


def test_the_task_that_gains_the_most_is_the_first_to_rise():
    rig = Rig(*(a_pod(name) for name in ("arm", "nav", "slam", "speech")))
    prompt(rig, n=2000, arm=550, nav=150, slam=800, speech=500)
    while rig.workers.jobs:
        rig.work()
    assert [pod for call, pod, _ in rig.cluster.calls if call == "resize"] == ["nav", "slam", "arm"]


def test_increase_whose_decrease_was_refused_is_reverted_and_retried():
    rig = two_pods()
    prompt(rig, slam=800, speech=200)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    assert limits(rig) == (800, 500)
    rig.cluster.confirm()
    rig.watch()
    rig.work()
    assert limits(rig) == (500, 500)
    rig.cluster.confirm()
    rig.watch()
    rig.wait(REFUSED.first + 0.1)
    rig.settle()
    assert limits(rig) == (800, 200)


def test_new_pod_goes_back_to_what_it_had_and_not_to_what_the_one_before_had():
    rig = two_pods()
    prompt(rig, slam=600, speech=400)
    rig.cluster.faults.append(refusal())
    rig.work()
    rig.work()
    rig.remove("uid-slam")
    rig.cluster.create(a_pod("slam", {"slam": cpu("100m", "550m")}, uid="uid-slam-2"))
    rig.watch()
    rig.store()
    while rig.workers.jobs:
        rig.work()
    assert rig.cluster.limits("uid-slam-2") == {"slam": 550}


def test_nothing_is_kept_of_pods_that_were_replaced_under_one_plan():
    rig = two_pods()
    prompt(rig, slam=600, speech=400)
    rig.settle()
    for last, new in zip(["uid-slam", "uid-1", "uid-2"], ["uid-1", "uid-2", "uid-3"], strict=True):
        rig.remove(last)
        rig.cluster.create(a_pod("slam", uid=new))
        rig.settle()
    assert rig.cluster.limits("uid-3") == {"slam": 600}
    assert {uid for uid, _ in rig.resizer._reconcilers[POLICY]._before} == {"uid-3", "uid-speech"}


def test_increase_that_does_not_need_the_refused_decrease_stays():
    rig = Rig(a_pod("slam"), a_pod("speech"), a_pod("nav"))
    prompt(rig, n=1500, slam=700, speech=300, nav=500)
    rig.settle()
    prompt(rig, n=1500, slam=710, speech=490, nav=300)
    rig.cluster.faults.append(refusal())
    while rig.workers.jobs:
        rig.work()
    assert rig.cluster.limit("slam") in (700, 710)
    rig.settle()
    assert (rig.cluster.limit("slam"), *limits(rig)[1:], rig.cluster.limit("nav")) == (710, 490, 300)


def test_prompt_and_strict_converge_to_the_same_limits():
    for transition in Transition:
        rig = two_pods()
        for slam in (800, 100, 600):
            named = by_id({"slam": slam, "speech": 1000 - slam})
            nodes = dict.fromkeys(named, NODE)
            order = Order(POLICY, frozenset(named), named, {NODE: 1000}, nodes=nodes, transition=transition)
            rig.apply(order)
            rig.settle()
            assert limits(rig) == (slam, 1000 - slam)
