"""Everything alive in one operator: policies, pods and nodes come in from the watches; patches and reports go out.

Public methods may be called from any thread but the loop's: each hands its work to the loop and returns at once, except
`policy_changed`, `connected` and `close`, which block.
"""

from __future__ import annotations

import json
import logging
import time
from concurrent.futures import Future
from dataclasses import dataclass, field
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeVar

from contextpolicy.actuators.dry_run import DryRun
from contextpolicy.actuators.order import Order
from contextpolicy.actuators.resize.resizer import PodResizer
from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.bus.connection import Connection
from contextpolicy.bus.usage_watch import UsageWatch
from contextpolicy.cluster.agent_reports import with_agents
from contextpolicy.cluster.claims import claim
from contextpolicy.cluster.nodes import allocatable
from contextpolicy.cluster.pod_directory import PodDirectory
from contextpolicy.cluster.pods import view
from contextpolicy.controller import Controller
from contextpolicy.live.board import Alive, board
from contextpolicy.loading import Loaded, load
from contextpolicy.planning.timers import SAME_INSTANT
from contextpolicy.policy.spec import Mode
from contextpolicy.policy.tenants import Tenants
from contextpolicy.recorder.flight_recorder import FlightRecorder
from contextpolicy.recorder.recording import bare, recording
from contextpolicy.telemetry import metrics
from contextpolicy.telemetry.event_budget import EventBudget
from contextpolicy.telemetry.events import event
from contextpolicy.telemetry.reporter import Reporter
from contextpolicy.telemetry.resize_watch import FAILED, RECOVERED, ResizeWatch
from contextpolicy.telemetry.scrape import Scraped, ScrapedPolicy
from contextpolicy.telemetry.status import GIVE_UP, StatusFacts, releasing, status, waiting

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from concurrent.futures import Executor

    import zenoh

    from contextpolicy.bus.signatures import Signer
    from contextpolicy.cluster.api import ApiServer
    from contextpolicy.cluster.claims import Claim
    from contextpolicy.cluster.pods import PodView
    from contextpolicy.loop import Loop
    from contextpolicy.policy.spec import Policy
    from contextpolicy.recorder.flight_recorder import Records

Answer = TypeVar("Answer")

log = logging.getLogger(__name__)

PATIENCE = 5.0
"""Seconds that people who watch, and scrapes, wait for the loop."""


@dataclass(slots=True)
class _Entry:
    """One ContextPolicy object, with a controller once one of its versions was valid."""

    body: Mapping[str, Any]
    loaded: Loaded
    controller: Controller | None = None
    conditions: list[dict[str, Any]] = field(default_factory=list)
    events: EventBudget = field(default_factory=EventBudget)

    @property
    def namespace(self) -> str:
        """Where the policy and its pods live."""
        return str(self.body["metadata"]["namespace"])

    @property
    def age(self) -> tuple[str, str]:
        """Sort key: oldest first, ties by name."""
        return self.body["metadata"].get("creationTimestamp", ""), _reference(self.body)


@dataclass(slots=True)
class _Leaving:
    """A ContextPolicy that is being deleted, until all its containers are restored."""

    body: Mapping[str, Any]
    conditions: list[dict[str, Any]]
    events: EventBudget = field(default_factory=EventBudget)


