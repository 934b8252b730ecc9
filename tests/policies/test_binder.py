"""Pods and nodes that come, change and go under a policy, in virtual time."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.conflict import STRIKES
from contextpolicy.actuators.resize.pauses import CONFLICTING
from contextpolicy.cluster.claims import claim
from contextpolicy.policies import binder
from contextpolicy.telemetry.reporter import STATUS_INTERVAL
from tests.cluster.builders import NODE, a_pod, cpu
from tests.planning.builders import a_task
from tests.policies.builders import IMU, a_policy, resources


def test_a_node_that_changes_its_size_changes_n(running):
    running.node("2")
    running.settle()
    assert running.limits() == {"slam": 1000, "speech": 1000}
    running.node("500m")
    running.settle()
    assert running.limits() == {"slam": 250, "speech": 250}


def test_containers_on_a_removed_node_are_released(running):
    running.operator.node_gone(f"uid-{NODE}")
    running.settle()
    assert running.limits() == {"slam": 400, "speech": 400}
    running.node()
    running.settle()
    assert running.limits() == {"slam": 500, "speech": 500}


def test_removal_of_an_old_node_keeps_its_reregistered_successor(running):
    """A list may contain the new node before the deletion of the old one is noticed."""
    running.node("2", uid="uid-again")
    running.settle()
    assert running.limits() == {"slam": 1000, "speech": 1000}
    assert running.resizes_while(lambda: running.operator.node_gone(f"uid-{NODE}")) == []
    running.operator.node_gone("uid-again")
    running.settle()
    assert running.limits() == {"slam": 400, "speech": 400}


def test_a_node_that_was_replaced_unseen_keeps_its_shares(running):
    """The watch reports the end of the one and then the other, one right after the other."""
    running.react(IMU, speed=0.3)

    def replace():
        running.operator.node_gone(f"uid-{NODE}")
        running.node(uid="uid-again")

    assert running.resizes_while(replace) == []
    assert running.limits() == {"slam": 800, "speech": 200}


def test_pods_known_before_their_node_are_governed_as_soon_as_it_is(operator):
    for pod in operator.cluster.pods.values():
        operator.operator.pod_changed(pod)
    operator.connect()
    operator.apply(a_policy())
    operator.sample(IMU, speed=0.3)
    assert operator.patches.jobs == []
    operator.node()
    operator.settle()
    assert operator.limits() == {"slam": 800, "speech": 200}


def test_a_pod_that_is_replaced_gets_the_share_of_its_task(running):
    running.react(IMU, speed=0.3)
    running.operator.pod_gone("uid-slam")
    running.cluster.remove("uid-slam")
    running.turn()
    running.cluster.create(a_pod("slam-2", {"slam": resources()}, labels={"app": "slam"}))
    running.settle()
    assert running.limits() == {"slam": 800, "speech": 200}


def test_a_restarted_container_is_reported_to_agents_with_the_plan_in_force(running):
    running.session.published.clear()
    running.cluster.pods["uid-slam"]["status"]["containerStatuses"][0]["containerID"] = "containerd://again"
    running.cluster._commit("uid-slam")
    running.settle()
    [plan] = running.session.plans()
    assert plan["edition"] == 1
    assert "containerd://again" in [target["containerId"] for target in plan["targets"]]
    assert "trigger" in plan


HALF = {"reserve": "500m"}
OWN = [a_task("slam"), a_task("speech")]


@pytest.fixture(params=["without an agent", "with an agent"])
def shared(running, request):
    """A younger policy has the arm, in the half of the node that the robot's own leaves."""
    if request.param == "with an agent":
        running.session.agent(NODE, b'{"missing": {"CFS": [], "Realtime": []}}')
    running.apply(a_policy(generation=2, **HALF))
    running.apply(a_policy("younger", created="2026-02-01T00:00:00Z", tasks=[a_task("arm")], contexts=[], streams=[]))
    running.cluster.create(a_pod("arm", {"arm": resources()}))
    running.settle()
    assert running.session.plans("lab/younger")[-1]["targets"]
    return running


