"""Matches what comes into force to the sample that caused it, so that every reaction is measured exactly once. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.actuators.resize.targets import request_below
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from contextpolicy.cluster.pods import Cpu
    from contextpolicy.planning.allocation.plan import Plan

STAGES = ("patch", "status")
"""The API has accepted the change; the node has it in force, as its agent confirms or the kubelet reports."""


@dataclass(slots=True)
class Reaction:
    """A container's new share in millicores, and when (monotonic s) its sample came, its plan, its patch was accepted.

    `sequence` is that of the plan that changed the share. `request` is what the share means for the container's CPU
    request, where requests are weights and scaled; None where the share itself is patched. `released` is the limit that
    it had while suspended, where the share is only a figure since: it gets back whatever it had before any policy.

    `ahead` are the stages that it has not reached yet; `accepted` stays None when its limit was in force before the API
    had answered, which happens when the agent is faster.
    """

    share: int
    arrived: float
    planned: float
    sequence: int
    request: int | None = None
    released: int | None = None
    accepted: float | None = None
    ahead: set[str] = field(default_factory=lambda: set(STAGES))

    def asks_for(self, cpu: Cpu) -> bool:
        """Whether these resources are what the share means."""
        if self.released is not None:
            return cpu.limit is not None and (cpu.limit == self.share or cpu.limit != self.released)
        scaled = self.request is not None and cpu.request == request_below(self.request, cpu.limit)
        return scaled or self.share in (cpu.limit, cpu.request)


class _Confirmed(NamedTuple):
    """The last plan that a node's agent has confirmed, when it did, and the containers that it could not set."""

    sequence: int
    at: float
    failed: Collection[str]


class Reactions:
    """The changes that samples caused, by policy and container, until they are in force.

    Resizing to the same share, because another writer changed it or a container moved, is not a reaction to a sample.
    """

    def __init__(self) -> None:
        self._plans: dict[str, Plan] = {}
        self._enforced: dict[str, dict[str, int | None]] = {}
        self._changes: dict[str, dict[str, Reaction]] = {}
        self._confirmed: dict[str, dict[str, _Confirmed]] = {}

    def plan(
        self,
        policy: str,
        plan: Plan,
        now: float,
        left_alone: Collection[str] = (),
        requests: Mapping[str, int] = MappingProxyType({}),
    ) -> None:
        """Take a new plan, made `now`; changes of an earlier plan that this one keeps are still being tracked.

        For containers that are `left_alone` the share is only a figure; `requests` are those that are weights.
        """
        before = self._plans.get(policy)
        # After the first plan of a run nothing is known about the containers' shares before it: it may change none.
        known = self._enforced[policy] if before is not None and plan.sequence > before.sequence else {}
        kept = self._changes.get(policy, {})
        shares = _resized(plan)
        enforced = {container: None if container in left_alone else share for container, share in shares.items()}
        changes: dict[str, Reaction] = {}
        for container, share in shares.items():
            if container in known and known[container] == enforced[container]:
                if container in kept:
                    kept[container].share, kept[container].request = share, requests.get(container)
                    changes[container] = kept[container]
            elif container in known and plan.arrived is not None:
                released = known[container] if enforced[container] is None else None
                request = requests.get(container)
                changes[container] = Reaction(share, plan.arrived, now, plan.sequence, request, released)
        self._plans[policy], self._enforced[policy], self._changes[policy] = plan, enforced, changes
        confirmed = self._confirmed.get(policy, {})
        self._confirmed[policy] = {node: said for node, said in confirmed.items() if _matters(node, said, plan)}

    def confirm(self, policy: str, node: str, sequence: int, at: float, failed: Collection[str] = ()) -> None:
        """The node's agent has carried out this plan, but for the containers that `failed`."""
        said, plan = _Confirmed(sequence, at, failed), self._plans.get(policy)
        if plan is None or _matters(node, said, plan):
            self._confirmed.setdefault(policy, {})[node] = said

    def confirmed(self, policy: str) -> Iterator[tuple[Reaction, float]]:
        """The reactions that agents' confirmations have ended, and when: each once.

        An agent may confirm a plan before we have taken it; what that plan changes must not count until then.
        """
        plan, changes = self._plans.get(policy), self._changes.get(policy, {})
        for node, said in self._confirmed.get(policy, {}).items():
            if plan is None or said.sequence > plan.sequence or node not in plan.nodes:
                continue
            for container in plan.nodes[node].containers.keys() & changes.keys() - set(said.failed):
                change = changes[container]
                if "status" in change.ahead and change.sequence <= said.sequence:
                    change.ahead.discard("status")
                    yield change, said.at

    def reach(self, policy: str, container: str, stage: str, cpu: Cpu) -> Reaction | None:
        """The reaction to a sample, if a sample caused this and it reaches `stage` for the first time, else None.

        A patch from an older plan, or an intermediate step towards the share, does not count.
        """
        change = self._changes.get(policy, {}).get(container)
        if change is None or stage not in change.ahead or not change.asks_for(cpu):
            return None
        change.ahead.discard(stage)
        return change

    def drop(self, policy: str, container: str) -> None:
        """Another writer changed the container: its next resize is no reaction to a sample."""
        self._changes.get(policy, {}).pop(container, None)

    def lose(self, pod: str) -> None:
        """The pod, `namespace/name`, is gone: one that takes its place reacts to no sample from before."""
        for changes in self._changes.values():
            for container in [container for container in changes if container.startswith(f"{pod}/")]:
                del changes[container]

    def forget(self, policy: str) -> None:
        """The policy is gone."""
        self._plans.pop(policy, None)
        self._enforced.pop(policy, None)
        self._changes.pop(policy, None)
        self._confirmed.pop(policy, None)


def _matters(node: str, said: _Confirmed, plan: Plan) -> bool:
    """Whether the node has containers in the plan, or may have some in the later plan that it has confirmed."""
    return node in plan.nodes or said.sequence > plan.sequence


def _resized(plan: Plan) -> dict[str, int]:
    """The shares that become limits or requests; realtime nodes are left to the agent."""
    nodes = (node for node in plan.nodes.values() if node.scheduler is Scheduler.CFS)
    return {identity: share for node in nodes for identity, share in node.containers.items()}
