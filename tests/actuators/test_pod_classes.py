"""What happens to each class of pods under each control, with and without an agent: docs/reference/pods.md."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from contextpolicy.actuators.order import Order, order_of
from contextpolicy.actuators.resize.pod_state import PodState
from contextpolicy.actuators.resize.takeover import LEAST_REQUEST
from contextpolicy.actuators.resize.targets import target_cpu
from contextpolicy.actuators.resize.tracked_pod import TrackedPod
from contextpolicy.bus.plan_message import message
from contextpolicy.cluster.agent_reports import AgentReport, with_agents, writing
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.pods import Cpu
from tests.cluster.builders import NODE, a_pod, cpu
from tests.cluster.claiming import claim
from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.cluster.pods import PodView

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "pods.md"
HEADER = "| pod | control | agent | active | suspended |"
PODS: dict[str, Any] = {
    "Burstable": ({"slam": cpu("10m", "500m")}, "Burstable"),
    "Burstable, request above 10m": ({"slam": cpu("100m", "500m")}, "Burstable"),
    "Burstable without a limit": ({"slam": cpu("10m", None)}, "Burstable"),
    "Guaranteed": ({"slam": cpu("500m", "500m", ("64Mi", "64Mi"))}, "Guaranteed"),
    "BestEffort": ({"slam": cpu(None, None, None)}, "BestEffort"),
}
ACTIVE, SUSPENDED = 0.0, 1.0
SLAM = "lab/slam/slam"
SHARE = 1990
"""Of the active task, in thousandths of a core: the other one, which is always suspended, leaves it all but 10."""


class Row(NamedTuple):
    pod: str
    control: str
    agent: str
    active: str
    suspended: str


def table_rows() -> list[Row]:
    _, _, after = PAGE.read_text(encoding="utf-8").partition(f"{HEADER}\n")
    lines = after.partition("\n\n")[0].splitlines()[1:]
    return [Row(*(cell.strip() for cell in line.strip("|").split("|"))) for line in lines]


def outcome(pod_class: str, control: str, agent: str, speed: float) -> str:
    """Policy, claim, plan, then what the operator asks of the API and what the agent is to write, in words."""
    policy = a_policy(
        streams=[a_stream("imu")],
        tasks=[a_task("slam"), a_task("other", idle=0)],
        contexts=[a_context("halted", "imu.speed > 0.5", {"slam": {"suspend": True}})],
        enforcement={"control": control},
    )
    containers, qos = PODS[pod_class]
    pods = [view(a_pod("slam", containers, qos=qos)), view(a_pod("other", {"other": cpu("10m", "500m")}))]
    reports = {NODE: AgentReport("", "")} if agent == "yes" else {}
    own = claim([policy], pods, {NODE: 2000}, agents=writing(reports))[policy.reference]
    own = with_agents(policy, own, reports)
    story = Story(policy, own.placement)
    story.sample("imu", at=1, speed=speed)
    plan, claimed = story.last, own.placement.containers
    reported = "slam" in own.obstacles or any(shortfall.task == "slam" for shortfall in plan.shortfalls)
    if SLAM not in plan.containers:
        done = "left alone"
    else:
        order = order_of(policy, claimed, plan.nodes, agents=own.agents)
        targets = message(policy, 1, plan, claimed, pods, own.most_weight)["targets"] if agent == "yes" else []
        before = pods[0].containers[0].spec
        parts = [*written(targets, before), *asked(order, pods[0], before)]
        done = "; ".join(parts) or "untouched"
    return done + "; reported" * reported


def asked(order: Order, pod: PodView, before: Cpu) -> Iterator[str]:
    """What is asked of the API."""
    after = target_cpu(order, SLAM, TrackedPod(PodState(pod)), pod.containers[0], None)
    if after == before:
        return
    if SLAM in order.requests and after.request != after.limit:
        request = "least request" if after.request == LEAST_REQUEST else "request by weight"
        yield f"API: {request}" + f", limit {amount(after.limit)}" * (after.limit != before.limit)
    else:
        yield f"API: {'request and ' * (after.request != before.request)}limit {amount(after.limit)}"


def written(targets: Iterable[dict[str, Any]], before: Cpu) -> Iterator[str]:
    """What the agent is to write."""
    for target in targets:
        if target["pod"] == "slam":
            quota = None if target["quota"] is None else round(target["quota"] * 1000)
            weights = {None: [], 0: ["least weight"]}.get(target["weight"], ["weight"])
            quotas = [f"quota {amount(quota)}" + ", held" * target["held"]] * (quota != before.limit)
            if weights or quotas:
                yield f"cgroup: {', '.join([*weights, *quotas])}"


def amount(value: int | None) -> str:
    return "= share" if value == SHARE else f"{value}m"


def test_a_pod_that_is_guaranteed_as_a_whole_gets_no_limit_for_its_container():
    """It could never go again."""
    whole = a_pod("slam", {"slam": cpu(None, None, None)}, qos="Guaranteed")
    whole["spec"]["resources"] = {kind: {"cpu": "1", "memory": "64Mi"} for kind in ("requests", "limits")}
    order = Order("lab/robot", frozenset({SLAM}), {SLAM: 10}, {NODE: 2000})
    pod = TrackedPod(PodState(view(whole)))
    assert target_cpu(order, SLAM, pod, pod.view.containers[0], None) == Cpu(None, None)


ROWS = table_rows()


def test_the_table_has_a_row_for_each_case():
    cases = list(product(PODS, ("Suspend", "Weight", "Limit"), ("no", "yes")))
    assert [(row.pod, row.control, row.agent) for row in ROWS] == cases


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.pod}-{row.control}-{row.agent}")
def test_an_active_task(row):
    assert outcome(row.pod, row.control, row.agent, ACTIVE) == row.active


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.pod}-{row.control}-{row.agent}")
def test_a_suspended_task(row):
    assert outcome(row.pod, row.control, row.agent, SUSPENDED) == row.suspended
