"""The life of policies: taken up, edited, released when they are deleted, left alone when another operator has them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.order import Order
from contextpolicy.policies.policy_runner import PolicyRunner
from contextpolicy.policies.registry import LeavingPolicy, PolicyEntry, conditions_of, reference_of
from contextpolicy.policy.spec import Mode
from contextpolicy.telemetry import metrics

if TYPE_CHECKING:
    from collections.abc import Mapping
    from concurrent.futures import Future

    import zenoh

    from contextpolicy.actuators.resize.resizer import PodResizer
    from contextpolicy.bus.robot_bus import RobotBus
    from contextpolicy.bus.signatures import Signer
    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policies.binder import Binder
    from contextpolicy.policies.loader import Loaded
    from contextpolicy.policies.promotion import Promotion
    from contextpolicy.policies.queries import Queries
    from contextpolicy.policies.registry import PolicyRegistry
    from contextpolicy.policies.status_publisher import StatusPublisher
    from contextpolicy.policy.spec import Policy
    from contextpolicy.recorder.flight_recorder import FlightRecorder
    from contextpolicy.streams.loop import Loop


@dataclass(frozen=True, slots=True, kw_only=True)
class PolicyManager:
    """Keeps the registry, and starts and stops the runners on it; everything on the loop's thread."""

    api: ApiServer
    loop: Loop
    registry: PolicyRegistry
    bus: RobotBus
    resizer: PodResizer
    publisher: StatusPublisher
    binder: Binder
    promotion: Promotion
    queries: Queries
    recorder: FlightRecorder
    signer: Signer | None
    dry_run: DryRun = field(default_factory=DryRun)

    def begin(self) -> None:
        """There is a session now: start the policies that waited for it."""
        self.settle()
        self.publisher.report_all()

    def adopt(self, body: Mapping[str, Any], loaded: Loaded) -> bool:
        """Swap in a valid version; an invalid one leaves the last good one in force and says why.

        Returns whether all that it names could be read.
        """
        reference = reference_of(body)
        self.registry.leaving.pop(reference, None)
        self._recall(body)
        entry = self.registry.present.setdefault(reference, PolicyEntry(body))
        known = loaded.rejected == entry.loaded.rejected
        entry.body, entry.loaded = body, loaded
        entry.conditions = entry.conditions or conditions_of(body)
        if loaded.policy is not None:
            if entry.good is None:
                self.promotion.recall(entry)
            entry.good, entry.generation = loaded, body["metadata"].get("generation", 0)
            self.settle(entry)
        elif not known:
            self.publisher.tell(reference, "Invalid", "; ".join(loaded.rejected))
        self.publisher.report(reference)
        return not loaded.unread

    def drop(self, body: Mapping[str, Any], done: Future[None]) -> None:
        """The policy is being deleted: end it, and finish `done` when its containers are as they were."""
        reference = reference_of(body)
        self._recall(body)
        if reference not in self.registry.leaving:
            self.registry.leaving[reference] = LeavingPolicy(body, conditions_of(body))
            entry = self.registry.present.pop(reference, None)
            if entry is not None and entry.runner is not None:
                entry.runner.end()
            self.bus.forget(reference)
            self.publisher.forget(reference)
            self.recorder.forget(reference)
            self.settle()
        self.resizer.release(reference, lambda: self._released(reference, done))
        self.binder.place()

    def abandon(self, namespace: str) -> None:
        """Another operator serves the namespace: forget its policies and change nothing."""
        for reference in _of(namespace, self.registry.present):
            runner = self.registry.present.pop(reference).runner
            if runner is not None:
                runner.stop()
            self.bus.forget(reference)
            self.publisher.forget(reference)
            self.recorder.forget(reference)
            self.resizer.abandon(reference)
            metrics.forget(reference)
        self.settle()
        for reference in _of(namespace, self.registry.leaving):
            del self.registry.leaving[reference]
            self.resizer.abandon(reference)
        self.binder.place()

    def repeat(self) -> None:
        """Say again what is in force: plans on the bus, and statuses."""
        for runner in self.registry.runners():
            runner.repeat()
        self.publisher.report_all()

    def stop(self) -> None:
        """Stop all runners; limits stay in force."""
        for runner in self.registry.runners():
            runner.stop()

    def settle(self, edited: PolicyEntry | None = None) -> None:
        """Start what is to run and does not: the edited policy, and those that begin or cease to be stood in for."""
        session = self.bus.session
        if session is None:
            return
        self.promotion.arrange(session)
        for entry in list(self.registry.present.values()):
            runs = self.promotion.carried_out(entry)
            running = entry.runner.policy if entry.runner is not None else None
            if runs is not None and runs.policy is not None and (entry is edited or running != runs.policy):
                self._swap(entry, runs.policy, runs.initiatives, session)

    def _swap(
        self, entry: PolicyEntry, policy: Policy, initiatives: Mapping[str, Instantiate], session: zenoh.Session
    ) -> None:
        # The order matters: the old runner must be off the bus before the new one declares the same keys, and a
        # dry run first releases what the enforced version had resized.
        before, shadow = entry.runner, entry.stand_in.runner if entry.stand_in is not None else None
        entry.runner = self._runner(policy, initiatives, session)
        self.bus.forget(policy.reference)
        if before is not None:
            before.stop()
        if policy.mode is Mode.DRY_RUN:
            self.resizer.apply(Order(policy.reference, frozenset()))
        # A promoted shadow has followed the streams already: nothing begins anew.
        entry.runner.start(before, shadow.planner if shadow is not None else None)
        self.binder.place()

    def _runner(self, policy: Policy, initiatives: Mapping[str, Instantiate], session: zenoh.Session) -> PolicyRunner:
        reference, publisher = policy.reference, self.publisher
        actuator = self.dry_run if policy.mode is Mode.DRY_RUN else self.resizer
        made = PolicyRunner(policy, session=session, scheduler=self.loop, actuator=actuator, initiatives=initiatives)
        made.signer, made.recorder = self.signer, self.recorder
        made.may_act = lambda: self.api.may_act(policy.namespace)
        made.board = lambda: self.queries.board(reference)
        made.on_change = lambda: self.promotion.report(reference)
        made.on_context = lambda context, active, cause: publisher.tell_context(
            reference, context, cause, active=active
        )
        made.on_plan, made.on_published = publisher.resizes.planned, self.bus.expect
        return made

    def _recall(self, body: Mapping[str, Any]) -> None:
        self.resizer.recall(reference_of(body), (body.get("status") or {}).get("originals"))

    def _released(self, reference: str, done: Future[None]) -> None:
        self.registry.leaving.pop(reference, None)
        self.publisher.forget(reference)
        if reference not in self.registry.present:
            metrics.forget(reference)
        # The caller may have given up waiting.
        if done.set_running_or_notify_cancel():
            done.set_result(None)


def _of(namespace: str, references: Mapping[str, object]) -> list[str]:
    return [reference for reference in references if reference.partition("/")[0] == namespace]
