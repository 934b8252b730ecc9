"""What node agents report, and what it means for policies. Pure."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from contextpolicy.cluster.container_names import container_id
from contextpolicy.policy.spec import Control, RealtimeFallback, Scheduler

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.policy.spec import Policy

Stamp = tuple[int, int, int]
"""Run, sequence and edition, which identify a plan and order the plans of one source."""

NO_AGENT = "no node agent runs there: install the chart with agent.enabled=true and agent.realtime=true"
UNREADABLE = "its node agent's report can't be read: operator and agent must have the same version"
MOST_PROCESSORS = 8192
"""More than Linux can be built for (NR_CPUS)."""
SHORTEST_PERIOD, LONGEST_PERIOD = 0.001, 1.0
"""Seconds: what the kernel takes as the period of a quota."""
LATE = "its node agent did not confirm a plan in time: it is frozen, too slow, or does not accept the operator's plans"
SILENT = "its node agent has not answered yet; retrying"


@dataclass(frozen=True, slots=True)
class AgentReport:
    """What a node's agent lacks for CPU limits and for realtime (empty when nothing), and what it found on the node.

    `unlimited` says why the kernel can't limit CPU time, if so; `quota_period` is the kubelet's, in seconds.
    """

    limits: str
    realtime: str
    unlimited: str = ""
    processors: int | None = None
    quota_period: float | None = None


NO_ANSWER = AgentReport(SILENT, SILENT)
"""The report assumed for an agent that is alive but has not reported yet."""

NOT_CONFIRMING = AgentReport(LATE, LATE)
"""The report assumed for an agent that is alive but does not confirm plans in time."""


MOST_BYTES = 64 << 10
"""Bytes of a report or a confirmation; more is not read. One with MOST_NAMED containers has a sixth of that."""
MOST_TEXT = 500
"""Characters kept of each text in a report."""
MOST_NAMED = 100
"""Containers that a confirmation names at most, in some 10 kB."""
MOST_REASON = 64
"""Characters kept of why a container failed: it is one word."""
ALL = "*"
"""Stands for all containers where too many failed to name each."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """An agent has carried out the plan of this stamp, but for the containers that `failed`: the reason by their ID."""

    policy: str
    stamp: Stamp
    failed: Mapping[str, str] = field(default_factory=dict)


def write_confirmation(said: Confirmation) -> bytes:
    """The message that `read_confirmation` reads."""
    failed = said.failed if len(said.failed) <= MOST_NAMED else {ALL: next(iter(said.failed.values()))}
    return json.dumps({"policy": said.policy, "stamp": said.stamp, "failed": failed}).encode()


def read_confirmation(payload: bytes) -> Confirmation | None:
    """An agent's confirmation; None when it can't be read."""
    try:
        said = json.loads(_bounded(payload))
        run, sequence, edition = (int(number) for number in said["stamp"])
        failed = {str(container): str(reason)[:MOST_REASON] for container, reason in said.get("failed", {}).items()}
        policy = str(said["policy"])[:MOST_TEXT]
        return Confirmation(policy, (run, sequence, edition), failed) if len(failed) <= MOST_NAMED else None
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return None


def not_set(failures: Mapping[str, Collection[str]], pods: Iterable[PodView]) -> frozenset[str]:
    """The containers that agents could not set, as planning names them; `failures` are their IDs by node.

    One that is gone or was restarted since is none of them.
    """
    return frozenset(
        container_id(pod, container.name)
        for pod in pods
        for container in pod.containers
        if ALL in (failed := failures.get(pod.node, ())) or container.container_id in failed
    )


def unwritten(policy: Policy, failures: Mapping[str, Mapping[str, str]], pods: Iterable[PodView]) -> list[str]:
    """What agents could not write, and no resize can set in their place: weights; `failures` as in `not_set`."""
    if policy.enforcement.control is not Control.WEIGHT:
        return []
    shown = {name: pod.node for pod in pods for name in not_set(failures, [pod])}
    return [
        f"{name}: the agent of node {node} can't write its weight: {', '.join(sorted(set(failures[node].values())))}"
        for name, node in sorted(shown.items())
    ]


def read_report(payload: bytes) -> AgentReport:
    """An agent's report; an unreadable one counts as lacking everything."""
    try:
        report = json.loads(_bounded(payload))
        missing, processors, period = report["missing"], report.get("processors"), report.get("quotaPeriod")
        return AgentReport(
            "; ".join(missing[Scheduler.CFS])[:MOST_TEXT],
            "; ".join(missing[Scheduler.REALTIME])[:MOST_TEXT],
            str(report.get("unlimited", ""))[:MOST_TEXT],
            int(_within(processors, 1, MOST_PROCESSORS)) if processors else None,
            float(_within(period, SHORTEST_PERIOD, LONGEST_PERIOD)) if period else None,
        )
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return AgentReport(UNREADABLE, UNREADABLE)


def _bounded(payload: bytes) -> bytes:
    """The payload; ValueError when it is longer than any that an agent sends."""
    if len(payload) > MOST_BYTES:
        raise ValueError(f"{len(payload)} bytes")
    return payload


def _within(number: float, least: float, most: float) -> float:
    """The number; ValueError when it is not from `least` to `most`, as NaN is not."""
    if not least <= number <= most:
        raise ValueError(f"{number!r:.80}: expected a number from {least} to {most}")
    return number


def writing(reports: Mapping[str, AgentReport]) -> frozenset[str]:
    """The nodes whose agents write limits and weights."""
    return frozenset(node for node, report in reports.items() if not report.limits)


def with_agents(policy: Policy, claim: Claim, reports: Mapping[str, AgentReport]) -> Claim:
    """The claim with what its nodes' agents can do.

    A node that can't do realtime divides as CFS does, or is left out when the policy rules that out.
    """
    own = {node: reports[node] for node in claim.placement.allocatable if node in reports}
    agents = writing(own)
    placement = replace(
        claim.placement,
        agents=agents,
        processors={node: report.processors for node, report in own.items() if report.processors},
        quota_periods={node: report.quota_period for node, report in own.items() if report.quota_period},
    )
    useless = {node: report.unlimited for node, report in own.items() if report.unlimited}
    claim = replace(
        claim,
        agents=agents,
        attended=frozenset(own),
        placement=placement,
        unlimited=[f"node {node} can't limit CPU time: {why}" for node, why in sorted(useless.items())],
    )
    return _with_realtime(policy, claim, reports) if policy.enforcement.scheduler is Scheduler.REALTIME else claim


def _with_realtime(policy: Policy, claim: Claim, reports: Mapping[str, AgentReport]) -> Claim:
    placement = claim.placement
    obstacles = {node: reports[node].realtime if node in reports else NO_AGENT for node in placement.allocatable}
    unable = {node: obstacle for node, obstacle in sorted(obstacles.items()) if obstacle}
    if policy.enforcement.realtime_fallback is RealtimeFallback.CFS:
        messages = [f"node {node} falls back to CFS: {obstacle}" for node, obstacle in unable.items()]
        return replace(claim, placement=replace(placement, fair_only=frozenset(unable)), realtime=messages)
    kept = replace(
        placement,
        allocatable={node: cpu for node, cpu in placement.allocatable.items() if node not in unable},
        containers=tuple(container for container in placement.containers if container.node not in unable),
    )
    messages = [f"node {node} is left alone: {obstacle}" for node, obstacle in unable.items()]
    return replace(claim, placement=kept, realtime=messages)
