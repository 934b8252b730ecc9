"""One running policy: owns start, swap and stop of its pipeline, and is what stands at the pipeline's ends.

Everything here runs on the loop's thread. A swap hands the old version's state to the new one, so that an edit moves
only what it changes.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from reactivex import Subject

from contextpolicy.actuators.order import order_of
from contextpolicy.explain.explanation import explain as explanation_of
from contextpolicy.planning.observable import plan_with
from contextpolicy.planning.planner import Planner
from contextpolicy.policies.pipeline import Inputs, connect
from contextpolicy.policies.plan_publisher import PlanPublisher
from contextpolicy.policies.plan_reporter import PlanReporter
from contextpolicy.policy.spec import Scheduler
from contextpolicy.streams import subscription

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from reactivex.abc import DisposableBase

    from contextpolicy.actuators.actuator import Actuator
    from contextpolicy.actuators.following import NodePlans
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policies.services import Services
    from contextpolicy.policy.spec import Policy


class PolicyRunner:
    """Samples in; orders to the actuator and messages on the bus out.

    Without an `actuator` nothing is decided either. `initiatives` are the plugged-in functions that the policy names.
    """

    def __init__(
        self, policy: Policy, services: Services, actuator: Actuator | None, initiatives: Mapping[str, Instantiate]
    ) -> None:
        self.policy = policy
        self.planner = Planner(policy, self)
        self.publisher = PlanPublisher(self.planner, services)
        self._reporter = PlanReporter(self.planner, services.listener)
        self._services, self._actuator, self._initiatives = services, actuator, initiatives
        self._placements: Subject[Input] = Subject()
        self._moves: Subject[NodePlans] = Subject()
        self._pipeline: DisposableBase | None = None
        self._placed = False
        self._ordered = 0.0
        """When the plan that is carried out was ordered, in monotonic seconds."""

    def start(self, before: PolicyRunner | None = None, former: Planner | None = None) -> None:
        """Subscribe and start planning; `before` is the already stopped runner of the policy's previous version.

        `former` is the planner whose state this version takes up; by default that of `before`.
        """
        if before is not None:
            # The wall clock may have been set back, but runs must increase.
            self.publisher.run = max(self.publisher.run, before.publisher.run + 1)
        self._reporter.begin(before._reporter if before else None)  # noqa: SLF001 - the same class
        self.publisher.open(self)
        if self._actuator is None:
            return
        former = former or (before.planner if before else None)
        scheduler = self._services.scheduler
        plan = plan_with(self.planner, scheduler, self._initiatives, former)
        inputs = Inputs(self._samples(), self._placements, self._moves)
        self._pipeline = connect(inputs, self.planner, plan, self, scheduler)

    def stop(self) -> None:
        """Unsubscribe; the last order stays in force."""
        if self._pipeline is not None:
            self._pipeline.dispose()
        self.publisher.close()

    def end(self) -> None:
        """The policy is gone: withdraw its plan, so that agents undo it, and stop."""
        self.publisher.withdraw()
        self.stop()

    def place(self, claim: Claim, pods: Collection[PodView]) -> None:
        """Take where the containers run (see `PlanPublisher.place`)."""
        self.publisher.place(claim, pods)
        self._placed = True
        before = self.planner.last
        self._placements.on_next(claim.placement)
        # If the placement led to a new plan, that one is ordered and published.
        if self.planner.last is before:
            self._moves.on_next(before.nodes if before else {})
            self.publisher.publish_moves()
        self.on_health()

    @property
    def claim(self) -> Claim:
        """What it claims."""
        return self.publisher.claim

    @property
    def held(self) -> tuple[Planner, Claim]:
        """What it knows and what it claims, to look at."""
        return self.planner, self.claim

    # What is asked of it.

    def message(self) -> dict[str, Any] | None:
        """The plan in force, as on the bus."""
        return self.publisher.message()

    def explain(self) -> dict[str, Any]:
        """Why each task has its share."""
        scheduler = self._services.scheduler
        return explanation_of(self.planner, scheduler.to_seconds(scheduler.now))

    def board(self) -> dict[str, Any]:
        """The policy as the live page shows it."""
        return self._services.boards.board(self.policy.reference)

    # The planner's listener.

    def on_health(self) -> None:
        """The status has news."""
        self._services.listener.on_change(self.policy.reference)

    # The pipeline's outputs.

    @property
    def is_placed(self) -> bool:
        """Whether it is known where the containers run."""
        return self._placed

    def instructs_agents(self, plan: Plan) -> bool:  # noqa: ARG002 - agents act on all plans or none
        """Whether agents act on the plan's message."""
        return bool(self.publisher.claim.agents)

    def followed(self) -> frozenset[str]:
        """The nodes where resizes follow an agent: it writes limits, and in realtime nothing is resized."""
        agents, last = self.publisher.claim.agents, self.planner.last
        if not agents or last is None:
            return frozenset()
        return frozenset(
            node for node, plan in last.nodes.items() if node in agents and plan.scheduler is Scheduler.CFS
        )

    def not_set(self) -> frozenset[str]:
        """The containers that agents could not set: their resizes follow nobody."""
        return self.publisher.not_set()

    def is_decision(self, plan: Plan) -> bool:
        """Whether the plan is the one with which the shares in force began."""
        return plan is self.planner.decided

    def is_update(self, plan: Plan) -> bool:
        """Whether the plan shows new weights, scores or contexts of the one that was published last."""
        return plan is not self.planner.decided and plan.sequence == self.publisher.sequence

    def instruct_agents(self, plan: Plan) -> None:
        """First what acts soonest: agents act on the message; without them workers send patches while it is made."""
        if self.publisher.claim.agents:
            self.publisher.publish(plan)

    def order(self, nodes: NodePlans) -> None:
        """Have the plans of these nodes carried out; those in realtime are left to their agents."""
        self._ordered = time.monotonic()
        realtime = {node for node, plan in nodes.items() if plan.scheduler is Scheduler.REALTIME}
        others = {node: plan for node, plan in nodes.items() if node not in realtime}
        if self._actuator is not None:
            claim = self.publisher.claim
            containers, agents = claim.placement.containers, claim.agents
            self._actuator.apply(order_of(self.policy, containers, others, realtime=realtime, agents=agents))

    def report(self, plan: Plan) -> None:
        """Publish the plan if agents have not caused that already, and report it."""
        if plan.sequence > self.publisher.sequence:
            self.publisher.publish(plan)
        self._services.listener.on_plan(self.policy.reference, plan, self._ordered)
        self._reporter.report(plan)

    def show(self, plan: Plan) -> None:
        """Publish and report new weights, scores and contexts of the plan in force."""
        self.publisher.publish_again(plan.time)
        self._reporter.show()

    def report_contexts(self, plan: Plan) -> None:
        """Report which contexts began or ceased to hold."""
        self._reporter.report_contexts(plan)

    def _samples(self) -> Any:
        """The streams' samples; the recorder has each before it is decoded."""
        recorder, reference = self._services.recorder, self.policy.reference
        take, records = recorder.take_sample, recorder.begin(reference)

        def tap(*sample: Any) -> None:
            take(records, sample)

        services = self._services
        return subscription.inputs(services.session, self.policy.streams, services.scheduler, self._reporter.drop, tap)
