"""What is put back: decreases before increases, but not for ever."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.put_back import RESTORE_PATIENCE, is_falling, without_rises
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from tests.actuators.resize.fake_cluster import UNREACHABLE, refusal
from tests.actuators.resize.rig import POLICY, Rig, limits, one_pod_for_two, two_pods
from tests.cluster.builders import NODE, a_pod, cpu


def about_to_release() -> Rig:
    """slam had 300m and is to rise to 500m, speech had 700m and is to fall to 500m."""
    rig = two_pods()
    rig.enforce(slam=300, speech=700)
    return rig


def test_restored_limit_rises_once_the_decreases_are_in_force():
    rig = about_to_release()
    rig.release()
    rig.work()
    rig.watch()
    assert (limits(rig), rig.workers.jobs, rig.released) == ((300, 500), [], []), "the API has it, the kubelet does not"
    rig.cluster.confirm("uid-speech")
    rig.watch()
    rig.work()
    assert (limits(rig), rig.released) == ((500, 500), [POLICY])


def test_originals_above_the_capacity_are_restored_too():
    rig = Rig(a_pod("slam", {"slam": cpu("10m", "1500m")}), a_pod("speech", {"speech": cpu("10m", "900m")}))
    rig.enforce(slam=20, speech=980)
    rig.release()
    rig.settle()
    assert (limits(rig), rig.released) == ((1500, 900), [POLICY])


@pytest.mark.parametrize("fault", [None, refusal(), UNREACHABLE], ids=["kubelet gone", "refused", "unreachable"])
def test_failed_decrease_delays_restored_increases_only_briefly(fault):
    rig = about_to_release()
    rig.cluster.faults += [fault] if fault is None else [fault] * 20
    rig.release()
    rig.work()
    rig.wait(RESTORE_PATIENCE - 0.1)
    assert rig.cluster.limit("slam") == 300
    rig.cluster.faults.clear()
    rig.wait(0.2)
    while rig.workers.jobs:
        rig.work()
    assert rig.cluster.limit("slam") == 500


def test_deleted_pod_does_not_block_restored_increases():
    rig = about_to_release()
    rig.release()
    rig.cluster.terminate("uid-speech")
    rig.watch()
    assert len(rig.workers.jobs) == 1, "its containers still run, so slam waits"
    rig.work()
    rig.watch()
    assert (rig.cluster.limit("slam"), rig.workers.jobs) == (300, [])
    rig.remove("uid-speech")
    rig.settle()
    assert (rig.cluster.limit("slam"), rig.released) == (500, [POLICY])


@pytest.mark.parametrize(("original", "falls"), [(499, True), (500, False), (None, False)])
def test_limit_above_its_original_counts_as_a_decrease(original, falls):
    state = PodState(view(a_pod("slam")))
    assert is_falling(state, POLICY, {"slam": Cpu(100, original)}) is falls


def test_restoring_to_no_limit_is_not_an_increase():
    back = {"slam": Cpu(100, None), "map": Cpu(100, 500), "nav": Cpu(100, 501)}
    state = PodState(view(a_pod("slam", dict.fromkeys(back, cpu("100m", "500m")))))
    assert without_rises(state, back).keys() == {"slam", "map"}


def test_restore_order_applies_within_one_pod():
    rig = one_pod_for_two()
    rig.enforce(slam__slam=300, slam__map=700)
    rig.release()
    rig.work()
    assert rig.cluster.limits("uid-slam") == {"slam": 300, "map": 500}
    assert rig.cluster.originals("uid-slam").keys() == {"slam"}
    rig.settle()
    assert (rig.cluster.limits("uid-slam"), rig.released) == ({"slam": 500, "map": 500}, [POLICY])


def test_a_decrease_on_another_node_is_not_waited_for():
    far = a_pod("speech")
    far["spec"]["nodeName"] = "robot-2"
    rig = Rig(a_pod("slam"), far)
    shares = {"lab/slam/slam": 300, "lab/speech/speech": 700}
    rig.apply(Order(POLICY, frozenset(shares), shares, {NODE: 1000, "robot-2": 1000}))
    rig.settle()
    rig.release()
    assert len(rig.workers.jobs) == 2


def test_a_second_restore_is_in_order_too():
    rig = about_to_release()
    for _ in range(2):
        rig.enforce(slam=300, speech=700)
        rig.plan()  # claims nothing any more
        rig.work()
        rig.watch()
        assert limits(rig) == (300, 500)
        rig.settle()
        assert limits(rig) == (500, 500)


def test_a_restore_after_a_restart_is_in_order():
    rig = about_to_release()
    rig.kill()
    rig.release()
    rig.work()
    assert (limits(rig), rig.workers.jobs) == ((300, 500), [])
    rig.settle()
    assert (limits(rig), rig.released) == ((500, 500), [POLICY])
