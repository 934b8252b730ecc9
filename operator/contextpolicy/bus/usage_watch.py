"""What containers use and how much they are throttled, as the nodes' agents read it from the cgroups.

Requested only while a board is open: without a viewer, no agent reads anything.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import zenoh

from contextpolicy.bus.decision_bus import usage_key
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

    def now(self) -> Mapping[str, Usage]:
        """The latest usage by container ID; queries the agents again, for the next call."""
        now = self._now()
        if now - self._asked_at >= ASK_EVERY:
            self._asked_at = now
            drop = zenoh.CongestionControl.DROP
            self._session.get(usage_key("*"), directly(self._on_reply), timeout=PATIENCE, congestion_control=drop)
        self._usage = {container: usage for container, usage in self._usage.items() if now - usage.at < OLD}
        return self._usage

    def _on_reply(self, reply: zenoh.Reply) -> None:
        """Zenoh's callbacks must not block."""
        if reply.ok and len(reply.ok.payload) <= LARGEST_WORD:
            node, payload = str(reply.ok.key_expr).split("/")[2], reply.ok.payload.to_bytes()
            self._scheduler.schedule(lambda *_: self._take(payload) if node in self._nodes else None)

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
