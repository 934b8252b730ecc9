"""The operator from its watches' news to patches, statuses and messages, in virtual time."""

from __future__ import annotations

import json

import pytest
from prometheus_client import REGISTRY

from contextpolicy.actuators.following import SETTLED
from contextpolicy.bus.agent_watch import BOUND
from contextpolicy.bus.doubts import FIRST
from contextpolicy.cluster.agent_reports import NO_AGENT
from contextpolicy.telemetry.reporter import STATUS_INTERVAL
from contextpolicy.telemetry.status import NO_ROUTER
from tests.actuators.resize.test_vetting import OWNER, PATH, an_owner
from tests.cluster.builders import NODE
from tests.planning.builders import a_context
from tests.policies.builders import IMU, a_policy


def test_status_and_bus_agree(running):
    running.react(IMU, speed=0.3)
    running.turn(STATUS_INTERVAL)
    status, plan = running.cluster.statuses["lab/robot"], running.session.plans()[-1]
    assert status["activeContexts"] == plan["contexts"] == ["moving"]
    assert status["plan"]["sequence"] == plan["sequence"]
    assert {task["name"]: task["share"] for task in status["tasks"]} == {"slam": "800m", "speech": "200m"}
    assert {name: task["share"] for name, task in plan["tasks"].items()} == {"slam": 0.8, "speech": 0.2}
    assert running.condition("Ready") == ("True", "Working", "")


def test_resize_stages_are_published_on_the_bus(running):
    running.session.published.clear()
    running.react(IMU, speed=0.3)
    steps = [step for key, step in running.session.published if key == "contextpolicy/lab/robot/applied"]
    assert [(step["stage"], step["container"], step["cores"]) for step in steps] == [
        ("accepted", "lab/speech/speech", 0.2),
        ("accepted", "lab/slam/slam", 0.8),
        ("inForce", "lab/slam/slam", 0.8),
        ("inForce", "lab/speech/speech", 0.2),
    ]
    assert {step["sequence"] for step in steps} == {running.session.plans()[-1]["sequence"]}


# the router


def test_policies_wait_for_the_router_and_say_so(operator):
    operator.list_all()
    operator.apply(a_policy())
    operator.turn(0.5)
    assert operator.condition("Connected") == ("False", "NoRouter", NO_ROUTER)
    assert operator.condition("Accepted")[0] == "True"
    assert operator.cluster.calls == []
    operator.connect()
    operator.react(IMU, speed=0.3)
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert operator.condition("Ready")[0] == "True"


def test_an_invalid_policy_is_reported_without_a_router(operator):
    operator.apply(a_policy(tasks=[]))
    operator.turn(0.5)
    assert operator.condition("Accepted")[:2] == ("False", "Invalid")
    assert operator.condition("Connected")[0] == "False"


def test_a_bus_that_is_lost_after_it_was_there_is_reported_at_once(running):
    running.session.lose_router()
    running.turn(0.5)
    assert running.condition("Connected") == ("False", "NoRouter", NO_ROUTER)
    assert running.condition("Ready")[0] == "False"
    running.session.find_router("another")
    running.turn(0.5)
    assert running.condition("Connected")[0] == running.condition("Ready")[0] == "True"


# agents


def test_a_realtime_policy_without_agents_falls_back_and_says_why(operator):
    operator.govern(a_policy(enforcement={"scheduler": "Realtime"}))
    operator.react(IMU, speed=0.3)
    assert operator.limits() == {"slam": 800, "speech": 200}
    assert operator.condition("Realtime") == ("False", "Unavailable", f"node {NODE} falls back to CFS: {NO_AGENT}")
    assert [reason for reason, _ in operator.reported() if reason != "ContextEntered"] == ["RealtimeUnavailable"]


@pytest.mark.parametrize("confirming", [True, False])
def test_resizes_wait_only_for_an_agent_that_confirms(operator, confirming):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.session.confirming = confirming
    operator.govern(a_policy())
    operator.sample(IMU, speed=0.3)
    operator.turn(BOUND + 0.1)
    operator.settle()
    operator.sample(IMU, speed=0.0)
    operator.turn(SETTLED / 2)
    assert (operator.patches.jobs == []) is confirming


