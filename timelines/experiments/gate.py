"""Passes on to the modules what a policy would decide that does not act: gating under every division."""

from __future__ import annotations

import queue
import threading
from typing import TYPE_CHECKING, Self

import zenoh

from robotkit import json_text
from timelines.recording.recorder import PATIENCE, PLANS

if TYPE_CHECKING:
    from types import TracebackType

KEY = "experiments/robot/gate/plan"
"""Where the modules listen instead of the decision bus (robotkit's PLAN_KEY)."""
EVERYTHING = 1000.0
"""Cores: more than any module can use, so that none adapts its quality to a share that is not enforced."""


def enforced(payload: bytes) -> bytes:
    """A plan's suspensions as if they were carried out, without its shares."""
    plan = json_text.loads(payload)
    tasks = {name: one if one["suspended"] else {**one, "share": EVERYTHING} for name, one in plan["tasks"].items()}
    return json_text.dumps({**plan, "mode": "Enforce", "tasks": tasks}).encode()


class Gate:
    """Passes plans on while its `with` block runs. Zenoh's callbacks must not call Zenoh: a thread publishes.

    Plans go out as the operator's own do, before all data: else a module that is starved would get them behind the
    pictures that fill its queue, or not at all, and only under the divisions that are relayed.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._heard: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._pass_on, name="gate", daemon=True)

    def __enter__(self) -> Self:
        self._publisher = self._session.declare_publisher(
            KEY, encoding=zenoh.Encoding.APPLICATION_JSON, express=True, priority=zenoh.Priority.REAL_TIME
        )
        self._thread.start()
        self._subscriber = self._session.declare_subscriber(PLANS, self._hear)
        for reply in self._session.get(PLANS, timeout=PATIENCE):  # published before we listened
            if reply.ok is not None:
                self._hear(reply.ok)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._subscriber.undeclare()
        self._heard.put(None)
        self._thread.join()
        self._publisher.undeclare()

    def _hear(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._heard.put(sample.payload.to_bytes())

    def _pass_on(self) -> None:
        while (payload := self._heard.get()) is not None:
            self._publisher.put(enforced(payload))
