"""One running policy: owns start, swap and stop of its pipeline, and is what stands at the pipeline's ends.

Everything here runs on the loop's thread. A swap hands the old version's state to the new one, so that an edit moves
only what it changes.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import reactivex
from reactivex import Subject

from contextpolicy.actuators.order import order_of
from contextpolicy.explain.explanation import explain as explanation_of
from contextpolicy.planning.observable import plan_with
from contextpolicy.planning.planner import Planner
from contextpolicy.policies.pipeline import Inputs, connect
from contextpolicy.policies.plan_publisher import PlanPublisher
from contextpolicy.policies.plan_reporter import PlanReporter
from contextpolicy.policy.spec import Scheduler
from contextpolicy.streams import subscription, wall_clock

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from reactivex import Observable
    from reactivex.abc import DisposableBase

    from contextpolicy.actuators.actuator import Actuator
    from contextpolicy.actuators.following import NodePlans
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.planning.restart import Remembered
    from contextpolicy.policies.services import Services
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream
    from contextpolicy.recorder.flight_recorder import FlightRecorder, Records
    from contextpolicy.streams.retention import Kept, Retention


class PolicyRunner:
    """Samples in; orders to the actuator and messages on the bus out.

    In a mode that decides nothing it hears nothing either. `initiatives` are the plugged-in functions that the policy
    names, `remembered` is what the tasks had before a restart of the operator.
    """

    def __init__(
        self,
        policy: Policy,
        services: Services,
        actuator: Actuator,
        initiatives: Mapping[str, Instantiate],
        remembered: Mapping[str, Remembered],
    ) -> None:
        self.policy = policy
        self.planner = Planner(policy, self, remembered)
        self.publisher = PlanPublisher(self.planner, services)
        self._reporter = PlanReporter(self.planner, services.listener)
        self._services, self._actuator, self._initiatives = services, actuator, initiatives
        self._placements: Subject[Input] = Subject()
        self._moves: Subject[NodePlans] = Subject()
        self._pipeline: DisposableBase | None = None
        self._placed = False
        self._ordered = 0.0
        """When the plan that is carried out was ordered, in monotonic seconds."""
        self.requests: Mapping[str, int] = {}
        """What the last order makes of shares as requests, in millicores by container, where requests are weights."""

    def start(self, before: PolicyRunner | None = None, former: Planner | None = None) -> None:
        """Subscribe and start planning; `before` is the already stopped runner of the policy's previous version.

        `former` is the planner whose state this version takes up; by default that of `before`.
        """
        if before is not None:
            # The wall clock may have been set back, but runs must increase.
            self.publisher.run = max(self.publisher.run, before.publisher.run + 1)
        self._reporter.begin(before._reporter if before else None)  # noqa: SLF001 - the same class
        self.publisher.open(self)
        if not self.policy.mode.decides:
            self._services.recorder.end_plan(self.policy.reference, time.monotonic())
            return
        former = former or (before.planner if before else None)
        scheduler = self._services.scheduler
        plan = plan_with(self.planner, scheduler, self._initiatives, former, wall_clock.ahead(scheduler))
        force = self.policy.force
        clock = wall_clock.settings(scheduler, force.until) if force is not None else reactivex.never()
        inputs = Inputs(self._samples(), self._placements, clock, self._moves, self._services.settled)
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
        self.on_health()

    @property
    def claim(self) -> Claim:
        """The containers that the policy claims."""
        return self.publisher.claim

    @property
    def held(self) -> tuple[Planner, Claim]:
        """Read-only view of planner and claim."""
        return self.planner, self.claim

    # What is asked of it.

    def message(self) -> dict[str, Any] | None:
        """The plan in force, as on the bus."""
        return self.publisher.message()

    def explain(self) -> dict[str, Any]:
        """Why each task has its share."""
        own = self._services
        return explanation_of(self.planner, own.scheduler.to_seconds(own.scheduler.now), own.clock.ahead)

    def board(self) -> dict[str, Any]:
        """The policy as the live page shows it."""
        return self._services.boards.board(self.policy.reference)

    # The planner's listener.

    def on_health(self) -> None:
        """The status has changed."""
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

    def not_set(self) -> dict[str, str]:
        """The containers that agents could not set, with their tasks: their resizes wait for no agent."""
        failed = self.publisher.not_set()
        return {one.id: one.task for one in self.claim.placement.containers if one.id in failed} if failed else {}

    def is_decision(self, plan: Plan) -> bool:
        """Whether the plan is the one with which the shares in force began."""
        return plan is self.planner.decided

    def is_update(self, plan: Plan) -> bool:
        """Whether the plan shows new weights, scores or contexts of the one that was published last."""
        return plan is not self.planner.decided and plan.sequence == self.publisher.sequence

    def instruct_agents(self, plan: Plan) -> None:
        """Publish first where agents act on the message; without agents, workers send patches while it is made."""
        if self.publisher.claim.agents:
            self.publisher.publish(plan)

    def order(self, nodes: NodePlans) -> None:
        """Have the plans of these nodes carried out; those in realtime are left to their agents."""
        self._ordered = time.monotonic()
        realtime = {node for node, plan in nodes.items() if plan.scheduler is Scheduler.REALTIME}
        others = {node: plan for node, plan in nodes.items() if node not in realtime}
        claim = self.publisher.claim
        order = order_of(
            self.policy,
            claim.placement.containers,
            others,
            realtime=realtime,
            agents=claim.agents,
            attended=claim.attended,
            room=claim.room,
        )
        self.requests = order.requests
        self._actuator.apply(order)

    def publish_moves(self, nodes: NodePlans) -> None:  # noqa: ARG002 - the message has them all
        """Publish the plan in force again if containers came or went without a new one."""
        self.publisher.publish_moves()

    def report(self, plan: Plan) -> None:
        """Publish the plan if agents have not caused that already, and report it."""
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

    def _samples(self) -> Observable[Input]:
        own, policy = self._services, self.policy
        records = own.recorder.begin(policy.reference, [stream.name for stream in policy.streams])
        kept = own.retention.begin(policy.reference, policy.namespace, [stream.name for stream in policy.streams])
        log = _SampleLog(own.recorder, records, own.retention, kept, self._reporter)
        return subscription.inputs(own.session, policy.streams, own.scheduler, log, backlog=own.backlog)


class _SampleLog:
    """The recorder has each sample before it is decoded; those that are not used are reported."""

    def __init__(
        self, recorder: FlightRecorder, records: Records, retention: Retention, kept: Kept, reporter: PlanReporter
    ) -> None:
        self._recorder, self._records, self._reporter = recorder, records, reporter
        self._retention, self._kept = retention, kept

    def on_arrival(self, arrived: float, stream: str, payload: bytes, attachment: bytes, key: str) -> None:
        self._recorder.take_sample(self._records, (arrived, stream, payload, attachment, key))

    def admits(self, stream: Stream, size: int) -> bool:
        return self._retention.admit(self._kept, stream, size)

    def on_drop(self, stream: str, reason: str) -> None:
        self._reporter.drop(stream, reason)