def requests(operator):
    containers = [container for pod in operator.cluster.pods.values() for container in pod["spec"]["containers"]]
    return {container["name"]: container["resources"]["requests"]["cpu"] for container in containers}


def test_requests_stay_weights_until_the_agent_confirms_a_plan(operator):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.session.confirming = False
    operator.govern(a_policy(enforcement={"control": "Weight"}, contexts=[]))
    operator.turn(BOUND)
    operator.settle()
    resized = requests(operator)
    assert resized != {"slam": "10m", "speech": "10m"}
    published = len(operator.session.plans())
    operator.turn(FIRST)
    operator.turn(BOUND)
    operator.settle()
    assert requests(operator) == resized
    [again] = operator.session.plans()[published:]
    assert again["edition"] > operator.session.plans()[published - 1]["edition"], "an agent takes no message twice"
    operator.session.confirming = True
    operator.turn(2 * FIRST)
    operator.settle()
    assert requests(operator) == {"slam": "10m", "speech": "10m"}


def test_a_weight_that_an_agent_cannot_write_is_not_applied(operator):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.list_all()
    operator.connect()
    operator.session.failed = ["containerd://slam"]
    operator.apply(a_policy(enforcement={"control": "Weight"}))
    operator.sample(IMU, speed=0.3)
    operator.turn(10.0)
    status, _, message = operator.condition("Applied")
    assert (status, "slam: the agent of node" in message, "can't write its weight" in message) == ("False", True, True)
    operator.session.failed = []
    operator.sample(IMU, speed=0.3)
    operator.turn(10.0)
    assert operator.condition("Applied")[0] == "True"


@pytest.mark.parametrize("failed", ["slam", "speech"])
def test_containers_the_agent_failed_to_set_are_resized_at_once(operator, failed):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.govern(a_policy())
    operator.sample(IMU, speed=0.0)
    operator.turn(2 * SETTLED)
    operator.settle()
    operator.session.failed = [f"containerd://{failed}"]
    operator.sample(IMU, speed=0.3)
    operator.turn(BOUND)
    operator.settle()
    after = {"slam": 800, "speech": 200}
    assert operator.limits() == {"slam": 500, "speech": 500} | {failed: after[failed]}
    operator.session.failed = []
    operator.sample(IMU, speed=0.0)
    operator.turn(BOUND)
    operator.settle()
    assert operator.limits()[failed] == after[failed], "the agent can again: resizes follow it"
    operator.turn(2 * SETTLED)
    operator.settle()
    assert operator.limits() == {"slam": 500, "speech": 500}


def reactions():
    labels = {"namespace": "lab", "name": "robot"}
    return REGISTRY.get_sample_value("contextpolicy_reaction_seconds_count", labels) or 0.0


@pytest.mark.parametrize("control", ["Suspend", "Weight", "Limit"])
def test_a_reaction_ends_when_the_agent_confirms_what_it_wrote(operator, control):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.list_all()
    operator.connect()
    moving = a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})
    operator.apply(a_policy(enforcement={"control": control}, contexts=[moving]))
    operator.sample(IMU, speed=0.0)
    operator.turn(2 * SETTLED)
    operator.settle()
    before = reactions()
    operator.sample(IMU, speed=0.3)
    operator.turn(SETTLED / 2)
    at_once = reactions() - before
    assert at_once == (1 if control == "Suspend" else 2), "under Suspend the task that stays active is left alone"
    operator.turn(2 * SETTLED)
    operator.settle()
    assert reactions() - before == at_once, "the resize that follows is no second reaction"


def test_failed_agent_write_is_in_force_once_the_kubelet_confirms(operator):
    operator.session.agents[NODE] = json.dumps({"missing": {"CFS": [], "Realtime": []}}).encode()
    operator.govern(a_policy(enforcement={"control": "Limit"}))
    operator.sample(IMU, speed=0.0)
    operator.turn(2 * SETTLED)
    operator.settle()
    operator.session.failed = ["containerd://slam"]
    before = reactions()
    operator.sample(IMU, speed=0.3)
    operator.turn(0.01)
    assert reactions() - before == 1
    operator.settle()
    assert reactions() - before == 2


