"""What must hold for any bytes: each target takes some, and raises only where something is wrong with us.

Hypothesis feeds them in `test_fuzz`, atheris by hand in `__main__`.
"""

from __future__ import annotations

import copy
import io
import json
import math
from contextlib import nullcontext, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import urllib3
from rich.console import Console

from contextpolicy.agent import node_orders
from contextpolicy.agent.admission import Admission
from contextpolicy.bus.view import BusView
from contextpolicy.bus.view_tables import live
from contextpolicy.cluster.agent_reports import (
    LONGEST_PERIOD,
    MOST_PROCESSORS,
    SHORTEST_PERIOD,
    read_confirmation,
    read_report,
)
from contextpolicy.cluster.api import _version
from contextpolicy.cluster.api_connection import _refusal
from contextpolicy.cluster.paging import Page
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.watching import ObjectWatch
from contextpolicy.errors import ActuationError, DecodeError, DefinitionError, ExpressionError, OrderError, PolicyError
from contextpolicy.planning.conditions.scope import Scope
from contextpolicy.planning.planner import Planner
from contextpolicy.policy import parsing
from contextpolicy.policy.ros_types import type_store
from contextpolicy.policy.stream_spec import Encoding, RosRelease, Stream
from contextpolicy.streams.decoding import Decoder, seconds
from contextpolicy.streams.recorded_message import RecordingError
from contextpolicy.streams.recordings import DamageLog, Excerpt, open_recording
from tests.agent.builders import NODE
from tests.agent.builders import POLICY as OBEYED
from tests.planning.builders import on_node
from tests.planning.quiet import Quiet

if TYPE_CHECKING:
    from collections.abc import Iterator

START = 1_000.0
ROS_TYPES = (
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/PointCloud2",
    "nav_msgs/msg/Odometry",
    "geometry_msgs/msg/PoseArray",
    "diagnostic_msgs/msg/DiagnosticArray",
    "std_msgs/msg/String",
)
STREAMS = (
    *(Stream("x", "robot/x", Encoding(name), timestamp="stamp") for name in ("json", "cbor", "msgpack")),
    *(Stream("x", "robot/x", Encoding.CDR, type=name, timestamp="header.stamp") for name in ROS_TYPES),
)
DECODERS = tuple(Decoder(stream) for stream in STREAMS)

DOCUMENT: dict[str, Any] = {
    "metadata": {"name": "fuzz", "namespace": "lab"},
    "spec": {
        "reserve": "100m",
        "fallback": "blind",
        "streams": [
            {
                "name": "x",
                "key": "robot/x",
                "staleAfter": "1s",
                "timestamp": "stamp",
                "sampleEvery": "5ms",
                "filter": "!has(x.off)",
                "features": [{"name": "shaking", "op": "mean", "of": "has(x.a) ? x.a : 0.0", "over": "1s"}],
            }
        ],
        "tasks": [
            {
                "name": "slam",
                "selector": {"matchLabels": {"app": "slam"}},
                "min": "100m",
                "activity": [{"scoreFrom": "x.value"}, {"when": "norm(x.gyro) > 0.1", "hold": "1s", "decay": "1s"}],
            },
            {"name": "rest", "selector": {"matchLabels": {"app": "rest"}}, "requires": [{"when": "x.a != x.b"}]},
            {"name": "base", "selector": {"matchLabels": {"app": "base"}}, "max": "500m"},
        ],
        "contexts": [
            {"name": "blind", "tasks": {"slam": {"suspend": True}}},
            {"name": "old", "when": "!heard(x) || age(x) > 1.5 || age(x) <= 0.25", "tasks": {"rest": {"weight": 2}}},
            {
                "name": "moving",
                "when": "x.l.exists(v, v > 1.0) || x.shaking > 0.5 || x.a % 2 == x.l[x.b]",
                "enterAfter": "50ms",
                "exitAfter": "50ms",
                "tasks": {"rest": {"scale": 3}},
            },
        ],
    },
}
POLICY = parsing.parse(DOCUMENT)
EDITED = parsing.parse({**DOCUMENT, "spec": {**DOCUMENT["spec"], "reserve": "200m"}})
JUNK: tuple[Any, ...] = (
    *(None, True, 0, -1, 10**400, 1e308, float("nan"), "", "x", "5s", "1", "2h", "x.a > 1.0", "slam", "blind", "cdr"),
    *(
        [],
        {},
        [None],
        [[]],
        {"": None},
        {"name": "slam"},
        ["slam", "slam"],
        {"slam": {"scale": 2}},
        "a" * 2000,
        "\ud800",
    ),
)