def owners(operator, act):
    """Each message about plans that follows, as its policy and whether that has the arm."""
    before = len(operator.session.published)
    act()
    operator.settle()
    messages = [message for key, message in operator.session.published[before:] if key.endswith("/plan")]
    return [(one["policy"], "arm" in [target["pod"] for target in one["targets"]]) for one in messages]


def test_a_pod_that_changes_hands_is_given_up_before_it_is_taken(shared):
    """Policies publish oldest first, but an agent refuses a container that still belongs to another policy."""
    shared.apply(a_policy(generation=3, tasks=[*OWN, a_task("guest", container="arm")], **HALF))
    shared.settle()

    def relabel():
        shared.cluster.pods["uid-arm"]["metadata"]["labels"] = {"app": "guest"}
        shared.cluster._commit("uid-arm")

    told = owners(shared, relabel)
    assert told.index(("lab/younger", False)) < told.index(("lab/robot", True))


def test_a_policy_that_is_edited_takes_a_container_after_its_owner_gave_it_up(shared):
    told = owners(shared, lambda: shared.apply(a_policy(generation=3, tasks=[*OWN, a_task("arm")], **HALF)))
    assert told.index(("lab/younger", False)) < told.index(("lab/robot", True))


def test_a_container_that_a_resize_would_restart_is_left_alone_and_reported_once(running):
    delicate = a_pod("slam-2", {"slam": resources()}, labels={"app": "slam"})
    delicate["spec"]["containers"][0]["resizePolicy"] = [{"resourceName": "cpu", "restartPolicy": "RestartContainer"}]
    running.cluster.create(delicate)
    for speed in (0.3, 0.0, 0.3):
        running.react(IMU, speed=speed)
    assert "slam-2" not in [pod for pod, _ in running.cluster.resizes()]
    assert running.condition("Applied")[:2] == ("False", "NotApplied")
    [(reason, message)] = [one for one in running.reported() if not one[0].startswith("Context")]
    assert reason == "NotResizable"
    assert message in running.condition("Applied")[2]
    assert "slam-2/slam restarts whenever its CPU changes" in message


def test_agents_leave_what_another_writer_insists_on(running):
    for _ in range(STRIKES + 1):
        running.cluster.edit("uid-slam", "slam", cpu="300m")
        running.settle()
        running.turn(CONFLICTING.longest + 1)
        running.settle()
    running.react(IMU, speed=0.3)
    [*_, plan] = running.session.plans()
    quotas = {target["task"]: (target["quota"], target["original"]) for target in plan["targets"]}
    assert quotas == {"slam": (0.3, 0.4), "speech": (0.2, 0.4)}
    assert running.limits() == {"slam": 300, "speech": 200}


def test_agents_receive_at_once_the_limit_that_another_writer_keeps_setting(running):
    """No sample arrives meanwhile: the plan stays the same."""
    running.session.agent(NODE, b'{"missing": {"CFS": [], "Realtime": []}}')
    running.settle()
    before = running.session.plans()[-1]
    for _ in range(STRIKES + 1):
        running.cluster.edit("uid-slam", "slam", cpu="300m")
        running.settle()
        running.turn(CONFLICTING.longest + 1)
        running.settle()
    now = running.session.plans()[-1]
    assert [target["quota"] for target in now["targets"] if target["task"] == "slam"] == [0.3]
    assert now["sequence"] == before["sequence"]


def test_agents_receive_a_pods_own_limit_at_once(running):
    before = running.session.plans()[-1]
    running.cluster.pods["uid-slam"]["spec"]["resources"] = {"limits": {"cpu": "600m"}}
    running.cluster._commit("uid-slam")
    running.settle()
    now = running.session.plans()[-1]
    assert [target["podLimit"] for target in now["targets"] if target["task"] == "slam"] == [0.6]
    assert (now["sequence"], now["edition"]) == (before["sequence"], before["edition"] + 1)


