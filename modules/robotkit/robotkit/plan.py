"""The policy's decisions for this task, received on the decision bus (its fields: `planning/plan_json.py`)."""

from __future__ import annotations

import logging
import math
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

import zenoh

from robotkit import json_text

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PLAN_KEY = "contextpolicy/*/*/plan"
LONGEST_END_S = 0.1

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Decision:
    """A task's part of a plan; `share` is in cores, None when no plan binds the task."""

    share: float | None = None
    weight: float | None = None
    suspended: bool = False


UNPLANNED = Decision()


@dataclass(frozen=True, slots=True)
class _Plan:
    order: tuple[int, int]
    decision: Decision


class Decisions:
    """The newest decision among all policies that name the task. Pure: the order of plans matters, not the time."""

    def __init__(self, task: str) -> None:
        self._task = task
        self._plans: dict[str, _Plan] = {}

    def hear(self, key: str, payload: bytes | None) -> Decision:
        """Take one message (None: the policy is gone) and return the decision that now holds."""
        if payload is None:
            self._plans.pop(key, None)
        else:
            plan = _parse(payload, self._task)
            known = self._plans.get(key)
            if plan is not None and (known is None or plan.order > known.order):
                self._plans[key] = plan
        return self._current()

    def _current(self) -> Decision:
        binding = [plan for plan in self._plans.values() if plan.decision != UNPLANNED]
        return max(binding, key=lambda plan: plan.order).decision if binding else UNPLANNED


def _parse(payload: bytes, task: str) -> _Plan | None:
    """Read a plan; one that does not name the task, or is not enforced, does not bind it."""
    try:
        document = json_text.loads(payload)
        order = (int(document["run"]), int(document["sequence"]))
        if document["mode"] != "Enforce" or task not in document["tasks"]:
            return _Plan(order, UNPLANNED)
        mine = document["tasks"][task]
        decision = Decision(_finite(mine["share"]), _finite(mine["weight"]), _truth(mine["suspended"]))
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        _LOG.warning("ignoring a plan that can't be read: %r", error)
        return None
    return _Plan(order, decision)


def _finite(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"invalid value {value!r}: expected a finite number")
    return float(value)


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"invalid value {value!r}: expected true or false")
    return value


class PlanListener:
    """Calls `on_change` with each new decision, on a thread of its own, where callbacks may use the bus.

    `guard` wraps the thread's work, so that a failure of `on_change` does not leave a module that is deaf to plans.

    Who makes plans is asked for the one in force whenever they appear: at our start, at theirs, and when the network is
    back. Their liveliness token shows it: they declare it after their publishers and queryables.
    """

    def __init__(
        self,
        session: zenoh.Session,
        task: str,
        on_change: Callable[[Decision], None],
        guard: Callable[[Callable[[], None]], Callable[[], None]],
        *,
        key: str = PLAN_KEY,
    ) -> None:
        self._session = session
        self._decisions = Decisions(task)
        self._on_change = on_change
        self._heard: dict[str, bytes | None] = {}
        self._appeared: set[str] = set()
        self._changed = threading.Condition()
        self._closed = False
        self._thread = threading.Thread(target=guard(self._follow), name="plan", daemon=True)
        self._thread.start()
        self._subscribers: list[zenoh.Subscriber[None]] = [
            session.declare_subscriber(key, self._hear),
            session.liveliness().declare_subscriber(key, self._find, history=True),
        ]

    def close(self) -> None:
        """Stop listening and wait for the thread up to LONGEST_END_S: a callback may hang."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._thread.join(LONGEST_END_S)

    def _hear(self, sample: zenoh.Sample) -> None:
        if "*" in str(sample.key_expr):
            return  # Zenoh lets clients without the right to publish plans publish on wildcard keys that match them
        gone = sample.kind == zenoh.SampleKind.DELETE
        with self._changed:
            self._heard[str(sample.key_expr)] = None if gone else sample.payload.to_bytes()
            self._changed.notify_all()

    def _find(self, token: zenoh.Sample) -> None:
        """Leave the question to the thread: Zenoh's callbacks must not call Zenoh."""
        if token.kind == zenoh.SampleKind.PUT and "*" not in str(token.key_expr):
            with self._changed:
                self._appeared.add(str(token.key_expr))
                self._changed.notify_all()

    def _hear_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is None or "*" in str(reply.ok.key_expr):
            return
        with self._changed:
            # A plan published meanwhile is newer than the reply.
            self._heard.setdefault(str(reply.ok.key_expr), reply.ok.payload.to_bytes())
            self._changed.notify_all()

    def _follow(self) -> None:
        last = UNPLANNED
        for key, payload in self._messages():
            decision = self._decisions.hear(key, payload)
            if decision != last:
                last = decision
                self._on_change(decision)

    def _messages(self) -> Iterator[tuple[str, bytes | None]]:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._heard or self._appeared or self._closed)
                if self._closed:
                    return
                heard, self._heard = self._heard, {}
                appeared, self._appeared = self._appeared, set()
            for key in appeared:
                self._session.get(key, self._hear_reply)
            yield from heard.items()
