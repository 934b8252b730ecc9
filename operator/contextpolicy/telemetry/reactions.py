"""Matches each resize to the sample that caused it, so that every reaction is measured exactly once. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import Cpu
    from contextpolicy.planning.allocation.plan import Plan

STAGES = ("patch", "status")
"""The API has accepted the limit, and the kubelet reports it in force."""


@dataclass(slots=True)
class Reaction:
    """A container's new share in millicores, and when (monotonic s) its sample came, its plan, its patch was accepted.

    `ahead` are the stages that it has not reached yet; `accepted` stays None when its limit was in force before the API
    had answered, which happens when the agent is faster.
    """

    share: int
    arrived: float
    planned: float
    accepted: float | None = None
    ahead: set[str] = field(default_factory=lambda: set(STAGES))


class Reactions:
    """The changes that samples caused, by policy and container, until they are in force.

    Resizing to the same share again, because somebody else changed it or a container moved, is no reaction to a sample.
    """

    def __init__(self) -> None:
        self._plans: dict[str, Plan] = {}
        self._changes: dict[str, dict[str, Reaction]] = {}

    def plan(self, policy: str, plan: Plan, now: float) -> None:
        """Take a new plan, made `now`; changes of an earlier plan that this one keeps are still being tracked."""
        before = self._plans.get(policy)
        # After the first plan of a run nothing is known about the containers' shares before it: it may change none.
        known = before.containers if before is not None and plan.sequence > before.sequence else {}
        kept = self._changes.get(policy, {})
        changes: dict[str, Reaction] = {}
        for container, share in _resized(plan).items():
            if known.get(container) == share:
                changes |= {container: kept[container]} if container in kept else {}
            elif container in known and plan.arrived is not None:
                changes[container] = Reaction(share, plan.arrived, now)
        self._plans[policy], self._changes[policy] = plan, changes

    def reach(self, policy: str, container: str, stage: str, cpu: Cpu) -> Reaction | None:
        """The reaction to a sample, if a sample caused this and it reaches `stage` for the first time, else None.

        A patch from an older plan, or an intermediate step towards the share, does not count.
        """
        change = self._changes.get(policy, {}).get(container)
        if change is None or stage not in change.ahead or change.share not in (cpu.limit, cpu.request):
            return None
        change.ahead.discard(stage)
        return change

    def drop(self, policy: str, container: str) -> None:
        """Somebody else changed the container: its next resize is no reaction to a sample."""
        self._changes.get(policy, {}).pop(container, None)

    def forget(self, policy: str) -> None:
        """The policy is gone."""
        self._plans.pop(policy, None)
        self._changes.pop(policy, None)


def _resized(plan: Plan) -> dict[str, int]:
    """The shares that become limits or requests; realtime nodes are left to the agent."""
    nodes = (node for node in plan.nodes.values() if node.scheduler is Scheduler.CFS)
    return {identity: share for node in nodes for identity, share in node.containers.items()}
