"""A Zenoh session without threads or network: what is declared on it, and what is published, is in plain sight."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import zenoh

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

    def reply(self, _: str, payload: str, **__: Any) -> None:
        self.answers.append(json.loads(payload))

    def __enter__(self) -> None:
        pass

    def __exit__(self, *_: object) -> None:
        pass


class FakeSession:
    """`published` are the messages by key, None where one was withdrawn; `agents` answer with these reports."""

    def __init__(self) -> None:
        self.published: list[tuple[str, Any]] = []
        self.subscribers: list[_Declared] = []
        self.queryables: list[_Declared] = []
        self.tokens: list[_Declared] = []
        self.watchers: list[_Declared] = []
        self.publishers: list[_Declared] = []
        self.agents: dict[str, bytes] = {}
        self.closed = False

    # what the operator calls

    def declare_subscriber(self, key: str, callback: Callable[[Any], None]) -> _Declared:
        return _declare(key, callback, self.subscribers)

    def declare_queryable(self, key: str, callback: Callable[[Any], None]) -> _Declared:
        return _declare(key, callback, self.queryables)

    def declare_publisher(self, key: str, **_: Any) -> Any:
        declared = _declare(key, None, self.publishers)
        return SimpleNamespace(
            put=lambda payload, **_: self.published.append((key, json.loads(payload))),
            delete=lambda: self.published.append((key, None)),
            undeclare=declared.undeclare,
        )

    def liveliness(self) -> Any:
        return SimpleNamespace(
            declare_token=lambda key: _declare(key, None, self.tokens),
            declare_subscriber=lambda key, callback, **_: _declare(key, callback, self.watchers),
        )

    def get(self, _: str, **__: Any) -> Iterator[Any]:
        for node, report in self.agents.items():
            payload = SimpleNamespace(to_bytes=lambda report=report: report)
            yield SimpleNamespace(ok=SimpleNamespace(key_expr=f"contextpolicy/agents/{node}", payload=payload))

    def close(self) -> None:
        self.closed = True

    # what a test does

    def deliver(self, key: str, **value: Any) -> None:
        """A sample arrives."""
        self.deliver_bytes(key, json.dumps(value).encode())

    def deliver_bytes(self, key: str, payload: bytes) -> None:
        """A sample arrives, whatever is in it."""
        sample = SimpleNamespace(kind=zenoh.SampleKind.PUT, payload=SimpleNamespace(to_bytes=lambda: payload))
        for subscriber in [one for one in self.subscribers if one.key == key]:
            if subscriber.callback is not None:
                subscriber.callback(sample)

    def ask(self, key: str) -> Query:
        """A question arrives; it is answered when the loop has its turn."""
        query = Query()
        [queryable] = [one for one in self.queryables if one.key == key]
        if queryable.callback is not None:
            queryable.callback(query)
        return query

    def plans(self, policy: str = "lab/robot") -> list[Any]:
        """All messages about a policy's plans."""
        return [message for key, message in self.published if key == f"contextpolicy/{policy}/plan"]

    def everything_declared(self) -> list[str]:
        lists = (self.subscribers, self.queryables, self.tokens, self.watchers, self.publishers)
        return sorted(one.key for declared in lists for one in declared)


def _declare(key: str, callback: Callable[[Any], None] | None, among: list[_Declared]) -> _Declared:
    declared = _Declared(key, callback, among)
    among.append(declared)
    return declared
