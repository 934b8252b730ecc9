"""Which resize is the reaction to which sample, so that the way from one to the other is measured, and once. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from contextpolicy.cluster.pods import Cpu
    from contextpolicy.planning.plan import Plan

STAGES = ("patch", "status")
"""The API has accepted the limit, and the kubelet reports it in force."""


@dataclass(slots=True)
class _Change:
    """A container's new share, with the stages that it has still to reach."""

    share: int
    arrived: float
    ahead: set[str] = field(default_factory=lambda: set(STAGES))


class Reactions:
    """What samples changed, by policy and container, until it is in force.

    What is resized to the same share again, because somebody else had changed it or a container was moved, is the
    reaction to no sample, however long ago the last one came.
    """

    def __init__(self) -> None:
        self._plans: dict[str, Plan] = {}
        self._changes: dict[str, dict[str, _Change]] = {}

    def plan(self, policy: str, plan: Plan) -> None:
        """A new plan counts; what an earlier one changed and this one leaves alone is still on its way."""
        before = self._plans.get(policy)
        # The first plan of a run says nothing about what the containers had: it may change none of them.
        known = before.containers if before is not None and plan.sequence > before.sequence else {}
        kept = self._changes.get(policy, {})
        changes: dict[str, _Change] = {}
        for container, share in _resized(plan).items():
            if known.get(container) == share:
                changes |= {container: kept[container]} if container in kept else {}
            elif container in known and plan.arrived is not None:
                changes[container] = _Change(share, plan.arrived)
        self._plans[policy], self._changes[policy] = plan, changes

    def reach(self, policy: str, container: str, stage: str, cpu: Cpu) -> float | None:
        """When the sample arrived that asked for this, if it did and this is the first time that `stage` is reached.

        A patch that an older plan sent, or one on the way to the share, is not what the sample asked for.
        """
        change = self._changes.get(policy, {}).get(container)
        if change is None or stage not in change.ahead or change.share not in (cpu.limit, cpu.request):
            return None
        change.ahead.discard(stage)
        return change.arrived

    def drop(self, policy: str, container: str) -> None:
        """Somebody else changed the container: what is resized from now on is no reaction to a sample."""
        self._changes.get(policy, {}).pop(container, None)

    def forget(self, policy: str) -> None:
        """The policy is gone."""
        self._plans.pop(policy, None)
        self._changes.pop(policy, None)


def _resized(plan: Plan) -> dict[str, int]:
    """The shares that become limits or requests; those in realtime are the agent's."""
    nodes = (node for node in plan.nodes.values() if node.scheduler is Scheduler.CFS)
    return {identity: share for node in nodes for identity, share in node.containers.items()}
