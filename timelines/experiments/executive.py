"""The robot's executive: drives by what the tasks find out, so that a late pose is a late wheel command.

While the mission drives, each pose becomes an order for the wheels; a "stop" that was heard holds until the mission
goes on to something else. Each order is remembered with what it follows from: navigation's own timing of that order
then says how long it took from the camera, or from the speaker, to the wheels.
"""

from __future__ import annotations

import json
import queue
import threading
import time
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import zenoh

from robotkit import json_text
from robotkit.stamps import attachment
from timelines.scenarios import mission

if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import TracebackType

ORDER = "robot/navigation/order"
POSE, KEYWORD = "robot/slam/pose", "robot/speech/keyword"
STOP = {"stop": True}


class Sent(NamedTuple):
    """An order: what it follows from (a key), that one's own time, and the stamp it was sent with, in ns since 1970."""

    cause: str
    source: int
    stamp: int


class Pilot:
    """What to order next; nothing before there is a mission, since somebody else drives then. Pure."""

    def __init__(self) -> None:
        self._does, self._forward, self._stopped = "", 0.0, False

    def hear(self, key: str, value: Mapping[str, Any]) -> tuple[dict[str, Any], int] | None:
        """The order that follows from a message, with the time of its cause; None if nothing does."""
        if key == mission.KEY:
            return self._begin(value)
        if key == KEYWORD:
            if not self._does or value.get("keyword") != "stop":
                return None
            self._stopped = True
            return STOP, round(float(value["at"]) * 1e9)
        if not self._forward:
            return None
        order = STOP if self._stopped else {"drive": {"forward": self._forward, "turn": 0.0}}
        return order, int(value["stamp"])

    def _begin(self, value: Mapping[str, Any]) -> tuple[dict[str, Any], int] | None:
        drove, changed = bool(self._forward), value["does"] != self._does
        self._does, self._forward = value["does"], float(value["forward"])
        self._stopped = self._stopped and not changed
        return (STOP, int(value["stamp"])) if drove and not self._forward else None


class Executive:
    """Listens on one session and orders on another while its `with` block runs; `sent` has all orders."""

    def __init__(self, ears: zenoh.Session, voice: zenoh.Session) -> None:
        self.sent: list[Sent] = []
        self._ears, self._voice = ears, voice
        self._pilot = Pilot()
        self._heard: queue.SimpleQueue[tuple[str, bytes] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._order, name="executive", daemon=True)

    def __enter__(self) -> Self:
        self._publisher = self._voice.declare_publisher(ORDER, encoding=zenoh.Encoding.APPLICATION_JSON, express=True)
        self._thread.start()
        self._subscribers = [self._ears.declare_subscriber(key, self._hear) for key in (mission.KEY, POSE, KEYWORD)]
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._heard.put(None)
        self._thread.join()
        self._publisher.undeclare()

    def _hear(self, sample: zenoh.Sample) -> None:
        self._heard.put((str(sample.key_expr), sample.payload.to_bytes()))

    def _order(self) -> None:
        while (heard := self._heard.get()) is not None:
            key, payload = heard
            follows = self._pilot.hear(key, json_text.loads(payload))
            if follows is not None:
                order, source = follows
                stamp = time.time_ns()
                self._publisher.put(json.dumps({"stamp": stamp, **order}).encode(), attachment=attachment(stamp))
                self.sent.append(Sent(key, source, stamp))