class Robot:
    """A planner that is fed anything; after each step its plan must be a good one."""

    def __init__(self) -> None:
        self.planner = Planner(POLICY, Quiet(), {})
        self.planner.start(START)
        self.planner.handle(on_node(*(task.name for task in POLICY.tasks), cores=2), START)
        self.now = START
        self.taken = 0

    def take(self, event: Any, after: float) -> None:
        """Hand an input over, some time after the last."""
        self.now += after
        self.taken += 1
        self.planner.handle(event, self.now)
        self.check()

    def edit(self, after: float) -> None:
        """Another field of the policy changes; what the planner knew must be what the next one knows."""
        self.now += after
        self.planner.advance(self.now)
        known = self._known()
        before, placement = self.planner, self.planner.placement
        self.planner = Planner(EDITED if before.policy is POLICY else POLICY, Quiet(), {})
        self.planner.start(self.now, before)
        assert self._known() == known
        self.planner.handle(placement, self.now)
        self.check()

    def _known(self) -> object:
        contexts = [(context.spec.name, context.active) for context in self.planner.contexts]
        features = [stream.features(self.now) for stream in self.planner.streams.values()]
        return contexts, self.planner.scores(), dict(self.planner._scores.unmet), features, self.planner.next_due()

    def check(self) -> None:
        """The last good plan stands."""
        due = self.planner.next_due()
        assert due is None or due > self.now
        plan = self.planner.last
        if plan is None:
            return
        for node in plan.nodes.values():
            assert sum(node.containers.values()) <= node.capacity
            assert min(node.containers.values()) >= 10
        assert all(math.isfinite(task.weight) and task.weight >= 0 for task in plan.tasks.values())
        assert {"slam", "rest", "base"} == set(plan.tasks)


def payload(data: bytes) -> None:
    """A payload of any encoding: a sample that the planner survives, or a DecodeError that says what."""
    decoder = DECODERS[data[0] % len(DECODERS)] if data else DECODERS[0]
    try:
        sample = decoder.decode(data[1:])
    except DecodeError as error:
        text = str(error)
        assert text.startswith("stream x: the ")
        assert len(text) < 400
        return
    robot = Robot()
    robot.take(sample, 0.5)
    robot.take(sample, 0.5)


def policy(data: bytes) -> None:
    """A good policy with some fields damaged: valid still, or a PolicyError that names fields."""
    body(damaged(DOCUMENT, data))


def damaged(good: Any, data: bytes) -> Any:
    """A copy of a good document with up to ten fields replaced, three bytes each; the others make a text for them."""
    document = copy.deepcopy(good)
    edits, text = data[:30], data[30:]
    junk = [*JUNK, text.decode(errors="replace")]
    for high, low, choice in zip(edits[::3], edits[1::3], edits[2::3], strict=False):
        all_places = list(places(document))
        if all_places:
            place, key = all_places[(high << 8 | low) % len(all_places)]
            place[key] = copy.deepcopy(junk[choice % len(junk)])
    return document


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Every place in a document, as container and key."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, below in list(items):
        yield value, key
        yield from places(below)


def body(document: Any) -> None:
    """A policy as decoded JSON or YAML."""
    try:
        parsed = parsing.parse(document)
    except PolicyError as error:
        _check_findings(error)
        return
    planner = Planner(parsed, Quiet(), {})
    planner.start(START)
    planner.handle(on_node(*(task.name for task in parsed.leaves), cores=2), START)


def definitions(name: str, text: str) -> None:
    """Any message definition: refused with a reason, or types of which each can be compiled and decodes anything."""
    try:
        store = type_store(RosRelease.LATEST, ((name, text),))
    except DefinitionError:
        return
    for type_name in store.fielddefs.keys() - type_store().fielddefs.keys():
        own = Stream("x", "robot/x", Encoding.CDR, type=type_name, types="own", definitions=((name, text),))
        with suppress(DecodeError):
            Decoder(own).decode(b"\0\1\0\0" + bytes(range(64)))


def _check_findings(error: PolicyError) -> None:
    assert error.findings
    assert all(finding.field and finding.allowed for finding in error.findings)


