"""The agent's side of the decision bus: plans in; confirmations of plans and the node's capabilities out.

Zenoh's callbacks must not call Zenoh and must not block: they check the signature and queue the message for the loop.
Only the newest message about each policy is kept, and only signed ones are queued: a flood of forged messages neither
hides a plan nor delays it on the loop.
"""

from __future__ import annotations

import json
import math
import time
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import zenoh

from contextpolicy.agent.repetitions import Repetitions
from contextpolicy.agent.retries import Retries
from contextpolicy.bus.decision_bus import agent_key, confirmed_key, plan_key, policy_of, usage_key
from contextpolicy.bus.plan_message import LARGEST_PLAN
from contextpolicy.bus.questions import Questions
from contextpolicy.bus.signatures import UNPROVEN
from contextpolicy.cluster.agent_reports import write_confirmation
from contextpolicy.errors import OrderError
from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from reactivex import Observable
    from reactivex.abc import SchedulerBase
    from zenoh.handlers import Callback

    from contextpolicy.bus.signatures import Verifier
    from contextpolicy.cluster.agent_reports import Confirmation

PLANS = plan_key("*", "*")
FRESH = 0.5
"""Seconds for which it is not read again what the containers have used: that takes a file for each. Who watches asks
once a second."""


class PlanListener(Protocol):
    """Receives plans; called on the loop's thread."""

    @property
    def late(self) -> Observable[Confirmation]:
        """What became of plans after they were confirmed."""

    def hear(self, policy: str, payload: bytes | None, signed: int) -> Confirmation | None:
        """A plan for the policy, or None when it is withdrawn; returns what became of a plan that was obeyed.

        `signed` is the time of signing in nanoseconds since 1970.
        """

    def refuse(self, error: OrderError) -> None:
        """A message to ignore: its signature is invalid, was received before, or is too old."""

    def doubt(self, policy: str) -> bool:
        """Likewise one of unknown origin; returns whether the policy's source has to publish its plan again."""

    def miss(self, policy: str, payload: bytes | None, signed: int) -> None:
        """Likewise a plan or its withdrawal that the operator has signed, but too long ago by this node's clock."""

    def find_source(self, policy: str) -> None:
        """The policy has a source of plans."""

    def lose_source(self, policy: str) -> None:
        """The policy no longer has a source of plans."""

    def report(self) -> dict[str, Any]:
        """What the node can do, as a JSON object."""

    def usage(self) -> dict[str, Any]:
        """What the containers of all plans have used so far, as a JSON object."""


