"""Messages of the bus: those that are orders are read exactly, everything else is refused and harms nobody."""

from __future__ import annotations

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.agent.admission import Admission
from contextpolicy.agent.node_orders import Manner, NodeOrder, OrderTarget, read
from contextpolicy.bus.plan_message import LARGEST_PLAN, message
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.errors import OrderError
from contextpolicy.planning.allocation.placement import Container, Placement
from contextpolicy.policy.spec import Mode, RealtimePolicy, Scheduler
from tests.agent.builders import NODE, POLICY, SLAM, SPEECH, a_message, a_target
from tests.cluster import builders as cluster
from tests.planning.builders import Story, a_context, a_policy, a_task


def test_an_order_has_what_this_node_must_do():
    message = a_message(
        a_target(SLAM, 0.99, limit=0.5),
        a_target(SPEECH, 0.01, task="speech"),
        a_target("c" * 64, 0.4, task="chat", node="node-2"),
        sequence=7,
        suspended=("speech",),
    )
    assert read(message, POLICY, NODE) == NodeOrder(
        policy=POLICY,
        stamp=(1, 7, 0),
        mode=Mode.ENFORCE,
        scheduler=Scheduler.CFS,
        capacity=1000,
        targets=(
            OrderTarget(
                "uid-a",
                "Burstable",
                f"containerd://{SLAM}",
                990,
                500,
                suspended=False,
                weight=None,
                quota=990,
                held=False,
                original=500,
            ),
            OrderTarget(
                "uid-b",
                "Burstable",
                f"containerd://{SPEECH}",
                10,
                None,
                suspended=True,
                weight=None,
                quota=10,
                held=False,
                original=500,
            ),
        ),
    )


def test_realtime_period_and_policy_come_from_the_message():
    order = read(a_message(a_target(), realtime={"period": 1, "policy": "FIFO"}), POLICY, NODE)
    assert order.manner == Manner(1_000_000, RealtimePolicy.FIFO)


@pytest.mark.parametrize("wrong", [{"period": 1.5}, {"period": 0.001}, {"period": "1s"}, {"policy": "IDLE"}])
def test_invalid_realtime_settings_are_refused(wrong):
    with pytest.raises(OrderError):
        read(a_message(a_target(), realtime={"period": 0.1, "policy": "RR"} | wrong), POLICY, NODE)


def test_scheduler_of_the_node_overrides_the_policys():
    nodes = {NODE: {"capacity": 1.0, "scheduler": "CFS"}}
    assert read(a_message(scheduler="Realtime", nodes=nodes), POLICY, NODE).scheduler is Scheduler.CFS


def a_starting_pod(task):
    pod = cluster.a_pod(task)
    del pod["status"]["containerStatuses"]
    return view(pod)


@given(st.integers(1, 1024), st.integers(10, 939))
def test_a_share_in_cores_comes_back_as_the_same_part_of_the_period(processors, part):
    """From the plan over the bus to the agent, on every size of node."""
    parts = {"slam": part, "speech": 949 - part, "chat": 1}
    tasks = [a_task(name, priority=part) for name, part in parts.items()]
    contexts = [a_context("quiet", "true", {"chat": {"suspend": True}})]
    policy = a_policy(tasks=tasks, contexts=contexts, enforcement={"scheduler": "Realtime"})
    containers = tuple(Container(f"lab/{task}/{task}", task, cluster.NODE) for task in parts)
    plan = Story(policy, Placement({cluster.NODE: processors * 1000}, containers)).last
    sent = message(policy, 1, plan, containers, map(a_starting_pod, parts), {cluster.NODE: processors * 1000})
    assert sent["tasks"]["slam"]["share"] == part * processors / 1000
    heard = read(msgspec.json.encode(sent), policy.reference, cluster.NODE)
    assert [target.part(processors) for target in heard.targets] == list(parts.values())
    assert Admission(lambda: processors).admit(heard, signed=1) == heard


def test_message_without_this_node_has_no_targets():
    assert read(a_message(a_target(node="node-2")), POLICY, "node-3").targets == ()


def test_a_container_that_starts_has_no_id_yet():
    assert read(a_message(a_target(containerId="")), POLICY, NODE).targets[0].container_id == ""


@pytest.mark.parametrize(
    "changes",
    [
        {"cores": 0},
        {"cores": 0.0001},
        {"cores": 1e9},
        {"cores": float("nan")},
        {"cores": "1"},
        {"uid": "../../../etc"},
        {"uid": 5},
        {"qos": "../.."},
        {"containerId": 5},
        {"containerId": "containerd://../../../x"},
        {"task": "unknown"},
        {"task": []},
        {"limit": "lots"},
    ],
)
def test_invalid_target_rejects_the_message(changes):
    good = json.loads(a_message(a_target()))
    good["targets"][0] |= changes
    with pytest.raises(OrderError) as caught:
        read(json.dumps(good).encode(), POLICY, NODE)
    assert caught.value.reason == "Unreadable"


@pytest.mark.parametrize(
    "changes",
    [
        {"run": -1},
        {"run": 1.5},
        {"run": None},
        {"run": True},
        {"sequence": "1"},
        {"mode": "Destroy"},
        {"scheduler": 5},
        {"targets": [a_target(weight=-1)]},
        {"targets": [a_target(quota=-1)]},
        {"targets": [a_target(held=1)]},
        {"tasks": []},
        {"nodes": []},
        {"nodes": {NODE: []}},
        {"nodes": {NODE: {"capacity": 0}}},
        {"targets": None},
        {"targets": [1]},
        {"targets": [{}]},
    ],
)
def test_an_invalid_message_is_refused(changes):
    with pytest.raises(OrderError):
        read(a_message(a_target(), **changes), POLICY, NODE)


@pytest.mark.parametrize(("cores", "taken"), [(0.6, 600), (0.0, None), (None, None)])
def test_an_order_has_the_limit_of_a_pod_as_a_whole(cores, taken):
    [target] = read(a_message(a_target(podLimit=cores)), POLICY, NODE).targets
    assert target.pod_limit == taken


@pytest.mark.parametrize("field", ["quota", "original", "limit"])
@pytest.mark.parametrize(
    ("cores", "taken"), [(1500.0, 1_024_000), (1024.0, 1_024_000), (0.0, None), (0.0001, 1), (None, None)]
)
def test_excessive_limit_does_not_reject_the_plan(field, cores, taken):
    good, odd = a_target(SLAM, 0.9), a_target(SPEECH, 0.01, task="speech") | {field: cores}
    first, second = read(a_message(good, odd), POLICY, NODE).targets
    assert (first.quota, getattr(second, field)) == (900, taken)


def test_a_plan_for_thousands_of_containers_is_read():
    targets = [a_target(f"{n:064x}", 0.01, uid=f"uid-{n:032x}", node=f"node-{n // 10}") for n in range(5000)]
    payload = a_message(*targets)
    assert 1 << 20 < len(payload) <= LARGEST_PLAN
    assert len(read(payload, POLICY, NODE).targets) == 10


def test_a_message_on_the_key_of_another_policy_is_refused():
    with pytest.raises(OrderError, match="robot/other"):
        read(a_message(policy="robot/other"), POLICY, NODE)


@pytest.mark.parametrize(
    "payload",
    [b"", b"\xff\xfe", b"null", b"[]", b'"x"', b"1", b"[" * 100_000, b"{" * 2000, b"1" * 5000, b" " * (5 << 20)],
)
def test_invalid_plans_are_refused(payload):
    with pytest.raises(OrderError):
        read(payload, POLICY, NODE)
