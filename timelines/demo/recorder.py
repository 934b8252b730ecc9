"""Everything that happens while the timeline plays: plans on the bus, limits in the API, cgroups in the kernel."""

from __future__ import annotations

import json
import math
import subprocess
import threading
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self, TypeVar

import zenoh

from contextpolicy.policy.quantities import parse_cpu
from timelines.demo.deploy import ROBOT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from timelines.demo.cgroup import Cgroup

Number = TypeVar("Number", int, float)

WATCH_INTERVAL = 0.002
"""Seconds between reads of the quota files, hence the resolution of reaction times: the kernel does not notify."""
USAGE_INTERVAL = 0.5
LIMITS = (
    '{{range .spec.containers}}{{.name}}={{with .resources.limits}}{{with .cpu}}{{.}}{{end}}{{end}} {{end}}{{"\\n"}}'
)
WATCH = ("kubectl", "get", "pods", "--namespace", ROBOT, "--watch", "--output", f"go-template={LIMITS}")


@dataclass(slots=True)
class Recording:
    """Times are Unix seconds; plans are as on the decision bus (see `contextpolicy.planning.plan_json`).

    By task: `limits` are the kernel's quotas in cores, `weights` those of the pods' groups in the kernel's unit,
    `patched` the limits in the API in cores, `usage` the CPU seconds so far. `ended` is when it stopped recording.
    """

    plans: list[dict[str, Any]] = field(default_factory=list)
    applied: list[dict[str, Any]] = field(default_factory=list)
    limits: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    weights: dict[str, list[tuple[float, int]]] = field(default_factory=dict)
    patched: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    usage: dict[str, list[tuple[float, float]]] = field(default_factory=dict)
    ended: float = math.inf

    def limit(self, task: str) -> float | None:
        """The limit read last."""
        steps = self.limits.get(task)
        return steps[-1][1] if steps else None

    def weight(self, task: str) -> int | None:
        """The weight read last."""
        steps = self.weights.get(task)
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
        self._pods = watched(self.recording.patched)

    def __enter__(self) -> Self:
        self._ask_for_the_plan_in_force()
        for key, into in (("plan", self.recording.plans), ("applied", self.recording.applied)):
            self._subscribers.append(self._session.declare_subscriber(f"{self._base}/{key}", _collect(into)))
        self._thread.start()
        self._pods.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self.recording.ended = time.time()
        self._stop.set()
        self._pods.__exit__(None, None, None)
        self._thread.join(timeout=5)
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _ask_for_the_plan_in_force(self) -> None:
        """Fetch the plan in force: it was published before we subscribed, and is not repeated."""
        for reply in self._session.get(f"{self._base}/plan", timeout=2.0):
            if reply.ok is not None:
                plan = json.loads(reply.ok.payload.to_bytes())
                self.recording.plans.append({"trigger": plan["time"], **plan})

    def _watch(self) -> None:
        next_usage = 0.0
        while not self._stop.wait(WATCH_INTERVAL):
            now = time.time()
            for task, cgroup in self._cgroups.items():
                limit, weight, read = cgroup.limit(), cgroup.weight(), time.time()  # before, it may be the last plan's
                _note(self.recording.limits, task, read, limit)
                _note(self.recording.weights, task, read, weight)
            if now >= next_usage:
                next_usage = now + USAGE_INTERVAL
                for task, cgroup in self._cgroups.items():
                    self.recording.usage.setdefault(task, []).append((now, cgroup.usage()))


@contextmanager
def watched(limits: dict[str, list[tuple[float, float]]]) -> Iterator[None]:
    """Note the tasks' CPU limits in the API as kubectl watches them; a watch begins with what is there."""
    with subprocess.Popen(WATCH, stdout=subprocess.PIPE, text=True) as process:

        def read() -> None:
            for line in process.stdout or ():
                note_limits(limits, line, time.time())

        reader = threading.Thread(target=read, name="pods", daemon=True)
        reader.start()
        try:
            yield
        finally:
            process.terminate()
            reader.join(timeout=5)


def note_limits(limits: dict[str, list[tuple[float, float]]], line: str, now: float) -> None:
    """Note what a line of the watch says: `name=limit` of each container of a pod."""
    for word in line.split():
        name, _, limit = word.partition("=")
        _note(limits, name, now, parse_cpu(limit) / 1000 if limit else None)


def _note(steps: dict[str, list[tuple[float, Number]]], task: str, now: float, value: Number | None) -> None:
    """Add a value that differs from the last one."""
    own = steps.setdefault(task, [])
    if value is not None and (not own or own[-1][1] != value):
        own.append((now, value))


def _collect(into: list[dict[str, Any]]) -> Callable[[zenoh.Sample], None]:
    """A callback that collects messages; withdrawals, sent when a policy ends, are ignored."""

    def take(sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            into.append(json.loads(sample.payload.to_bytes()))

    return take