# start and end


def test_closing_stops_everything_and_keeps_the_limits(running):
    running.react(IMU, speed=0.3)
    running.close()
    assert running.session.everything_declared() == []
    assert running.session.closed
    assert (running.loop.disposed, running.patches.ended, running.reports.ended) == (True, True, True)
    assert running.limits() == {"slam": 800, "speech": 200}


def test_closing_before_the_router_was_found(operator):
    operator.list_all()
    operator.close()
    assert operator.loop.disposed


# originals in other hands


def forge(operator, change):
    operator.cluster.change_originals("lab/robot", change)


FORGERIES = [{"uid-slam": None}, {"uid-slam": {"containers": {"slam": {"limit": "50m"}}}}]


@pytest.mark.parametrize("forgery", FORGERIES)
def test_originals_that_are_changed_while_the_operator_runs_are_written_again(running, forgery):
    running.react(IMU, speed=0.3)
    before = dict(running.cluster.policies["lab/robot"])
    forge(running, forgery)
    running.see()
    running.settle()
    assert running.cluster.policies["lab/robot"] == before
    [reported] = [message for reason, message in running.reported() if reason == "OriginalsChanged"]
    assert "has restored it" in reported
    forge(running, forgery)
    running.see()
    assert [reason for reason, _ in running.reported()].count("OriginalsChanged") == 1, "said once in a while"


def restarted(running, forgery, *, owned):
    """While the operator was away somebody changed the originals."""
    running.react(IMU, speed=0.3)
    if owned:
        running.cluster.pods["uid-slam"]["metadata"]["ownerReferences"] = [OWNER]
        running.cluster.owners[PATH] = an_owner("400m")
    forge(running, forgery)
    running.start()
    running.list_all()
    running.cluster.events.clear()


@pytest.mark.parametrize("forgery", FORGERIES)
def test_originals_forged_during_downtime_are_not_trusted(running, forgery):
    restarted(running, forgery, owned=True)
    running.connect()
    running.apply(a_policy())
    running.settle()
    [reported] = [message for reason, message in running.reported() if reason == "OriginalsUnproven"]
    assert "using request 10m, limit 400m from ReplicaSet slam-7d9f" in reported
    done = running.delete(a_policy())
    running.settle()
    assert (done.done(), running.limits()) == (True, {"slam": 400, "speech": 400})


def test_deleted_policy_with_emptied_originals_restores_from_the_owner(running):
    restarted(running, {"uid-slam": None, "uid-speech": None}, owned=True)
    done = running.delete(a_policy())
    running.settle()
    assert done.done()
    assert running.limits()["slam"] == 400
    reported = dict(running.reported())["OriginalsUnproven"]
    assert "lab/slam/slam: status.originals no longer has an entry; using request 10m, limit 400m from" in reported
    assert (
        "lab/speech/speech: status.originals no longer has an entry; no owner of the pod states its original"
        in reported
    )


@pytest.mark.parametrize("begin", ["apply", "delete"])
def test_paused_policy_with_emptied_originals_of_bare_pods_says_so(running, begin):
    restarted(running, {"uid-slam": None, "uid-speech": None}, owned=False)
    running.connect()
    getattr(running, begin)(a_policy(mode="Paused"))
    running.settle()
    reported = dict(running.reported())["OriginalsUnproven"]
    assert "lab/slam/slam: an operator resized it, and no status.originals has an entry for it; no owner" in reported


def test_own_signed_originals_are_trusted_after_a_restart(running):
    restarted(running, {}, owned=False)
    done = running.delete(a_policy())
    running.settle()
    assert (done.done(), running.limits()) == (True, {"slam": 400, "speech": 400})
    assert "OriginalsUnproven" not in dict(running.reported())
