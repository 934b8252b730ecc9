"""The life of policies: taken up, edited, released when they are deleted, left alone when another operator has them."""

from __future__ import annotations

from concurrent.futures import Future
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.stored_originals import stored_in
from contextpolicy.actuators.resize.vetting import Vetted
from contextpolicy.bus.questions import Questions
from contextpolicy.policies.policy_runner import PolicyRunner
from contextpolicy.policies.promotion import Promotion
from contextpolicy.policies.registry import LeavingPolicy, PolicyEntry, conditions_of, is_former, reference_of, uid_of
from contextpolicy.policies.services import Services
from contextpolicy.streams.backlog import PER_STREAM, TOTAL, Backlog
from contextpolicy.streams.retention import POOL, Retention
from contextpolicy.streams.subscription import Waiting
from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.status import remembered

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import zenoh

    from contextpolicy.actuators.actuator import Actuators
    from contextpolicy.bus.robot_bus import RobotBus
    from contextpolicy.bus.signatures import PlanSigner
    from contextpolicy.cluster.fencing import Fence
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policies.binder import Binder
    from contextpolicy.policies.loader import Loaded
    from contextpolicy.policies.queries import Queries
    from contextpolicy.policies.registry import PolicyRegistry
    from contextpolicy.policies.shadows import Shadows
    from contextpolicy.policies.status_publisher import StatusPublisher
    from contextpolicy.policy.spec import Policy
    from contextpolicy.recorder.flight_recorder import FlightRecorder
    from contextpolicy.streams.loop import Loop
    from contextpolicy.streams.wall_clock import WallClock