def expression(data: bytes) -> None:
    """A CEL source: refused, an answer, or an ExpressionError."""
    scope = Scope()
    try:
        compiled = scope.compile(data.decode(errors="replace"))
    except ValueError:
        return
    for sample in ({"a": 1.5, "l": [1.0, 2.0], "s": "text", "m": {"k": None, "n": float("nan")}}, {"a": 2**60}):
        with suppress(ExpressionError):
            compiled.evaluate(scope)
        scope.bind("x", sample)
        with suppress(ExpressionError):
            compiled.evaluate(scope)
    scope.unbind("x")
    with suppress(ExpressionError):
        compiled.evaluate(scope)


def timestamp(stamp: object) -> None:
    """Anything in a timestamp's place."""
    with suppress(DecodeError):
        assert isinstance(seconds(stamp), float | int)


def recording(content: bytes) -> None:
    """Any bytes as an MCAP file: read without what is damaged, or refused by name."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(content)
        damages = DamageLog()
        try:
            opened = open_recording(path, Excerpt(), damages)
            for message in opened.messages(opened.topics, opened.begin, opened.end):
                assert message.topic in opened.topics
        except RecordingError as error:
            refused = str(error)
        else:
            refused = str(path)
        assert refused.startswith(str(path))
        assert all(note.startswith(str(path)) for note in damages.notes)


def report(payload: bytes) -> None:
    """Anything as an agent's report: what is made of it is a number of processors and a period that a node can have."""
    found = read_report(payload)
    assert found.processors is None or 1 <= found.processors <= MOST_PROCESSORS
    assert found.quota_period is None or SHORTEST_PERIOD <= found.quota_period <= LONGEST_PERIOD
    read_confirmation(payload)


def order(payload: bytes) -> None:
    """Anything as a plan for an agent: an order within what a node can have that it admits or refuses, or refused."""
    agent = Admission(cpus=lambda: 2)
    for signed in (1, 2):
        with suppress(OrderError):
            found = agent.admit(node_orders.read(payload, OBEYED, NODE), signed)
            assert found is None or sum(target.share for target in found.targets) <= 2000


def shown(messages: list[tuple[str, bytes]]) -> None:
    """Anything on the decision bus's keys: viewers see the policies that make sense."""
    seen = BusView()
    for key, payload in messages:
        changed = seen.take(key, payload)
        assert changed is None or json.dumps(changed)
    console = Console(width=120, file=io.StringIO())
    console.print(live(seen, START))


def board(payload: bytes) -> None:
    """Anything as an answer about a policy's board, on an open bus: what makes sense is shown."""
    seen = BusView()
    with suppress(ValueError, RecursionError):
        seen.take_board(json.loads(payload))
    Console(width=120, file=io.StringIO()).print(live(seen, START))


class _Server:
    """An API server that lists nothing, whose watch says one line, and that ends the watch when it is listed again."""

    def __init__(self, line: bytes) -> None:
        self.line, self.lists, self.stop = line, 0, Event()

    def read_page(self, _path: str, _most: int | None) -> Page:
        self.lists += 1
        if self.lists > 1:
            self.stop.set()
        return Page({"items": [], "metadata": {"resourceVersion": "1"}}, 1)

    def watch(self, _path: str, _version: str) -> Any:
        return nullcontext(SimpleNamespace(stream=lambda **_: iter([self.line + b"\n"])))


class _NoWait:
    """The watch's own flag, without its pauses; a watch that the server just ends goes on at once, here it ends."""

    def __init__(self, server: _Server) -> None:
        self._server, self._waits = server, 0

    def is_set(self) -> bool:
        return self._server.stop.is_set() or self._waits > 1

    def wait(self, _seconds: float) -> None:
        self._waits += 1


def event(line: bytes) -> None:
    """Anything as a line of a watch: its thread goes on, and reads the list again or watches on."""
    server = _Server(line)
    watch = ObjectWatch(server, "/api/v1/pods", Pods())
    watch._stop = _NoWait(server)  # type: ignore[assignment]
    watch._run()


class Pods:
    """Takes each object as a pod."""

    def on_object(self, document: Any) -> None:
        pod(document)

    def on_gone(self, _uid: str) -> None:
        """Nothing."""

    def on_listing(self) -> None:
        """Nothing."""


def pod(document: Any) -> None:
    """A pod as decoded JSON: a view of it, or an error that the operator logs with the pod's name."""
    with suppress(ValueError):
        view(document)


def answer(status: int, body: bytes) -> None:
    """Anything as the API server's answer to a PATCH: a version, or an ActuationError that can be reported."""
    response = urllib3.HTTPResponse(io.BytesIO(body), status=status)
    if status >= 300:
        assert str(_refusal(response))
        return
    with suppress(ActuationError):
        assert _version(body) >= 0
