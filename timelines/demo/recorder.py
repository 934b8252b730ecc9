"""Everything that happens while the timeline plays: plans from the bus, limits and CPU use from the cgroups."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

import zenoh

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from timelines.demo.cgroup import Cgroup

WATCH_INTERVAL = 0.002
"""Seconds between reads of the quota files, hence the resolution of reaction times: the kernel notifies nobody."""
USAGE_INTERVAL = 0.5


@dataclass(slots=True)
class Recording:
    """Times are Unix seconds; plans are as on the decision bus (see `contextpolicy.planning.plan_json`)."""

    plans: list[dict[str, Any]] = field(default_factory=list)
    applied: list[dict[str, Any]] = field(default_factory=list)
    limits: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    usage: dict[str, list[tuple[float, float]]] = field(default_factory=dict)

    def limit(self, task: str) -> float | None:
        """The limit read last."""
        steps = self.limits.get(task)
        return steps[-1][1] if steps else None

    def cores_used(self, task: str) -> float:
        """Cores used over the last interval."""
        steps = self.usage.get(task, [])
        if len(steps) < 2:
            return 0.0
        (before, low), (after, high) = steps[-2:]
        return (high - low) / (after - before)


class Recorder:
    """Records while its `with` block runs."""

    def __init__(self, session: zenoh.Session, policy: str, cgroups: Mapping[str, Cgroup]) -> None:
        self.recording = Recording()
        self._cgroups = cgroups
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="cgroups", daemon=True)
        self._session, self._base = session, f"contextpolicy/{policy}"
        self._subscribers: list[Any] = []

    def __enter__(self) -> Self:
        self._ask_for_the_plan_in_force()
        for key, into in (("plan", self.recording.plans), ("applied", self.recording.applied)):
            self._subscribers.append(self._session.declare_subscriber(f"{self._base}/{key}", _collect(into)))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(timeout=5)
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _ask_for_the_plan_in_force(self) -> None:
        """Fetch the plan in force: it was published before we subscribed, and nobody repeats it."""
        for reply in self._session.get(f"{self._base}/plan", timeout=2.0):
            if reply.ok is not None:
                plan = json.loads(reply.ok.payload.to_bytes())
                self.recording.plans.append({"trigger": plan["time"], **plan})

    def _watch(self) -> None:
        next_usage = 0.0
        while not self._stop.wait(WATCH_INTERVAL):
            now = time.time()
            for task, cgroup in self._cgroups.items():
                limit = cgroup.limit()
                if limit is not None and limit != self.recording.limit(task):
                    self.recording.limits.setdefault(task, []).append((now, limit))
            if now >= next_usage:
                next_usage = now + USAGE_INTERVAL
                for task, cgroup in self._cgroups.items():
                    self.recording.usage.setdefault(task, []).append((now, cgroup.usage()))


def _collect(into: list[dict[str, Any]]) -> Callable[[zenoh.Sample], None]:
    """A callback that collects messages; withdrawals, sent when a policy ends, are ignored."""

    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            into.append(json.loads(sample.payload.to_bytes()))

    return take