def test_thousands_of_pods_that_come_at_once_cost_one_placement(running, monkeypatch):
    placements = []

    def counted(*arguments, **more):
        placements.append(1)
        return claim(*arguments, **more)

    monkeypatch.setattr(binder, "claim", counted)
    for number in range(300):
        namespace = "lab" if number % 3 == 0 else "elsewhere"
        running.operator.pod_changed(a_pod(f"other-{number}", {"other": resources()}, namespace=namespace))
    running.turn()
    assert len(placements) == 1
    running.operator.pod_changed(a_pod("far", namespace="elsewhere"))
    running.turn()
    assert len(placements) == 1, "no policy is there"


def test_a_change_in_one_namespace_leaves_the_policies_of_others_alone(running):
    other = a_policy("other", tasks=[a_task("arm")], contexts=[], streams=[])
    other["metadata"]["namespace"] = "elsewhere"
    running.apply(other)
    running.settle()
    before = len(running.session.plans())
    running.cluster.create(a_pod("arm", {"arm": resources()}, namespace="elsewhere"))
    running.settle()
    [*_, last] = running.session.plans()[before:]
    assert {plan["policy"] for plan in running.session.plans()[before:] if plan} <= {"elsewhere/other", "lab/robot"}
    assert running.limits()["arm"] > 0
    assert last is not None


def test_an_invalid_pod_is_left_alone(running, caplog):
    running.operator.pod_changed(a_pod("odd", {"odd": cpu("1m", "many")}))
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}
    assert any("can't be parsed" in message and "'odd'" in message for message in caplog.messages)


def test_from_weights_back_to_limits(running):
    running.apply(
        a_policy(
            generation=2,
            enforcement={"control": "Weight"},
            contexts=[],
            tasks=[a_task("slam", priority=9), a_task("speech")],
        )
    )
    running.settle()
    running.apply(a_policy(generation=3))
    running.react(IMU, speed=0.3)
    assert running.limits() == {"slam": 800, "speech": 200}
    assert running.condition("Applied")[0] == "True"


def factor(running):
    running.turn(STATUS_INTERVAL)
    return running.cluster.statuses["lab/robot"]["nodes"][0]["requestFactor"]


def test_a_pod_that_comes_takes_room_from_requests_wherever_it_is(running):
    """Two tasks without a max: each could have all of the node's core."""
    running.apply(a_policy(generation=2, enforcement={"control": "Weight"}))
    running.settle()
    assert factor(running) == 0.5
    running.operator.pod_changed(a_pod("driver", {"driver": cpu("200m", None)}, namespace="kube-system"))
    running.settle()
    assert factor(running) == 0.4
    requests = [container["resources"]["requests"]["cpu"] for container in containers(running)]
    assert requests == ["200m", "200m"]
    running.operator.pod_gone("uid-driver")
    running.settle()
    assert factor(running) == 0.5


def containers(running):
    return [container for pod in running.cluster.pods.values() for container in pod["spec"]["containers"]]


def test_contexts_move_requests_but_not_the_factor(running):
    running.apply(a_policy(generation=2, enforcement={"control": "Weight"}))
    running.settle()
    for speed in (0.3, 0.0, 0.3):
        running.react(IMU, speed=speed)
        assert factor(running) == 0.5


def weights(running):
    """Those in the newest plan."""
    return {target["task"]: target["weight"] for target in running.session.plans()[-1]["targets"]}


def test_a_pod_that_comes_takes_its_request_from_the_weights(running):
    running.apply(a_policy(generation=2, enforcement={"control": "Weight"}))
    running.settle()
    assert weights(running) == {"slam": 0.5, "speech": 0.5}
    before = running.session.plans()[-1]
    running.operator.pod_changed(a_pod("driver", {"driver": cpu("200m", None)}, namespace="kube-system"))
    running.settle()
    now = running.session.plans()[-1]
    assert weights(running) == {"slam": 0.4, "speech": 0.4}
    assert now["sequence"] == before["sequence"], "the shares are the same"
    assert now["edition"] == before["edition"] + 1
    running.operator.pod_gone("uid-driver")
    running.settle()
    assert weights(running) == {"slam": 0.5, "speech": 0.5}
