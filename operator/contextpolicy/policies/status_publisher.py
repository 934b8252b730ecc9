"""What an operator publishes about its policies at the API server: statuses, and Events about changes."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

from contextpolicy.planning.allocation.enforcement import left_alone
from contextpolicy.policies.registry import LeavingPolicy
from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.events import event
from contextpolicy.telemetry.reporter import Reporter
from contextpolicy.telemetry.resize_watch import FAILED, RECOVERED, ResizeWatch
from contextpolicy.telemetry.status import GIVE_UP, StatusFacts, releasing, status, waiting

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from contextpolicy.bus.robot_bus import RobotBus
    from contextpolicy.cluster.agent_reports import Confirmation
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.policies.registry import PolicyEntry, PolicyRegistry
    from contextpolicy.policies.shadows import Shadows
    from contextpolicy.streams.loop import Loop
    from contextpolicy.streams.wall_clock import WallClock
    from contextpolicy.telemetry.reporter import ReportApi

log = logging.getLogger(__name__)


class StatusPublisher:
    """On the loop's thread, but for `close`. `worker` writes, and must have one thread, which keeps things in order.

    `resizes` hears of every patch; what goes wrong with them is part of what is published. Running policies report to
    it as their `RunnerListener`.
    """

    def __init__(  # noqa: PLR0913 - a status has parts from everywhere
        self,
        api: ReportApi,
        loop: Loop,
        worker: Executor,
        registry: PolicyRegistry,
        *,
        bus: RobotBus,
        shadows: Shadows,
        clock: WallClock,
    ) -> None:
        self.resizes = ResizeWatch(self)
        self._loop, self._registry, self._bus, self._shadows = loop, registry, bus, shadows
        self.clock = clock
        """What times in a status or an Event are given by."""
        self._reporter = Reporter(api, loop, worker)

    def close(self) -> None:
        """Finish the write in progress and drop the queued ones."""
        self._reporter.close()

    def report(self, reference: str) -> None:
        """Have the policy's status written soon."""
        self._reporter.status(reference, lambda: self._status(reference))

    def report_all(self) -> None:
        """The same for all policies: something has changed that each of them reports."""
        for reference in self._registry.present:
            self.report(reference)

    def emit(self, reference: str, reason: str, message: str) -> None:
        """Log a problem, or that it is over, and post an Event about it."""
        entry = self._registry.find(reference)
        log.warning("%s: %s: %s", reference, reason, message)
        if entry is not None:
            self._post(entry, reason, message, warning=reason != RECOVERED)

    def note(self, reference: str, reason: str, message: str) -> None:
        """Log news that is not a problem, and post an Event about it."""
        entry = self._registry.find(reference)
        log.info("%s: %s: %s", reference, reason, message)
        if entry is not None:
            self._post(entry, reason, message, warning=False)

    def on_change(self, policy: str) -> None:
        """Have the statuses written that depend on this policy: its own, and those of its shadows."""
        self.report(policy)
        for shadow in self._shadows.beside(policy):
            self.report(shadow)

    def on_plan(self, policy: str, plan: Plan, ordered: float) -> None:
        """Measure the reactions to a new plan."""
        runner = self._registry.runner(policy)
        if runner is not None:
            control, containers = runner.policy.enforcement.control, runner.claim.placement.containers
            self.resizes.planned(policy, plan, ordered, left_alone(control, containers, plan), runner.requests)

    def on_confirmation(self, node: str, said: Confirmation) -> None:
        """A node's agent has carried out a plan of a policy's present run: reactions to it end."""
        runner, (run, sequence, _) = self._registry.runner(said.policy), said.stamp
        if runner is not None and run == runner.publisher.run and node in runner.claim.agents:
            self.resizes.on_confirmed(said.policy, node, sequence, runner.publisher.not_set())

    def on_context(self, policy: str, context: str, cause: str, *, active: bool) -> None:
        """Post an Event about a context that began or ceased to hold; the log has it with the plan already."""
        entry = self._registry.present.get(policy)
        if entry is not None:
            reason = "ContextEntered" if active else "ContextExited"
            self._post(entry, reason, f"{context}: {cause}", warning=False, routine=True)

    def knows(self, policy: str) -> bool:
        """Whether the policy stays or leaves, but is not gone."""
        return self._registry.find(policy) is not None

    def on_problem(self, policy: str, reason: str, message: str) -> None:
        """Report a problem with resizes, or that it is over."""
        if policy in self._registry.leaving and reason == FAILED:
            reason, message = "RestoreFailed", f"{message}; {GIVE_UP}"
        self.emit(policy, reason, message)
        if self._registry.find(policy) is not None:
            self.report(policy)

    def on_stage(self, policy: str, stage: str, container: str, cores: float, at: float) -> None:
        """Publish on the bus which stage a container's limit has reached."""
        runner = self._registry.runner(policy)
        if runner is not None:
            runner.publisher.publish_applied(stage, container, cores, at)

    def emit_claim(self, reference: str, before: Claim, now: Claim) -> None:
        """One Event for each kind of problem that a new claim has and the one before had not."""
        for reason, had, have in (
            ("Conflicted", before.conflicts, now.conflicts),
            ("NotResizable", list(before.obstacles.values()), list(now.obstacles.values())),
            ("LivenessProbe", list(before.warnings.values()), list(now.warnings.values())),
            ("RealtimeUnavailable", before.realtime, now.realtime),
        ):
            if have and have != had:
                self.emit(reference, reason, "; ".join(have))

    def forget(self, reference: str) -> None:
        """Stop reporting a policy, until it is reported again."""
        self._reporter.forget(reference)
        self.resizes.forget(reference)

    def _status(self, reference: str) -> dict[str, Any]:
        now = self.clock.now()
        entry = self._registry.leaving.get(reference) or self._registry.present[reference]
        generation = entry.body["metadata"].get("generation", 0)
        if isinstance(entry, LeavingPolicy):
            made = releasing(self.resizes.problems(reference).values(), generation, entry.conditions, now)
        elif entry.runner is None:
            made = waiting(entry.loaded.rejected, generation, entry.conditions, now, connected=self._bus.connected)
        else:
            running, problems = entry.runner, self.resizes.problems(reference)
            facts = StatusFacts(
                generation=generation,
                run=running.publisher.run,
                claim=running.claim,
                ahead=self.clock.ahead,
                connected=self._bus.connected,
                rejected=entry.loaded.rejected,
                unmet_actuation=problems,
                shadow=self._shadows.facts(reference),
                promoted_shadow=entry.stand_in.body["metadata"]["name"] if entry.stand_in is not None else None,
            )
            made = status(running.planner, facts, entry.conditions, now)
        entry.conditions = made["conditions"]
        return made

    def _post(
        self, entry: PolicyEntry | LeavingPolicy, reason: str, message: str, *, warning: bool, routine: bool = False
    ) -> None:
        now = self._loop.to_seconds(self._loop.now)
        if entry.events.spend(now, routine=routine):
            admitted = entry.events.admit_to(message)
            self._reporter.event(
                event(entry.body, reason=reason, message=admitted, now=self.clock.now(), warning=warning)
            )
        else:
            metadata = entry.body["metadata"]
            metrics.EVENTS_LEFT_OUT.labels(metadata["namespace"], metadata["name"]).inc()