class AgentBus:
    """Subscribes to plans, follows the liveliness of their sources, and reports what the node can do."""

    def __init__(
        self, session: zenoh.Session, node: str, scheduler: SchedulerBase, listener: PlanListener, verifier: Verifier
    ) -> None:
        self._session, self._scheduler, self._listener = session, scheduler, listener
        self._verifier, self._repetitions = verifier, Repetitions()
        self._waiting: dict[str, tuple[bytes | None, int]] = {}
        self._too_old: dict[str, tuple[bytes | None, int]] = {}
        """The last message of each policy that was too old, while it waits for the loop: they may come as a flood."""
        self._unheard = Retries(scheduler, self)
        """Policies whose source has yet to say its plan."""
        self._node, self._questions = node, Questions(scheduler)
        self._lock = Lock()
        key, usage = agent_key(node), _Recent(listener.usage, scheduler)
        self._confirmed_key = confirmed_key(node)
        self._declared: list[Any] = [
            session.declare_subscriber(PLANS, directly(self._take)),
            session.liveliness().declare_subscriber(PLANS, directly(self._on_source), history=True),
            session.declare_queryable(key, self._answerer(key, listener.report)),
            session.declare_queryable(usage_key(node), self._answerer(usage_key(node), usage.now)),
            session.liveliness().declare_token(key),
        ]
        self._late = listener.late.subscribe(self._confirm)

    def close(self) -> None:
        """Leave the bus, the liveliness token first: the operator must stop relying on the agent before it is gone."""
        self._late.dispose()
        self._later(self._unheard.stop)
        for declared in reversed(self._declared):
            declared.undeclare()

    def _on_source(self, sample: zenoh.Sample) -> None:
        """Ask a source for its plan when it appears: at our start, at its own, and when the network is back."""
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._later(lambda: self._find(policy_of(key)))
        else:
            self._later(lambda: self._lose(policy_of(key)))

    def on_retry(self, key: str) -> None:
        """The policy's source has not answered: ask again, until a plan comes or the source is gone."""
        asked, drop = plan_key(*key.split("/")), zenoh.CongestionControl.DROP
        self._session.get(asked, directly(self._on_reply), congestion_control=drop)
        self._unheard.again(key)

    def _find(self, policy: str) -> None:
        self._listener.find_source(policy)
        self.on_retry(policy)

    def _lose(self, policy: str) -> None:
        self._unheard.end(policy)
        self._listener.lose_source(policy)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            self._take(reply.ok)

    def _take(self, sample: zenoh.Sample) -> None:
        """A plan or its withdrawal, published or as a reply; a later one replaces an earlier one that still waits."""
        if len(sample.payload) > LARGEST_PLAN:
            return
        key = str(sample.key_expr)
        payload = None if sample.kind == zenoh.SampleKind.DELETE else sample.payload.to_bytes()
        attachment = sample.attachment.to_bytes() if sample.attachment is not None else None
        try:
            signed = self._verifier.check(key, payload, attachment, time.time_ns())
            self._repetitions.check(key, attachment or b"")
        except OrderError as error:
            self._later(partial(self._refuse, policy_of(key), error))
            if error.signed is not None:
                self._put_too_old(policy_of(key), payload, error.signed)
            return
        self._put(policy_of(key), payload, signed)

    def _refuse(self, policy: str, error: OrderError) -> None:
        """A message of unknown origin may be the operator's with another key: its source has to prove the plan."""
        self._listener.refuse(error)
        if error.reason in UNPROVEN and self._listener.doubt(policy):
            self._unheard.again(policy)

    def _put_too_old(self, policy: str, payload: bytes | None, signed: int) -> None:
        with self._lock:
            waits = policy in self._too_old
            self._too_old[policy] = payload, signed
        if not waits:
            self._later(lambda: self._miss(policy))

    def _miss(self, policy: str) -> None:
        with self._lock:
            payload, signed = self._too_old.pop(policy)
        self._listener.miss(policy, payload, signed)

    def _put(self, policy: str, payload: bytes | None, signed: int) -> None:
        with self._lock:
            asleep = not self._waiting
            waiting = self._waiting.get(policy)
            if waiting is None or waiting[1] < signed:
                self._waiting[policy] = payload, signed
        if asleep:
            self._later(self._drain)

    def _drain(self) -> None:
        """One policy at a time: what goes wrong with its message does not concern the others'."""
        with self._lock:
            policy = next(iter(self._waiting))
            payload, signed = self._waiting.pop(policy)
            more = bool(self._waiting)
        if more:
            self._later(self._drain)
        self._unheard.end(policy)
        confirmation = self._listener.hear(policy, payload, signed)
        if confirmation is not None:
            self._confirm(confirmation)

    def _confirm(self, confirmation: Confirmation) -> None:
        """Report what became of a plan to the operator, which relies on this agent only while it hears this in time."""
        said = write_confirmation(confirmation)
        self._session.put(self._confirmed_key, said, express=True, congestion_control=zenoh.CongestionControl.DROP)

    def _answerer(self, key: str, content: Callable[[], dict[str, Any]]) -> Callback[zenoh.Query]:
        """A query callback that answers from the loop, one question at a time, so that plans have their turn."""

        def answer(query: zenoh.Query) -> None:
            query.reply(key, json.dumps(content()).encode(), encoding=zenoh.Encoding.APPLICATION_JSON)

        return directly(lambda query: self._questions.ask(self._node, query, answer))

    def _later(self, action: Callable[[], None]) -> None:
        def run(*_: object) -> None:
            action()

        self._scheduler.schedule(run)


class _Recent:
    """What `read` returned last, for FRESH; called on the loop's thread."""

    def __init__(self, read: Callable[[], dict[str, Any]], scheduler: SchedulerBase) -> None:
        self._read, self._scheduler = read, scheduler
        self._last: dict[str, Any] = {}
        self._read_at = -math.inf

    def now(self) -> dict[str, Any]:
        now = self._scheduler.to_seconds(self._scheduler.now)
        if now - self._read_at >= FRESH:
            self._last, self._read_at = self._read(), now
        return self._last
