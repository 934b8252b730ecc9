"""One running policy: joins streams, planning and actuators, and owns start, swap and stop.

Everything here runs on the loop's thread. A swap hands the old version's state to the new one, so that an edit moves
only what it changes.
"""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from reactivex import Subject
from reactivex.disposable import CompositeDisposable

from contextpolicy.actuators.following import Follower
from contextpolicy.actuators.order import Order, order_of
from contextpolicy.bus.decision_bus import Bus, message
from contextpolicy.bus.head_start import HeadStart
from contextpolicy.bus.pacing import Pacing
from contextpolicy.cluster.claims import Claim
from contextpolicy.explain.explanation import explain as explanation_of
from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.observable import plans
from contextpolicy.planning.planner import Planner
from contextpolicy.policy.spec import Control, Mode, Scheduler
from contextpolicy.recorder.flight_recorder import FlightRecorder, PlanRecord
from contextpolicy.streams import subscription
from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.logs import log_plan

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    import zenoh
    from reactivex.abc import DisposableBase, SchedulerBase

    from contextpolicy.bus.signatures import Signer
    from contextpolicy.cluster.agent_reports import Stamp
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.spec import Policy


FIGURES_INTERVAL = 0.5
"""Seconds between messages that only update weights and scores: a score that follows a sensor changes with every
sample, and every message also costs a status write."""

PLAN_INTERVAL = 0.005
"""Seconds between two plans made by samples; of those in between only the newest is carried out. The first of a storm
does not wait. A limit takes longer to be in force, and an order that is overtaken costs more than deciding."""


class Actuator(Protocol):
    """What a runner needs of an actuator."""

    def apply(self, order: Order) -> None:
        """Make this the policy's desired state, in place of its previous order; never blocks."""


