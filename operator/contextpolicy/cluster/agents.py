"""What node agents report, and what it means for a policy that asks for realtime. Pure."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.planning.policy import RealtimeFallback, Scheduler

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.cluster.claims import Claim
    from contextpolicy.planning.policy import Policy

NO_AGENT = "no node agent runs there: install the chart with agent.enabled=true and agent.realtime=true"
UNREADABLE = "its node agent's report can't be read: operator and agent must be of one version"


def realtime_obstacle(report: bytes) -> str:
    """What the node of this report lacks for realtime; empty when nothing."""
    try:
        lacks = json.loads(report)["missing"][Scheduler.REALTIME]
        return "; ".join(str(one) for one in lacks)
    except (ValueError, TypeError, KeyError):
        return UNREADABLE


def with_realtime(policy: Policy, claim: Claim, obstacles: Mapping[str, str]) -> Claim:
    """The claim with each of its nodes that can't do realtime in CFS, or without it when the policy rules that out.

    `obstacles` has an entry for each node with an agent, empty where realtime works.
    """
    if policy.scheduler is not Scheduler.REALTIME:
        return claim
    placement = claim.placement
    unable = {node: problem for node in placement.allocatable if (problem := obstacles.get(node, NO_AGENT))}
    if policy.realtime_fallback is RealtimeFallback.CFS:
        messages = [f"node {node} falls back to CFS: {problem}" for node, problem in sorted(unable.items())]
        return replace(claim, placement=replace(placement, fair_only=frozenset(unable)), realtime=messages)
    kept = replace(
        placement,
        allocatable={node: cpu for node, cpu in placement.allocatable.items() if node not in unable},
        containers=tuple(container for container in placement.containers if container.node not in unable),
    )
    messages = [f"node {node} is left alone: {problem}" for node, problem in sorted(unable.items())]
    return replace(claim, placement=kept, realtime=messages)
