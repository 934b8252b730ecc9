"""A Zenoh session without threads or network: what is declared on it, and what is published, is in plain sight."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.decision_bus import agent_key

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@dataclass
class _Declared:
    key: str
    callback: Callable[[Any], None] | None
    among: list[_Declared]

    def undeclare(self) -> None:
        self.among.remove(self)


@dataclass
class Query:
    """A question, and the answers to it."""

    answers: list[Any] = field(default_factory=list)
    attachments: list[bytes | None] = field(default_factory=list)
    payload: bytes | None = None
    attachment: bytes | None = None
    parameters: str = ""
    ended: bool = False

    def reply(self, _: str, payload: bytes, *, attachment: bytes | None = None, **__: Any) -> None:
        self.answers.append(json.loads(payload))
        self.attachments.append(attachment)

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        self.ended = True


class FakeSession:
    """`published` are the messages by key, None where one was withdrawn.

    `agents` live and answer with these reports; those whose report is None are slow. They confirm plans while they are
    `confirming`, but for the containers that `failed`. Like the real session, a closed
    one refuses everything, and a question with a callback is answered after `get` has returned: when the test says so.
    """

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.attachments: list[bytes | None] = []
        self.subscribers: list[_Declared] = []
        self.queryables: list[_Declared] = []
        self.tokens: list[_Declared] = []
        self.watchers: list[_Declared] = []
        self.publishers: list[_Declared] = []
        self.agents: dict[str, bytes | None] = {}
        self.questions: list[tuple[str, zenoh.handlers.Callback[Any]]] = []
        self.listeners: list[_Declared] = []
        self.router: str | None = "router"
        self.closed = False
        self.confirming = True
        self.failed: list[str] = []

    # what the operator calls

    def declare_subscriber(self, key: str, callback: Callable[[Any], None]) -> _Declared:
        return self._declare(key, callback, self.subscribers)

    def declare_queryable(self, key: str, callback: Callable[[Any], None]) -> _Declared:
        return self._declare(key, callback, self.queryables)

    def declare_publisher(self, key: str, **_: Any) -> Any:
        declared = self._declare(key, None, self.publishers)
        return SimpleNamespace(
            put=lambda payload, **more: self._publish(key, json.loads(payload), **more),
            delete=lambda **more: self._publish(key, None, **more),
            undeclare=declared.undeclare,
        )

    @property
    def info(self) -> Any:
        return SimpleNamespace(declare_transport_events_listener=self._listen)

    def liveliness(self) -> Any:
        return SimpleNamespace(
            declare_token=lambda key: self._declare(key, None, self.tokens),
            declare_subscriber=self._watch_tokens,
            get=self._find_tokens,
        )

    def get(self, selector: str, handler: Any = None, *, timeout: float, **_: Any) -> Iterator[Any] | None:
        """Without a handler all answers, waited for; with one, to it, and its `drop` is called when they have ended."""
        self._require_open()
        assert timeout > 0
        if handler is None:
            return iter([*self._answers(selector), *self._errors(selector)])
        callback = handler if isinstance(handler, zenoh.handlers.Callback) else zenoh.handlers.Callback(handler)
        self.questions.append((selector, callback))
        return None

    def close(self) -> None:
        """Closing twice is fine."""
        self.closed = True

    # what a test does

    def answer(self) -> None:
        """Who is not slow answers; a question that nobody hears ends at once."""
        waiting, self.questions = self.questions, []
        for selector, callback in waiting:
            for answer in self._answers(selector):
                callback(answer)
            if self._errors(selector):
                self.questions.append((selector, callback))
            elif callback.drop is not None:
                callback.drop()

    def time_out(self) -> None:
        """Those who asked wait no longer."""
        waiting, self.questions = self.questions, []
        for selector, callback in waiting:
            for error in self._errors(selector):
                callback(error)
            if callback.drop is not None:
                callback.drop()

    def agent(self, node: str, report: bytes | None) -> None:
        """An agent comes up."""
        self.agents[node] = report
        self._announce_token(node, zenoh.SampleKind.PUT)

    def agent_gone(self, node: str) -> None:
        """An agent ends."""
        del self.agents[node]
        self._announce_token(node, zenoh.SampleKind.DELETE)

    def lose_router(self) -> None:
        """The router ends."""
        self._announce_transport(zenoh.SampleKind.DELETE)
        self.router = None

    def find_router(self, zid: str = "router") -> None:
        """A router is there again."""
        self.router = zid
        self._announce_transport(zenoh.SampleKind.PUT)

    def deliver(self, key: str, **value: Any) -> None:
        """A sample arrives."""
        self.deliver_bytes(key, json.dumps(value).encode())

    def deliver_bytes(self, key: str, payload: bytes, of: str = "") -> None:
        """A sample arrives, whatever is in it; `of` is its own key where the subscriber's has wildcards."""
        sample = SimpleNamespace(
            kind=zenoh.SampleKind.PUT, payload=_payload(payload), key_expr=of or key, attachment=None, timestamp=None
        )
        for subscriber in [one for one in self.subscribers if one.key == key]:
            if subscriber.callback is not None:
                subscriber.callback(sample)

    def ask(self, key: str, **carried: Any) -> Query:
        """A question arrives; it is answered when the loop has its turn."""
        query = Query(**carried)
        [queryable] = [one for one in self.queryables if one.key == key]
        if queryable.callback is not None:
            queryable.callback(query)
        return query

    def plans(self, policy: str = "lab/robot") -> list[Any]:
        """All messages about a policy's plans."""
        return [message for key, message in self.published if key == f"contextpolicy/{policy}/plan"]

    def everything_declared(self) -> list[str]:
        lists = (self.listeners, self.subscribers, self.queryables, self.tokens, self.watchers, self.publishers)
        return sorted(one.key for declared in lists for one in declared)

    def _watch_tokens(self, key: str, callback: Callable[[Any], None], *, history: bool = False) -> _Declared:
        declared = self._declare(key, callback, self.watchers)
        for node in self._asked(key) if history else ():
            callback(_token(node, zenoh.SampleKind.PUT))
        return declared

    def _find_tokens(self, key: str, callback: zenoh.handlers.Callback[Any], *, timeout: float) -> None:
        assert timeout > 0
        for node in self._asked(key):
            callback(SimpleNamespace(ok=_token(node, zenoh.SampleKind.PUT)))
        if callback.drop is not None:
            callback.drop()

    def _listen(self, callback: Callable[[Any], None], *, history: bool) -> _Declared:
        declared = self._declare("transports", callback, self.listeners)
        if history and self.router is not None:
            self._announce_transport(zenoh.SampleKind.PUT)
        return declared

    def _announce_transport(self, kind: zenoh.SampleKind) -> None:
        event = SimpleNamespace(kind=kind, transport=SimpleNamespace(zid=self.router))
        for listener in self.listeners:
            if listener.callback is not None:
                listener.callback(event)

    def _announce_token(self, node: str, kind: zenoh.SampleKind) -> None:
        for watcher in [one for one in self.watchers if _meet(one.key, agent_key(node))]:
            if watcher.callback is not None:
                watcher.callback(_token(node, kind))

    def _asked(self, selector: str) -> list[str]:
        key, *_ = selector.split("?")
        return [node for node in self.agents if _meet(key, agent_key(node))]

    def _answers(self, selector: str) -> list[Any]:
        reports = {node: report for node in self._asked(selector) if (report := self.agents[node]) is not None}
        return [
            SimpleNamespace(ok=SimpleNamespace(key_expr=agent_key(node), payload=_payload(report)), err=None)
            for node, report in reports.items()
        ]

    def _errors(self, selector: str) -> list[Any]:
        """One for the whole question, as soon as one of those asked is slow."""
        slow = any(self.agents[node] is None for node in self._asked(selector))
        return [SimpleNamespace(ok=None, err=SimpleNamespace(payload=_payload(b"Timeout")))] if slow else []

    def _publish(self, key: str, content: Any, *, attachment: bytes | None = None, **_: Any) -> None:
        self._require_open()
        self.attachments.append(attachment)
        self.published.append((key, content))
        if key.endswith("/plan") and content is not None and self.confirming:
            self._confirm(content)

    def _confirm(self, plan: dict[str, Any]) -> None:
        """Every agent that lives carries out every plan at once."""
        said = {"policy": plan.get("policy"), "stamp": [plan.get(part, 0) for part in ("run", "sequence", "edition")]}
        said["failed"] = dict.fromkeys(self.failed, "Busy")
        for node in plan.get("nodes", {}).keys() & self.agents.keys():
            self.deliver_bytes(
                "contextpolicy/agents/*/confirmed", json.dumps(said).encode(), f"{agent_key(node)}/confirmed"
            )

    def _declare(self, key: str, callback: Callable[[Any], None] | None, among: list[_Declared]) -> _Declared:
        self._require_open()
        declared = _Declared(key, callback, among)
        among.append(declared)
        return declared

    def _require_open(self) -> None:
        if self.closed:
            raise zenoh.ZError("session closed")


def _meet(one: str, other: str) -> bool:
    return zenoh.KeyExpr(one).intersects(zenoh.KeyExpr(other))


def _token(node: str, kind: zenoh.SampleKind) -> Any:
    return SimpleNamespace(key_expr=agent_key(node), kind=kind)


def _payload(content: bytes) -> Any:
    return zenoh.ZBytes(content)