class Runtime:
    """The operator without its watches.

    `patches` sends resizes; `reports` writes statuses and events and must have one thread, which keeps them in order.
    `close` shuts both down.
    """

    def __init__(  # noqa: PLR0913 - what an operator is made of
        self,
        api: ApiServer,
        loop: Loop,
        *,
        patches: Executor,
        reports: Executor,
        signer: Signer | None = None,
        tenants: Tenants | None = None,
    ) -> None:
        self._session: zenoh.Session | None = None
        self._agents: AgentWatch | None = None
        self._usage: UsageWatch | None = None
        self._connection: Connection | None = None
        self._connected = False
        self._loop, self._api = loop, api
        self._patches, self._signer = patches, signer
        self._tenants = tenants or Tenants()
        self._reporter = Reporter(api, loop, reports)
        self._watch = ResizeWatch(self._on_problem, self._on_stage)
        self._resizer = PodResizer(api, loop, patches, self._watch)
        self._dry_run = DryRun()
        self._recorder = FlightRecorder()
        self._policies: dict[str, _Entry] = {}
        self._leaving: dict[str, _Leaving] = {}
        self._pods = PodDirectory()
        self._moved: set[str] = set()
        """Namespaces whose pods came, went or moved since the last placement."""
        self._nodes: dict[str, int] = {}

    def close(self) -> None:
        """Stop; limits stay in force, as after a crash, and the next start goes on from there."""
        if self._connection is not None:
            self._connection.close()
        if self._agents is not None:
            self._agents.close()
        self._call(self._stop_controllers).result(timeout=5)
        self._loop.dispose()
        self._patches.shutdown(wait=True, cancel_futures=True)
        self._reporter.close()
        if self._session is not None:
            self._session.close()

    def connected(self, session: zenoh.Session) -> None:
        """The session to the robot's bus is open: start the policies that waited for it. Blocks up to a second."""
        agents = AgentWatch(session, self._loop, lambda: self._call(self._place))
        self._call(lambda: self._begin(session, agents))
        self._connection = Connection(session, lambda connected: self._call(lambda: self._link(connected=connected)))

    def policy_changed(self, body: Mapping[str, Any]) -> Future[bool]:
        """A ContextPolicy is new, was edited or already existed; the result says whether all it names could be read.

        Reads on the caller's thread, which may take a second.
        """
        loaded = load(body, self._api, self._tenants)
        return self._call(lambda: self._adopt(body, loaded))

    def policy_deleted(self, body: Mapping[str, Any]) -> Future[None]:
        """A ContextPolicy is being deleted; the future is done when every container is restored."""
        done: Future[None] = Future()
        self._call(lambda: self._drop(body, done))
        return done

    def abandon(self, namespace: str) -> None:
        """Another operator serves this namespace now: forget its policies, and change nothing."""
        self._call(lambda: self._forget(namespace))

    def resume(self) -> None:
        """We may act again after an interruption, and nobody else did meanwhile: say again what is in force."""
        self._call(self._speak)

    def pod_changed(self, pod: Mapping[str, Any]) -> None:
        """A pod is new or has changed; one that can't be parsed is logged and ignored."""
        try:
            seen = view(pod)
        except ValueError as error:
            log.warning("a pod can't be read: %s: %.200r", error, pod)
            return
        self._call(lambda: self._take_pod(seen))

    def pod_gone(self, uid: str) -> None:
        """A pod was deleted."""
        self._call(lambda: self._lose_pod(uid))

    def node_changed(self, node: Mapping[str, Any]) -> None:
        """A node is new or has changed; only its allocatable CPU matters."""
        name, cpu = node["metadata"]["name"], allocatable(node)
        if cpu is not None:
            self._call(lambda: self._take_node(name, cpu))

    @property
    def has_router(self) -> bool:
        """Whether the bus is there."""
        return self._connected

    def scrape(self) -> Scraped | None:
        """Everything as it is now, for the metrics; None when the loop does not answer."""
        try:
            return self._call(self._scrape).result(timeout=PATIENCE)
        except TimeoutError:
            return None

    def _scrape(self) -> Scraped:
        namespaces = {entry.namespace for entry in self._policies.values()}
        return Scraped(
            now=self._loop.to_seconds(self._loop.now),
            connected=self._connected,
            policies=[
                ScrapedPolicy(reference, entry.conditions, entry.controller.held if entry.controller else None)
                for reference, entry in self._policies.items()
            ],
            pods=[pod for namespace in namespaces for pod in self._pods.of(namespace)],
            agents=dict(self._agents.reports) if self._agents else {},
        )

    def boards(self) -> list[dict[str, Any]]:
        """All policies as they are now (see `live.board`); TimeoutError when the loop does not answer."""
        return self._call(lambda: [self._board(reference) for reference in sorted(self._policies)]).result(PATIENCE)

    def plans(self, policy: str, since: float) -> list[dict[str, Any]]:
        """The recorded plans of a policy after `since`, each with when it was `published`, in Unix seconds."""
        ahead = self._loop.to_seconds(self._loop.now) - time.monotonic()
        records = self._call(lambda: list(self._recorder.plans_since(policy, since - ahead + SAME_INSTANT)))
        return [{**json.loads(plan.payload), "published": plan.published + ahead} for plan in records.result(PATIENCE)]

    def explanation(self, policy: str) -> dict[str, Any] | None:
        """Why each task of a policy has its share; None when no version of it runs."""
        return self._call(lambda: self._explain(policy)).result(PATIENCE)

    def recording(self, policy: str, last: float) -> dict[str, Any] | None:
        """The last seconds of a policy, and the policy itself; None when no version of it runs."""
        found = self._call(lambda: self._recorded(policy)).result(PATIENCE)
        if found is None:
            return None
        body, running, records = found
        # Not on the loop: it may decode tens of thousands of samples.
        return {"policy": bare(body), **recording(running, records, time.monotonic(), last)}

    def _explain(self, reference: str) -> dict[str, Any] | None:
        entry = self._policies.get(reference)
        return entry.controller.explain() if entry is not None and entry.controller is not None else None

    def _recorded(self, reference: str) -> tuple[Mapping[str, Any], Policy, Records] | None:
        entry, records = self._policies.get(reference), self._recorder.of(reference)
        if entry is None or entry.controller is None or records is None:
            return None
        return entry.body, entry.controller.policy, records.copy()

    def _board(self, reference: str) -> dict[str, Any]:
        entry = self._policies[reference]
        return board(
            Alive(
                policy=reference,
                now=self._loop.to_seconds(self._loop.now),
                conditions=entry.conditions,
                planner=entry.controller.planner if entry.controller else None,
                plan=entry.controller.message() if entry.controller else None,
                reactions=self._watch.recent(reference),
                usage=self._usage.now() if self._usage else {},
            )
        )

    def _call(self, action: Callable[[], Answer]) -> Future[Answer]:
        """Run `action` on the loop."""
        future: Future[Answer] = Future()

        def run(*_: object) -> None:
            awaited = future.set_running_or_notify_cancel()
            try:
                answer = action()
            except Exception as error:
                if awaited:
                    future.set_exception(error)
                raise  # the loop logs it and goes on
            if awaited:
                future.set_result(answer)

        self._loop.schedule(run)
        return future

    def _begin(self, session: zenoh.Session, agents: AgentWatch) -> None:
        self._session, self._agents, self._usage = session, agents, UsageWatch(session, self._loop)
        for entry in list(self._policies.values()):
            self._adopt(entry.body, entry.loaded)

    def _link(self, *, connected: bool) -> None:
        if connected is self._connected:
            return
        self._connected = connected
        log.log(logging.INFO if connected else logging.WARNING, "the bus is %s", "there" if connected else "lost")
        for reference in self._policies:
            self._report(reference)

    def _adopt(self, body: Mapping[str, Any], loaded: Loaded) -> bool:
        """Swap in a valid version; an invalid one leaves the last good one in force and says why."""
        reference = _reference(body)
        self._leaving.pop(reference, None)
        self._resizer.recall(reference, (body.get("status") or {}).get("originals"))
        entry = self._policies.setdefault(reference, _Entry(body, Loaded()))
        known = loaded.rejected == entry.loaded.rejected
        entry.body, entry.loaded = body, loaded
        entry.conditions = entry.conditions or list((body.get("status") or {}).get("conditions") or [])
        if loaded.policy is None:
            if not known:
                self._tell(reference, "Invalid", "; ".join(loaded.rejected))
            self._report(reference)
        elif self._session is None:
            self._report(reference)
        else:
            self._swap(reference, entry, loaded.policy, self._session)
        return not loaded.unread

    def _swap(self, reference: str, entry: _Entry, policy: Policy, session: zenoh.Session) -> None:
        # The order matters: the old controller must be off the bus before the new one declares the same keys, and a
        # dry run first releases what the enforced version had resized.
        before = entry.controller
        actuator = self._dry_run if policy.mode is Mode.DRY_RUN else self._resizer
        entry.controller = Controller(
            policy, session=session, scheduler=self._loop, actuator=actuator, initiatives=entry.loaded.initiatives
        )
        entry.controller.signer, entry.controller.recorder = self._signer, self._recorder
        entry.controller.may_act = lambda: self._api.may_act(policy.namespace)
        entry.controller.on_change = lambda: self._report(reference)
        entry.controller.board = lambda: self._board(reference)
        entry.controller.on_plan = self._watch.planned
        entry.controller.on_context = lambda context, active, cause: self._tell_context(
            reference, context, cause, active=active
        )
        if self._agents is not None:
            self._agents.forget(reference)
            entry.controller.on_published = self._agents.expect
        if before is not None:
            before.stop()
        if policy.mode is Mode.DRY_RUN:
            self._resizer.apply(Order(reference, frozenset()))
        entry.controller.start(before)
        self._place()
        self._report(reference)

    def _drop(self, body: Mapping[str, Any], done: Future[None]) -> None:
        reference = _reference(body)
        self._resizer.recall(reference, (body.get("status") or {}).get("originals"))
        if reference not in self._leaving:
            self._leaving[reference] = _Leaving(body, list((body.get("status") or {}).get("conditions") or []))
            entry = self._policies.pop(reference, None)
            if entry is not None and entry.controller is not None:
                entry.controller.end()
            if self._agents is not None:
                self._agents.forget(reference)
            self._reporter.forget(reference)
            self._recorder.forget(reference)
            self._watch.forget(reference)
        self._resizer.release(reference, lambda: self._released(reference, done))
        self._place()

    def _released(self, reference: str, done: Future[None]) -> None:
        self._leaving.pop(reference, None)
        self._reporter.forget(reference)
        self._watch.forget(reference)
        if reference not in self._policies:
            metrics.forget(reference)
        _fulfil(done)

    def _forget(self, namespace: str) -> None:
        for reference in [one for one in self._policies if one.partition("/")[0] == namespace]:
            controller = self._policies.pop(reference).controller
            if controller is not None:
                controller.stop()
            if self._agents is not None:
                self._agents.forget(reference)
            self._reporter.forget(reference)
            self._watch.forget(reference)
            self._resizer.abandon(reference)
            metrics.forget(reference)
        for reference in [one for one in self._leaving if one.partition("/")[0] == namespace]:
            del self._leaving[reference]
            self._resizer.abandon(reference)
        self._place()

    def _speak(self) -> None:
        for reference, entry in self._policies.items():
            if entry.controller is not None:
                entry.controller.repeat()
            self._report(reference)

    def _stop_controllers(self) -> None:
        for entry in self._policies.values():
            if entry.controller is not None:
                entry.controller.stop()

    def _take_pod(self, pod: PodView) -> None:
        before = self._pods.put(pod)
        if before is None or self._seat(before) != self._seat(pod):
            self._move(pod.namespace)
        self._watch.observe(pod, {original.policy for original in self._resizer.originals.in_pod(pod.uid).values()})
        self._resizer.observe(pod)

    def _seat(self, pod: PodView) -> tuple[object, ...]:
        """The parts of a pod that claims depend on: a mere status update must not cost a new placement."""
        original = self._resizer.originals.cpu
        bounds = tuple(
            (c.name, pod.floor(c, original(pod.uid, c.name)), c.spec.limit is None, c.memory_limit, c.container_id)
            for c in pod.containers
        )
        return pod.node, pod.labels, pod.qos, pod.ended, pod.mirror, bounds

    def _lose_pod(self, uid: str) -> None:
        pod = self._pods.pop(uid)
        if pod is not None:
            self._watch.lose(pod)
            self._resizer.forget(uid)
            self._move(pod.namespace)

    def _move(self, namespace: str) -> None:
        """Schedule one placement, so that a list of thousands of pods costs one and not thousands."""
        idle = not self._moved
        self._moved.add(namespace)
        if idle:
            self._loop.schedule(lambda *_: self._place(self._moved))

    def _take_node(self, name: str, cpu: int) -> None:
        if self._nodes.get(name) != cpu:
            self._nodes[name] = cpu
            self._place()

    def _place(self, moved: Collection[str] | None = None) -> None:
        """Tell controllers what they may claim: all, or those that pods of the `moved` namespaces concern."""
        if moved is not None and not any(entry.namespace in moved for entry in self._policies.values()):
            self._moved = set()
            return
        entries = sorted(self._policies.values(), key=lambda entry: entry.age)
        controllers = [entry.controller for entry in entries if entry.controller is not None]
        originals = self._resizer.originals.cpu
        policies = [controller.policy for controller in controllers]
        pods = chain.from_iterable(self._pods.of(namespace) for namespace in {own.namespace for own in policies})
        claims = claim(policies, pods, self._nodes, originals, self._tenants)
        self._moved = set()
        for controller in controllers:
            reports = self._agents.reports if self._agents else {}
            own = with_agents(controller.policy, claims[controller.policy.reference], reports)
            if moved is None or controller.policy.namespace in moved or own != controller.claim:
                self._tell_news(controller.policy.reference, controller.claim, own)
                controller.place(own, self._pods.of(controller.policy.namespace))

    def _tell_news(self, reference: str, before: Claim, now: Claim) -> None:
        """One Event for each kind of problem that a new claim has and the one before had not."""
        for reason, had, have in (
            ("Conflicted", before.conflicts, now.conflicts),
            ("NotResizable", list(before.obstacles.values()), list(now.obstacles.values())),
            ("RealtimeUnavailable", before.realtime, now.realtime),
        ):
            if have and have != had:
                self._tell(reference, reason, "; ".join(have))

    def _report(self, reference: str) -> None:
        self._reporter.status(reference, lambda: self._status(reference))

    def _status(self, reference: str) -> dict[str, Any]:
        now = self._loop.to_seconds(self._loop.now)
        if reference in self._leaving:
            return self._last_status(reference, now)
        entry = self._policies[reference]
        generation = entry.body["metadata"].get("generation", 0)
        if entry.controller is None:
            made = waiting(entry.loaded.rejected, generation, entry.conditions, now, connected=self._connected)
        else:
            facts = StatusFacts(
                generation,
                entry.controller.run,
                entry.controller.claim,
                self._connected,
                entry.loaded.rejected,
                self._watch.problems(reference),
            )
            made = status(entry.controller.planner, facts, entry.conditions, now)
        entry.conditions = made["conditions"]
        return made

    def _last_status(self, reference: str, now: float) -> dict[str, Any]:
        """What a policy that is being deleted waits for."""
        leaving = self._leaving[reference]
        generation = leaving.body["metadata"].get("generation", 0)
        made = releasing(self._watch.problems(reference).values(), generation, leaving.conditions, now)
        leaving.conditions = made["conditions"]
        return made

    def _on_problem(self, policy: str, reason: str, message: str) -> None:
        if policy in self._leaving and reason == FAILED:
            reason, message = "RestoreFailed", f"{message}; {GIVE_UP}"
        self._tell(policy, reason, message)
        if policy in self._policies or policy in self._leaving:
            self._report(policy)

    def _on_stage(self, policy: str, stage: str, container: str, cores: float, at: float) -> None:
        entry = self._policies.get(policy)
        if entry is not None and entry.controller is not None:
            entry.controller.tell(stage, container, cores, at)

    def _tell(self, reference: str, reason: str, message: str) -> None:
        entry = self._policies.get(reference) or self._leaving.get(reference)
        log.warning("%s: %s: %s", reference, reason, message)
        if entry is not None:
            self._post(entry, reason, message, warning=reason != RECOVERED)

    def _tell_context(self, reference: str, context: str, cause: str, *, active: bool) -> None:
        """The plan's own line in the log says it already."""
        entry = self._policies.get(reference)
        if entry is not None:
            reason = "ContextEntered" if active else "ContextExited"
            self._post(entry, reason, f"{context}: {cause}", warning=False)

    def _post(self, entry: _Entry | _Leaving, reason: str, message: str, *, warning: bool) -> None:
        now = self._loop.to_seconds(self._loop.now)
        if entry.events.spend(now):
            told = entry.events.admit_to(message)
            self._reporter.event(event(entry.body, reason=reason, message=told, now=now, warning=warning))
        else:
            metadata = entry.body["metadata"]
            metrics.EVENTS_LEFT_OUT.labels(metadata["namespace"], metadata["name"]).inc()


def _fulfil(done: Future[None]) -> None:
    """The caller may have given up waiting."""
    if done.set_running_or_notify_cancel():
        done.set_result(None)


def _reference(body: Mapping[str, Any]) -> str:
    return f"{body['metadata']['namespace']}/{body['metadata']['name']}"
