"""One policy's plans on the decision bus: each new one, and again when its weights or containers have changed."""

from __future__ import annotations

import time
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from contextpolicy.bus.decision_bus import Bus
from contextpolicy.bus.plan_message import message
from contextpolicy.cluster.agent_reports import not_set
from contextpolicy.cluster.claims import Claim
from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.policy.spec import Scheduler
from contextpolicy.recorder.flight_recorder import PlanRecord

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from contextpolicy.bus.decision_bus import Answers
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.planner import Planner
    from contextpolicy.policies.services import Services

_ACTED_ON = itemgetter("node", "containerId", "weight", "quota", "held", "original", "podLimit")


class PlanPublisher:
    """Closed until it is opened; then it is on the bus under the policy's name, which one publisher at a time may be.

    `run` and the plan's sequence and edition only grow: agents and modules take what is newest.
    """

    def __init__(self, planner: Planner, services: Services) -> None:
        self.run = int(time.time() * 1000)
        self.claim = Claim(Placement())
        """Where the containers run."""
        self._planner, self._policy, self._services = planner, planner.policy, services
        self._bus: Bus | None = None
        self._pods: Collection[PodView] = ()
        self.sequence = 0
        """That of the plan that was published last."""
        self._edition = 0
        self._instructed: list[tuple[Any, ...]] | None = None

    def open(self, answers: Answers) -> None:
        """Go on the bus. An earlier, enforced version may have left a plan in force with the agents."""
        own = self._services
        self._bus = Bus(own.session, self._policy, own.questions, answers, signer=own.signer, fence=own.fence)
        if not self._policy.mode.acts:
            self._bus.withdraw()

    def close(self) -> None:
        """Leave the bus; the plan stays in force."""
        if self._bus is not None:
            self._bus.close()

    def withdraw(self) -> None:
        """The policy is gone: agents undo its plan."""
        if self._bus is not None:
            self._bus.withdraw()

    def place(self, claim: Claim, pods: Collection[PodView]) -> None:
        """Take where the containers run. `pods` is a live view: most pod updates change it without a new placement."""
        self.claim, self._pods = claim, pods

    def publish(self, plan: Plan) -> None:
        """Publish a new plan, unless it is published already."""
        if plan.sequence <= self.sequence:
            return
        self._edition = 0
        self._publish(self._wall(plan.time) if plan.arrived is None else self._on_our_clock(plan.arrived))

    def publish_again(self, trigger: float | None = None) -> None:
        """Publish the plan in force with all that changed since; `trigger` is when (planning time), by default now."""
        self._edition += 1
        self._publish(self._services.clock.now() if trigger is None else self._wall(trigger))

    def publish_moves(self) -> None:
        """Publish the plan in force again if containers restarted or moved, so that agents find their cgroups.

        Also if the same shares mean something else: pods of others came or went, or another writer of limits has won.
        """
        content = self.message()
        if content is not None and _instructions(content) != self._instructed:
            self.publish_again()

    def publish_to(self, node: str) -> None:
        """Publish the plan in force again if it has this node, whose agent has yet to confirm one."""
        plan = self._planner.last
        if plan is not None and node in plan.nodes and self._policy.mode.acts:
            self.publish_again()

    def publish_applied(self, stage: str, container: str, cores: float, at: float) -> None:
        """Publish that a container's new limit reached a stage; `at` is when it did, in monotonic seconds."""
        plan = self._planner.last
        if self._bus is not None and plan is not None:
            step = {"stage": stage, "container": container, "cores": cores, "time": self._on_our_clock(at)}
            self._bus.publish_applied({"run": self.run, "sequence": plan.sequence, **step})

    def not_set(self) -> frozenset[str]:
        """The containers that agents could not set."""
        failures = self._services.agents.failures(self._policy.reference)
        return not_set(failures, self._pods) if failures else frozenset()

    def message(self) -> dict[str, Any] | None:
        """The bus message for the plan in force, with the containers as they are now; None before the first plan."""
        plan = self._planner.last
        if plan is None:
            return None
        claim = self.claim
        content = message(
            self._policy, self.run, plan, claim.placement.containers, self._pods, most_weight=claim.most_weight
        )
        return {**content, "time": self._wall(plan.time), "edition": self._edition}

    def _publish(self, trigger: float) -> None:
        content = self.message()
        if self._bus is None or content is None:
            return
        payload = self._bus.publish({**content, "trigger": trigger})
        self._instructed, self.sequence = _instructions(content), content["sequence"]
        if payload is None:
            return
        self._services.recorder.take_plan(self._policy.reference, PlanRecord(time.monotonic(), payload))
        if self._policy.mode.acts:
            stamp = content["run"], content["sequence"], content["edition"]
            standstill = (
                self._policy.enforcement.period if self._policy.enforcement.scheduler is Scheduler.REALTIME else 0.0
            )
            self._services.agents.expect(self._policy.reference, stamp, content["nodes"], standstill)

    def _on_our_clock(self, monotonic: float) -> float:
        return self._services.clock.now() - (time.monotonic() - monotonic)

    def _wall(self, planning_time: float) -> float:
        return planning_time - self._services.clock.ahead


def _instructions(content: Mapping[str, Any]) -> list[tuple[Any, ...]]:
    """What agents write, and where; `limit` and `request` follow each resize, and are only what the kubelet has."""
    return [_ACTED_ON(target) for target in content["targets"]]
