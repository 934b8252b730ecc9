"""A node whose agent is gone: the kubelet writes the plan's limits once more, although the API has them already."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.takeover import REWRITE_AFTER, aside
from contextpolicy.cluster.pods import Cpu
from tests.actuators.resize.rig import POLICY, Rig
from tests.actuators.resize.taking_over import FAR, HERE, NOWHERE, OVER, an_order, asked, in_force
from tests.cluster.builders import a_pod, cpu


def test_limits_are_rewritten_once_when_the_agent_is_gone():
    rig = in_force(slam=300)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(REWRITE_AFTER - 0.1)
    assert not rig.workers.jobs, "its supervisor may not have undone it yet"
    rig.wait(0.2)
    rig.settle()
    assert asked(rig) == [("slam", "99m", "300m"), ("slam", "100m", "300m")]
    rig.wait(600)
    rig.settle()
    assert len(asked(rig)) == 2


def test_second_rewrite_waits_until_the_kubelet_confirms_the_first():
    """Of two changes at once a kubelet sees only the sum, which is none."""
    rig = in_force(slam=300)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.work()
    rig.watch()
    rig.wait(5)
    assert not rig.workers.jobs
    rig.cluster.confirm()
    rig.watch()
    rig.settle()
    assert [limit for *_, limit in asked(rig)] == ["300m", "300m"]


def test_second_rewrite_waits_while_a_resize_is_in_progress():
    rig = in_force(slam=300)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.work()
    rig.cluster.pods["uid-slam"]["status"]["conditions"] = [{"type": "PodResizeInProgress", "status": "True"}]
    rig.cluster.confirm()
    rig.watch()
    rig.wait(5)
    assert not rig.workers.jobs


def test_agent_that_returns_in_time_prevents_the_rewrite():
    rig = in_force(slam=10)
    rig.apply(an_order(NOWHERE, slam=10))
    rig.wait(5)
    rig.apply(an_order(HERE, slam=10))
    rig.wait(600)
    rig.settle()
    assert asked(rig) == []


@pytest.mark.parametrize("agents", [HERE, NOWHERE])
def test_limits_are_written_once_while_no_agent_is_lost(agents):
    rig = Rig(a_pod("slam"))
    for _ in range(3):
        rig.apply(an_order(agents, slam=10))
        rig.settle()
    rig.wait(600)
    rig.settle()
    assert len(asked(rig)) == 1


def test_another_nodes_agent_does_not_count():
    rig = Rig(a_pod("slam"))
    rig.apply(an_order(frozenset({FAR}), slam=10))
    rig.settle()
    rig.apply(an_order(NOWHERE, slam=10))
    rig.wait(OVER)
    rig.settle()
    assert len(asked(rig)) == 1


def test_untouched_container_is_rewritten_too():
    rig = Rig(a_pod("slam"))
    rig.apply(an_order(HERE, slam=500, limits={"slam": None}))
    rig.settle()
    assert asked(rig) == []
    rig.apply(an_order(NOWHERE, slam=500, limits={"slam": None}))
    rig.wait(OVER)
    rig.settle()
    assert [limit for *_, limit in asked(rig)] == ["500m", "500m"]
    assert "slam" in rig.cluster.originals("uid-slam"), "an operator killed in between must know the request"


def test_rewrite_covers_the_whole_node_and_changes_no_limit():
    rig = in_force(slam=600, speech=300, chat=100)
    rig.apply(an_order(NOWHERE, slam=600, speech=300, chat=100))
    rig.wait(OVER)
    rig.settle()
    assert sorted({(name, limit) for name, _, limit in asked(rig)}) == [
        ("chat", "100m"),
        ("slam", "600m"),
        ("speech", "300m"),
    ]
    assert len(asked(rig)) == 6


def test_plan_that_changes_before_the_rewrite_is_rewritten_too():
    rig = in_force(slam=10)
    rig.apply(an_order(NOWHERE, slam=10))
    rig.wait(5)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.settle()
    rig.wait(OVER)
    rig.settle()
    assert rig.cluster.limit("slam") == 300
    assert len(asked(rig)) == 3, "the supervisor may have undone the first"


def test_a_container_that_every_resize_restarts_is_left():
    pod = a_pod("slam", {"slam": cpu("100m", "500m")})
    pod["spec"]["containers"][0]["resizePolicy"] = [{"resourceName": "cpu", "restartPolicy": "RestartContainer"}]
    rig = in_force(pod, slam=300)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.settle()
    assert asked(rig) == []


def test_operator_killed_during_a_rewrite_restores_the_request():
    rig = in_force(slam=300)
    before = rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"]
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.work()
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"] != before
    rig.kill()
    rig.apply(an_order(NOWHERE, slam=300))
    rig.settle()
    assert rig.cluster.pods["uid-slam"]["spec"]["containers"][0]["resources"]["requests"]["cpu"] == before


def test_a_policy_that_ends_in_the_middle_leaves_the_originals():
    rig = in_force(slam=300)
    rig.apply(an_order(NOWHERE, slam=300))
    rig.wait(OVER)
    rig.work()
    rig.release()
    rig.settle()
    assert rig.released == [POLICY]
    [container] = rig.cluster.pods["uid-slam"]["spec"]["containers"]
    [fresh] = a_pod("slam")["spec"]["containers"]
    assert container["resources"] == fresh["resources"]


@pytest.mark.parametrize(
    ("qos", "wanted", "beside"),
    [
        ("Burstable", Cpu(100, 300), Cpu(99, 300)),
        ("Burstable", Cpu(2, 10), Cpu(3, 10)),
        ("Burstable", Cpu(10, 10), Cpu(9, 10)),
        ("Guaranteed", Cpu(300, 300), Cpu(299, 299)),
        ("Guaranteed", Cpu(10, 10), Cpu(11, 11)),
    ],
)
def test_a_pods_class_and_the_least_limit_are_kept(qos, wanted, beside):
    assert aside(qos, wanted) == beside
