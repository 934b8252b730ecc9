"""The agent's place on the decision bus: plans in, what the node can do out.

Zenoh's callbacks must not call Zenoh and must not wait: they only leave a note for the loop. Of several messages about
one policy only the newest counts.
"""

from __future__ import annotations

import json
from threading import Lock
from typing import TYPE_CHECKING, Protocol

import zenoh

from contextpolicy.bus.decision_bus import agent_key, plan_key, policy_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import Any

    from reactivex.abc import SchedulerBase

PLANS = plan_key("*", "*")


class PlanListener(Protocol):
    """Who obeys; called on the loop's thread."""

    def hear(self, policy: str, payload: bytes | None) -> None:
        """A message about a policy; None: it is gone."""

    def find_source(self, policy: str) -> None:
        """Somebody makes plans for the policy."""

    def lose_source(self, policy: str) -> None:
        """Nobody makes plans for the policy any more."""

    def report(self) -> dict[str, Any]:
        """What the node can do."""


class AgentBus:
    """Hears plans, follows who makes them, and answers what the node can do."""

    def __init__(self, session: zenoh.Session, node: str, scheduler: SchedulerBase, listener: PlanListener) -> None:
        self._session, self._scheduler, self._listener = session, scheduler, listener
        self._waiting: dict[str, bytes | None] = {}
        self._lock = Lock()
        self._key = key = agent_key(node)
        self._declared: list[Any] = [
            session.declare_subscriber(PLANS, self._on_plan),
            session.liveliness().declare_subscriber(PLANS, self._on_source, history=True),
            session.declare_queryable(key, self._on_question),
            session.liveliness().declare_token(key),
        ]

    def close(self) -> None:
        """Leave the bus, the token first: the node counts as without agent before it is."""
        for declared in reversed(self._declared):
            declared.undeclare()

    def _on_plan(self, sample: zenoh.Sample) -> None:
        gone = sample.kind == zenoh.SampleKind.DELETE
        self._put(str(sample.key_expr), None if gone else sample.payload.to_bytes())

    def _on_source(self, sample: zenoh.Sample) -> None:
        """Whoever makes plans is asked for the one in force: at our start, at its own, and when the network is back."""
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._later(lambda: self._ask(key))
        else:
            self._later(lambda: self._listener.lose_source(policy_of(key)))

    def _ask(self, key: str) -> None:
        self._listener.find_source(policy_of(key))
        self._session.get(key, self._on_reply)

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            key, payload = str(reply.ok.key_expr), reply.ok.payload.to_bytes()
            self._later(lambda: self._listener.hear(policy_of(key), payload))

    def _put(self, key: str, payload: bytes | None) -> None:
        with self._lock:
            asleep = not self._waiting
            self._waiting[policy_of(key)] = payload
        if asleep:
            self._later(self._drain)

    def _drain(self) -> None:
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        for policy, payload in waiting.items():
            self._listener.hear(policy, payload)

    def _on_question(self, query: zenoh.Query) -> None:
        self._later(lambda: self._answer(query))

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            report = json.dumps(self._listener.report()).encode()
            query.reply(self._key, report, encoding=zenoh.Encoding.APPLICATION_JSON)

    def _later(self, action: Callable[[], None]) -> None:
        def run(*_: object) -> None:
            action()

        self._scheduler.schedule(run)
