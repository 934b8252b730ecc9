"""What node agents report, and what it means for policies. Pure."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import RealtimeFallback, Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.policy.spec import Policy

NO_AGENT = "no node agent runs there: install the chart with agent.enabled=true and agent.realtime=true"
UNREADABLE = "its node agent's report can't be read: operator and agent must be of one version"
SILENT = "its node agent did not answer yet: it is asked again until it does"


@dataclass(frozen=True, slots=True)
class AgentReport:
    """What a node's agent lacks for CPU limits and for realtime; empty when nothing."""

    limits: str
    realtime: str


NO_ANSWER = AgentReport(SILENT, SILENT)
"""What stands for the report of an agent that lives and has not said what it can do."""


def read_report(payload: bytes) -> AgentReport:
    """An agent's report; one that can't be read lacks everything."""
    try:
        missing = json.loads(payload)["missing"]
        return AgentReport("; ".join(missing[Scheduler.CFS]), "; ".join(missing[Scheduler.REALTIME]))
    except (ValueError, TypeError, KeyError):
        return AgentReport(UNREADABLE, UNREADABLE)


def with_agents(policy: Policy, claim: Claim, reports: Mapping[str, AgentReport]) -> Claim:
    """The claim with what its nodes' agents can do.

    A node that can't do realtime divides as CFS does, or is left out when the policy rules that out.
    """
    able = frozenset(node for node in claim.placement.allocatable if node in reports and not reports[node].limits)
    claim = replace(claim, agents=able)
    return _with_realtime(policy, claim, reports) if policy.scheduler is Scheduler.REALTIME else claim


def _with_realtime(policy: Policy, claim: Claim, reports: Mapping[str, AgentReport]) -> Claim:
    placement = claim.placement
    obstacles = {node: reports[node].realtime if node in reports else NO_AGENT for node in placement.allocatable}
    unable = {node: obstacle for node, obstacle in sorted(obstacles.items()) if obstacle}
    if policy.realtime_fallback is RealtimeFallback.CFS:
        messages = [f"node {node} falls back to CFS: {obstacle}" for node, obstacle in unable.items()]
        return replace(claim, placement=replace(placement, fair_only=frozenset(unable)), realtime=messages)
    kept = replace(
        placement,
        allocatable={node: cpu for node, cpu in placement.allocatable.items() if node not in unable},
        containers=tuple(container for container in placement.containers if container.node not in unable),
    )
    messages = [f"node {node} is left alone: {obstacle}" for node, obstacle in unable.items()]
    return replace(claim, placement=kept, realtime=messages)
