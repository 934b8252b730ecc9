"""What containers use and how much they are throttled, as the nodes' agents read it from the cgroups.

Requested only while a board is open: without a viewer, no agent reads anything.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from threading import Lock
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.decision_bus import node_of, usage_key
from contextpolicy.bus.session import LARGEST_WORD
from contextpolicy.streams.direct import directly

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from reactivex.abc import SchedulerBase

ASK_EVERY = 1.0
"""Seconds between two questions; a rate over less says little, since the kernel throttles in periods of 0.1 s."""
PATIENCE = 2.0
"""Seconds that an agent has to answer."""
OLD = 5.0
"""Seconds after which an answer is neither shown nor compared with the next."""


@dataclass(frozen=True, slots=True)
class Counters:
    """A container's totals from its cgroup: CPU time in seconds, enforcement periods, and those it was throttled in."""

    at: float
    used: float
    periods: int
    throttled: int


@dataclass(frozen=True, slots=True)
class Usage:
    """Over the last second or so: cores used, and the part of its periods with throttling (None where none ran)."""

    at: float
    cores: float
    throttled: float | None


class UsageWatch:
    """Called on the loop's thread. Times are the agents' own monotonic clocks, compared only with themselves.

    `nodes` are those of the cluster, whose agents are believed.
    """

    def __init__(self, session: zenoh.Session, scheduler: SchedulerBase, nodes: Collection[str]) -> None:
        self._session, self._scheduler, self._nodes = session, scheduler, nodes
        self._asked_at = -math.inf
        self._last: dict[str, tuple[float, Counters]] = {}
        """Each container's latest counters, and when they came, by the loop's clock."""
        self._usage: dict[str, Usage] = {}
        self._waiting: dict[str, bytes] = {}
        """The newest answer of each node that waits for the loop."""
        self._lock = Lock()

    def now(self) -> Mapping[str, Usage]:
        """The latest usage by container ID; queries the agents again, for the next call."""
        now = self._now()
        if now - self._asked_at >= ASK_EVERY:
            self._asked_at = now
            # Else Zenoh keeps all answers until the last has come; nor may we wait for room on a congested link.
            at_once, drop = zenoh.ConsolidationMode.NONE, zenoh.CongestionControl.DROP
            how: Any = {"timeout": PATIENCE, "consolidation": at_once, "congestion_control": drop}
            self._session.get(usage_key("*"), directly(self._on_reply), **how)
        self._usage = {container: usage for container, usage in self._usage.items() if now - usage.at < OLD}
        return self._usage

    def _on_reply(self, reply: zenoh.Reply) -> None:
        """Called on a Zenoh thread, which must not block."""
        if not reply.ok or len(reply.ok.payload) > LARGEST_WORD:
            return
        node = node_of(str(reply.ok.key_expr))
        if node not in self._nodes:
            return
        with self._lock:
            asleep = not self._waiting
            self._waiting[node] = reply.ok.payload.to_bytes()
        if asleep:
            self._scheduler.schedule(self._drain)

    def _drain(self, *_: object) -> None:
        with self._lock:
            answers, self._waiting = self._waiting, {}
        for payload in answers.values():
            self._take(payload)

    def _take(self, payload: bytes) -> None:
        now = self._now()
        self._last = {container: (came, last) for container, (came, last) in self._last.items() if now - came < OLD}
        for container, counters in read_counters(payload).items():
            _, before = self._last.get(container, (now, None))
            if before is None or counters.at > before.at:
                self._last[container] = now, counters
            if before is not None and counters.at > before.at:
                self._usage[container] = _between(before, counters, now)

    def _now(self) -> float:
        return self._scheduler.to_seconds(self._scheduler.now)


def _between(before: Counters, after: Counters, now: float) -> Usage:
    periods = after.periods - before.periods
    throttled = (after.throttled - before.throttled) / periods if periods > 0 else None
    return Usage(now, max(0.0, after.used - before.used) / (after.at - before.at), throttled)


def read_counters(payload: bytes) -> dict[str, Counters]:
    """An agent's answer, by container ID; empty if it can't be read."""
    try:
        said: dict[str, Any] = json.loads(payload)
        at = float(said["at"])
        return {
            str(container): Counters(at, float(one["used"]), int(one["periods"]), int(one["throttled"]))
            for container, one in said["containers"].items()
        }
    except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
        return {}