class PolicyRunner:
    """Samples in; orders to the actuator and messages on the bus out.

    Agents act on its plans only if it has a `signer`. `initiatives` are the plugged-in functions that the policy names.
    `on_change` is called when the status has changed, `on_context` with a context that began (True) or ceased to hold
    and the cause, `on_plan` with the policy's reference and each new plan once it
    is ordered, `on_published` with the reference, the stamp and the nodes of each plan that agents must carry out, and
    for how many seconds its tasks may keep all others from running.
    """

    def __init__(
        self,
        policy: Policy,
        *,
        session: zenoh.Session,
        scheduler: SchedulerBase,
        actuator: Actuator,
        initiatives: Mapping[str, Instantiate],
    ) -> None:
        self.policy = policy
        self.planner = Planner(policy)
        self.planner.on_health = self._tell_health
        self.claim = Claim(Placement())
        self.run = int(time.time() * 1000)
        self.on_change: Callable[[], None] = lambda: None
        self.on_plan: Callable[[str, Plan], None] = lambda *_: None
        self.on_context: Callable[[str, bool, str], None] = lambda *_: None
        self.on_published: Callable[[str, Stamp, Iterable[str], float], None] = lambda *_: None
        self.board: Callable[[], dict[str, Any] | None] = lambda: None
        """What a query for the policy's board is answered with."""
        self.signer: Signer | None = None
        self.recorder = FlightRecorder()
        self.may_act: Callable[[], bool] = lambda: True
        self._session, self._scheduler = session, scheduler
        self._actuator, self._initiatives = actuator, initiatives
        self._inputs: Subject[Input] = Subject()
        self._subscription: DisposableBase | None = None
        self._pods: Collection[PodView] = ()
        self._bus: Bus | None = None
        self._follower = Follower(scheduler, self._order)
        self._head_start = HeadStart(scheduler)
        self._plans = Pacing(scheduler, PLAN_INTERVAL, self._carry_out)
        self._figures = Pacing(scheduler, FIGURES_INTERVAL, self._tell_figures)
        self._ordered = 0
        self._edition = 0
        self._held_back = 0
        self._placed = False
        self._contexts: tuple[str, ...] = ()
        self._told: list[tuple[str, str]] | None = None
        self._labels = metrics.labels(policy.reference)

    @property
    def held(self) -> tuple[Planner, Claim]:
        """What it knows and what it claims, to look at."""
        return self.planner, self.claim

    def start(self, before: PolicyRunner | None = None, former: Planner | None = None) -> None:
        """Subscribe and start planning; `before` is the already stopped runner of the policy's previous version.

        `former` is the planner whose state this version takes up; by default that of `before`.
        """
        if before is not None:
            self._contexts = before._contexts  # noqa: SLF001 - the same class
            self.run = max(self.run, before.run + 1)  # the wall clock may have been set back, but runs must increase
            metrics.replace(before.policy, self.policy)
        metrics.begin(self.policy.reference)
        answers = {"plan": self.message, "explain": self.explain, "board": self.board}
        self._bus = Bus(self._session, self.policy, self._scheduler, answers)
        self._bus.signer, self._bus.may_speak = self.signer, self.may_act
        # An earlier, enforced version may have left a plan in force with the agents.
        if self.policy.mode is not Mode.ENFORCE:
            self._bus.withdraw()
        if self.policy.mode is Mode.PAUSED:
            self._actuator.apply(Order(self.policy.reference, frozenset()))
            return
        former = former or (before.planner if before else None)
        planned = plans(self.planner, self._inputs, self._scheduler, self._initiatives, former)
        take, records = self.recorder.take_sample, self.recorder.begin(self.policy.reference)

        def tap(*sample: Any) -> None:
            take(records, sample)

        samples = subscription.inputs(self._session, self.policy.streams, self._scheduler, self._drop, tap)
        self._subscription = CompositeDisposable(
            planned.subscribe(self._on_plan), samples.subscribe(self._inputs.on_next)
        )

    def stop(self) -> None:
        """Unsubscribe; the last order stays in force."""
        self._follower.stop()
        self._head_start.stop()
        self._plans.stop()
        self._figures.stop()
        if self._subscription is not None:
            self._subscription.dispose()
        if self._bus is not None:
            self._bus.close()

    def end(self) -> None:
        """The policy is gone: withdraw its plan, so that agents undo it, and stop."""
        if self._bus is not None:
            self._bus.withdraw()
        self.stop()

    def place(self, claim: Claim, pods: Collection[PodView]) -> None:
        """Take where the containers run. `pods` is a live view: most pod updates change it without a new placement."""
        self.claim, self._pods, self._placed = claim, pods, True
        before = self.planner.last
        self._inputs.on_next(claim.placement)
        # If the placement led to a new plan, `_on_plan` has ordered it already.
        if self.policy.mode is not Mode.PAUSED and self.planner.last is before:
            self._order()
            self._republish()
        self.on_change()

    def repeat(self) -> None:
        """Publish the plan in force again: the bus may have missed some."""
        self._edition += 1
        self._publish({"trigger": self._now()})

    def tell(self, stage: str, container: str, cores: float, at: float) -> None:
        """Publish that a container's new limit reached a stage: `accepted` by the API or `inForce` on the node.

        `at` is when it did, in monotonic seconds.
        """
        if self._bus is not None and self.planner.last is not None:
            step = {"stage": stage, "container": container, "cores": cores, "time": self._moment(at)}
            self._bus.publish_applied({"run": self.run, "sequence": self.planner.last.sequence, **step})

    def _on_plan(self, plan: Plan) -> None:
        # Plans made before the first placement are dropped: they would claim no container, so all would be put back.
        if not self._placed:
            return
        if plan.sequence == self._ordered:
            self._figures.ask()
            self._head_start.in_turn(lambda: self._tell_contexts(plan))
        elif plan.arrived is None:
            self._carry_out()
        else:
            self._plans.ask()

    def _carry_out(self) -> None:
        """First what acts soonest: agents act on the message; without them workers send patches while it is made."""
        plan = self.planner.decided
        if plan is None or plan.sequence == self._ordered:
            return
        self._plans.rest()
        self._ordered, self._edition = plan.sequence, 0
        trigger = plan.time if plan.arrived is None else self._moment(plan.arrived)
        publish = partial(self._publish, {"trigger": trigger})
        if self.claim.agents:
            publish()
            self._head_start.later(lambda: self._follow_up(plan, self._order))
        else:
            self._order()
            self._follow_up(plan, publish)

    def _follow_up(self, plan: Plan, action: Callable[[], None]) -> None:
        """Tell everybody else of the plan; `action` is the one of ordering and publishing that is still to do."""
        self.on_plan(self.policy.reference, plan)
        action()
        self._count()
        metrics.measure(self.policy, plan)
        log_plan(self.policy, plan)
        self._tell_contexts(plan)
        self.on_change()

    def _tell_contexts(self, plan: Plan) -> None:
        before, self._contexts = self._contexts, plan.contexts
        if before != plan.contexts:
            for context in self.policy.contexts:
                held, holds = context.name in before, context.name in plan.contexts
                if held is not holds:
                    self.on_context(context.name, holds, plan.cause)

    def _tell_figures(self) -> None:
        """Publish new weights, scores or contexts of a plan whose shares have not changed."""
        if self.planner.last is not None:
            self._edition += 1
            self._publish({"trigger": self.planner.last.time})
            metrics.measure(self.policy, self.planner.last)
            self.on_change()

    def message(self) -> dict[str, Any] | None:
        """The bus message for the plan in force, with the containers as they are now; None before the first plan."""
        plan, containers = self.planner.last, self.claim.placement.containers
        if plan is None:
            return None
        return {**message(self.policy, self.run, plan, containers, self._pods), "edition": self._edition}

    def _publish(self, more: Mapping[str, Any]) -> None:
        content = self.message()
        if self._bus is not None and content is not None:
            self._told = _whereabouts(content)
            self._figures.rest()
            payload = self._bus.publish({**content, **more})
            if payload is not None:
                records = self.recorder.begin(self.policy.reference)
                self.recorder.take_plan(records, PlanRecord(time.monotonic(), payload))
            if self.policy.mode is Mode.ENFORCE:
                stamp = content["run"], content["sequence"], content["edition"]
                standstill = self.policy.period if self.policy.scheduler is Scheduler.REALTIME else 0.0
                self.on_published(self.policy.reference, stamp, content["nodes"], standstill)

    def _republish(self) -> None:
        """Publish the plan in force again if containers restarted or moved, so that agents find their cgroups."""
        content = self.message()
        if content is not None and _whereabouts(content) != self._told:
            self._edition += 1
            self._publish({"trigger": self._now()})

    def _order(self) -> None:
        """Order the plan in force."""
        planned = self.planner.last.nodes if self.planner.last else {}
        realtime = {node for node, plan in planned.items() if plan.scheduler is Scheduler.REALTIME}
        ahead = self.claim.agents if self.policy.control is Control.LIMIT else frozenset()
        nodes = self._follower.choose({n: plan for n, plan in planned.items() if n not in realtime}, ahead)
        self._actuator.apply(order_of(self.policy, self.claim.placement.containers, nodes, realtime))

    def _count(self) -> None:
        metrics.PLANS.labels(*self._labels).inc()
        metrics.HELD_BACK.labels(*self._labels).inc(self.planner.held_back - self._held_back)
        self._held_back = self.planner.held_back

    def _tell_health(self) -> None:
        self.on_change()

    def _drop(self, stream: str, reason: str) -> None:
        self.planner.on_drop(stream, reason)
        metrics.DROPS.labels(*self._labels, stream, reason).inc()
        if self.planner.drops[stream, reason] == 1:
            self.on_change()

    def explain(self) -> dict[str, Any]:
        """Why each task has its share."""
        return explanation_of(self.planner, self._now())

    def _moment(self, monotonic: float) -> float:
        return self._now() - (time.monotonic() - monotonic)

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)


def _whereabouts(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(target["node"], target["containerId"]) for target in content["targets"]]
