"""Records the bus (inputs, plans, results) and the kernel (limits, CPU, throttling) while its `with` block runs."""

from __future__ import annotations

import queue
import threading
import time
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, Self

from robotkit import json_text
from robotkit.stamps import attached
from timelines.demo.cgroup import find
from timelines.recording.ros_offers import TOKENS, offer_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    import zenoh

    from timelines.demo.cgroup import Cgroup
    from timelines.recording.ros_topics import RosTopics

EVERYTHING = "**"
PLANS = "contextpolicy/*/*/plan"
CGROUP_INTERVAL = 0.1
"""Seconds between readings of the kernel's counters: a period of CPU limits."""
PATIENCE = 2.0
"""Seconds to wait for the plan in force."""


class _Heard(NamedTuple):
    key: str
    encoding: str
    payload: bytes
    received: int
    stamp: int


class Recorded(Protocol):
    """Where a recording goes: to a file, or to live viewers."""

    def heard(self, key: str, encoding: str, payload: bytes, *, received: int, stamp: int) -> None:
        """Take a message of the bus; times are in ns since 1970."""

    def counted(self, topic: str, schema: str, value: Mapping[str, Any], at: int) -> None:
        """Take a measurement that was never on the bus."""


class BusRecorder:
    """Writes into an open file. Containers are those of the plans on the bus, and those in `cgroups` by task.

    Of the keys in `without_payload` only the stamp and the size are written, on `published/<key>`: to compress pictures
    takes CPU, and who plays a timeline has its recordings. `topics` learns the QoS that the bus's publishers offer.
    """

    def __init__(
        self,
        session: zenoh.Session,
        file: Recorded,
        cgroups: Mapping[str, Cgroup] | None = None,
        *,
        without_payload: Collection[str] = (),
        topics: RosTopics | None = None,
    ) -> None:
        self._session, self._file, self._without_payload = session, file, without_payload
        self._topics = topics
        self._cgroups: dict[str, Cgroup] = dict(cgroups or {})
        self._heard: queue.SimpleQueue[_Heard] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self._subscriber: Any = None
        self._failure: Exception | None = None

    def __enter__(self) -> Self:
        if self._topics is not None:
            self._learn_offers(self._topics)
        self._subscriber = self._session.declare_subscriber(EVERYTHING, self._hear)
        for reply in self._session.get(PLANS, timeout=PATIENCE):  # published before we listened, and not repeated
            if reply.ok is not None:
                self._hear(reply.ok)
        self._thread.start()
        return self

    def _learn_offers(self, topics: RosTopics) -> None:
        for reply in self._session.liveliness().get(TOKENS, timeout=PATIENCE):
            offer = offer_of(str(reply.ok.key_expr)) if reply.ok is not None else None
            if offer is not None:
                topics.offer(*offer)

    def __exit__(self, *_: object) -> None:
        self._subscriber.undeclare()
        self._ended.set()
        self._thread.join()
        if self._failure is not None:
            raise self._failure

    def _hear(self, sample: zenoh.Sample) -> None:
        """Copy what the callback has: the file is the writer thread's."""
        if self._failure is not None:  # nobody takes it any more
            return
        received, payload = time.time_ns(), sample.payload.to_bytes()
        encoding = encoding_of(str(sample.encoding), str(sample.key_expr), payload)
        self._heard.put(_Heard(str(sample.key_expr), encoding, payload, received, attached(sample).stamp or received))

    def _work(self) -> None:
        try:
            self._write()
        except Exception as error:  # noqa: BLE001 - raised again at the end of the `with` block
            self._failure = error

    def _write(self) -> None:
        due = time.monotonic()
        while not self._ended.is_set() or not self._heard.empty():
            try:
                heard = self._heard.get(timeout=max(due - time.monotonic(), 0))
            except queue.Empty:
                due += CGROUP_INTERVAL
                self._count()
                continue
            self._keep(heard)
            if heard.key.startswith("contextpolicy/") and heard.key.endswith("/plan"):
                self._learn(heard.payload)
            if time.monotonic() >= due:
                due += CGROUP_INTERVAL
                self._count()

    def _keep(self, heard: _Heard) -> None:
        if heard.key in self._without_payload:
            size = {"stamp": heard.stamp, "bytes": len(heard.payload)}
            self._file.counted(f"published/{heard.key}", "published", size, heard.received)
        else:
            self._file.heard(heard.key, heard.encoding, heard.payload, received=heard.received, stamp=heard.stamp)

    def _learn(self, payload: bytes) -> None:
        """Find the containers that a plan is for."""
        for task, identity in targets(payload):
            if task not in self._cgroups or not self._cgroups[task].quota_file.exists():
                found = find(identity)
                if found is not None:
                    self._cgroups[task] = found

    def _count(self) -> None:
        now = time.time_ns()
        for task, cgroup in self._cgroups.items():
            counters = {"limit": cgroup.limit(), "usage": cgroup.usage(), **cgroup.throttling()}
            self._file.counted(f"cgroup/{task}", "cgroup", counters, now)


def encoding_of(encoding: str, key: str, payload: bytes) -> str:
    """MCAP's word for a payload: json, cdr, or what Zenoh says of it."""
    if "::msg::dds_::" in key:
        return "cdr"
    if "json" in encoding or (encoding == "zenoh/bytes" and payload[:1] in (b"{", b"[") and _is_json(payload)):
        return "json"
    return encoding


def targets(payload: bytes) -> Iterator[tuple[str, str]]:
    """Task and container id of each container that a plan on the bus is for."""
    try:
        listed = json_text.loads(payload).get("targets", ())
        yield from [(str(target["task"]), str(target["containerId"])) for target in listed if target.get("containerId")]
    except (ValueError, AttributeError, KeyError, TypeError):
        return  # a withdrawal, or not from an operator


def _is_json(payload: bytes) -> bool:
    try:
        json_text.loads(payload)
    except ValueError:
        return False
    return True