class PolicyManager:
    """Keeps the registry, and starts and stops the runners in it; everything on the loop's thread."""

    def __init__(  # noqa: PLR0913 - a policy's life touches everything that knows policies
        self,
        loop: Loop,
        registry: PolicyRegistry,
        bus: RobotBus,
        *,
        actuators: Actuators,
        publisher: StatusPublisher,
        binder: Binder,
        queries: Queries,
        shadows: Shadows,
        recorder: FlightRecorder,
        fence: Fence,
        signer: PlanSigner,
        clock: WallClock,
        settled: float,
    ) -> None:
        self._loop, self._registry, self._bus = loop, registry, bus
        self._actuators, self._publisher, self._binder = actuators, publisher, binder
        self._queries, self._recorder, self._fence, self._signer = queries, recorder, fence, signer
        self._clock, self._settled = clock, settled
        self._backlog, self._retention = Backlog[Waiting](PER_STREAM, TOTAL), Retention(POOL)
        self._questions = Questions(loop)
        self._promotion = Promotion(loop, registry, shadows, publisher, self)

    def on_promotion(self) -> None:
        """A different spec is to be carried out from now on."""
        self.settle()

    def begin(self) -> None:
        """There is a session now: start the policies that waited for it."""
        self.settle()
        self._publisher.report_all()

    def adopt(self, body: Mapping[str, Any], loaded: Loaded, vetted: Vetted) -> bool:
        """Swap in a valid version; an invalid one leaves the last good one in force and says why.

        Returns whether all that it names could be read, and no other object has its name now.
        """
        if self._is_late(body):
            return False
        reference = reference_of(body)
        self._succeed(reference, uid_of(body))
        self._actuators.recall(reference, vetted.stored)
        entry = self._registry.present.setdefault(reference, PolicyEntry(body))
        known = loaded.rejected == entry.loaded.rejected
        entry.body, entry.loaded = body, loaded
        entry.conditions = entry.conditions or conditions_of(body)
        if loaded.policy is not None:
            if entry.good is None:
                self._promotion.recall(entry)
            entry.good, entry.generation = loaded, body["metadata"].get("generation", 0)
            self.settle(entry)
        elif not known:
            self._publisher.emit(reference, "Invalid", "; ".join(loaded.rejected))
        self._tell_doubts(reference, vetted)
        self._publisher.report(reference)
        return not loaded.unread

    def drop(self, body: Mapping[str, Any], vetted: Vetted, done: Future[None]) -> None:
        """The policy is being deleted: end it, and finish `done` when its containers are as they were."""
        if self._is_late(body):
            _finish(done)
            return
        reference = reference_of(body)
        self._actuators.recall(reference, vetted.stored)
        if reference not in self._registry.leaving:
            self._registry.leaving[reference] = LeavingPolicy(body, conditions_of(body))
            entry = self._registry.present.pop(reference, None)
            if entry is not None and entry.runner is not None:
                entry.runner.end()
            self._forget(reference)
            metrics.end(reference)
            self.settle()
            self._tell_doubts(reference, vetted)
        self._actuators.release(reference, lambda: self._released(reference, done))
        self._binder.place()

    def lose(self, uid: str) -> None:
        """A policy's object is gone, although it had our finalizer: put back what it changed all the same."""
        for entry in [entry for entry in self._registry.present.values() if uid_of(entry.body) == uid]:
            self._end(entry)

    def abandon(self, namespace: str) -> None:
        """Another operator serves the namespace: forget its policies and change nothing."""
        present, leaving = self._registry.present, self._registry.leaving
        for reference in _of(namespace, [*present, *leaving]):
            entry = present.pop(reference, None)
            leaving.pop(reference, None)
            if entry is not None and entry.runner is not None:
                entry.runner.stop()
            self._forget(reference)
            self._actuators.abandon(reference)
            metrics.forget(reference)
        self.settle()
        self._binder.place()

    def repeat(self) -> None:
        """Publish again what is in force: plans on the bus, and statuses."""
        for runner in self._registry.runners():
            runner.publisher.publish_again()
        self._publisher.report_all()

    def repeat_to(self, node: str) -> None:
        """A node's agent has yet to confirm a plan: publish those again that it has to carry out."""
        for runner in self._registry.runners():
            runner.publisher.publish_to(node)

    def stop(self) -> None:
        """Stop all runners; limits stay in force."""
        for runner in self._registry.runners():
            runner.stop()

    def settle(self, edited: PolicyEntry | None = None) -> None:
        """Start what is to run and does not: the edited policy, and those that begin or cease to be stood in for."""
        session = self._bus.session
        if session is None:
            return
        self._promotion.arrange(session)
        for entry in list(self._registry.present.values()):
            runs = self._promotion.carried_out(entry)
            running = entry.runner.policy if entry.runner is not None else None
            if runs is not None and runs.policy is not None and (entry is edited or running != runs.policy):
                self._swap(entry, runs.policy, runs.initiatives, session)

    def _is_late(self, body: Mapping[str, Any]) -> bool:
        present = self._registry.present.get(reference_of(body))
        return present is not None and is_former(body, present.body)

    def _succeed(self, reference: str, uid: str) -> None:
        """End another policy of this name, if there is one; this one counts from 0."""
        former = self._registry.present.get(reference)
        if former is not None and uid_of(former.body) != uid:
            self._end(former)
        if self._registry.leaving.pop(reference, None) is not None:
            metrics.forget(reference)

    def _end(self, entry: PolicyEntry) -> None:
        """The object is gone, and nobody waits until its containers are as they were."""
        self.drop(entry.body, Vetted(stored_in(entry.body)), Future())

    def _swap(
        self, entry: PolicyEntry, policy: Policy, initiatives: Mapping[str, Instantiate], session: zenoh.Session
    ) -> None:
        # The order matters: the old runner must be off the bus before the new one declares the same keys, and a dry run
        # first puts back what the enforced version had resized.
        before, shadow = entry.runner, entry.stand_in.runner if entry.stand_in is not None else None
        actuator = self._actuators.of(policy.mode)
        known = remembered(entry.body.get("status") or {}, policy) if before is None else {}
        entry.runner = PolicyRunner(policy, self._services(session), actuator, initiatives, known)
        self._bus.forget(policy.reference)
        if before is not None:
            before.stop()
        self._actuators.put_back_others(policy.reference, policy.mode)
        # A promoted shadow has followed the streams already: no state starts over.
        entry.runner.start(before, shadow.planner if shadow is not None else None)
        self._binder.place()

    def _services(self, session: zenoh.Session) -> Services:
        return Services(
            session=session,
            scheduler=self._loop,
            clock=self._clock,
            signer=self._signer,
            fence=self._fence,
            agents=self._bus,
            boards=self._queries,
            recorder=self._recorder,
            listener=self._publisher,
            backlog=self._backlog,
            retention=self._retention,
            questions=self._questions,
            settled=self._settled,
        )

    def _tell_doubts(self, reference: str, vetted: Vetted) -> None:
        if vetted.news:
            self._publisher.emit(reference, "OriginalsUnproven", vetted.news)

    def _forget(self, reference: str) -> None:
        """The policy has stopped running."""
        self._bus.forget(reference)
        self._publisher.forget(reference)
        self._recorder.forget(reference)
        self._retention.forget(reference)

    def _released(self, reference: str, done: Future[None]) -> None:
        self._registry.leaving.pop(reference, None)
        if reference not in self._registry.present:
            self._publisher.forget(reference)
            metrics.forget(reference)
        _finish(done)


def _finish(done: Future[None]) -> None:
    """The caller may have given up waiting."""
    if done.set_running_or_notify_cancel():
        done.set_result(None)


def _of(namespace: str, references: Iterable[str]) -> list[str]:
    return [reference for reference in references if reference.partition("/")[0] == namespace]
