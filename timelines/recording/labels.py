"""A recording made on a robot, with what was true of the world, as a timeline. Pure but for reading the recording.

    name: kitchen-run
    description: The robot fetches a cup.
    phases:
    - {name: stands, from: 0, to: 12, truth: {moving: false}}
    truth:
    - {key: robot/imu, from: 0, to: 12, truth: {moving: false}}
    - {key: robot/microphone, truth: [{at: 5.3, keyword: forward}]}     # without from and to: all of it

JSON, and ROS 2 messages whose type is known, become values in the timeline, without their stamps: when it is played,
they are of that moment. Everything else (pictures, sound) stays in the recording, and is named.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import yaml

from contextpolicy.errors import DecodeError, Finding, FindingsError
from contextpolicy.policy.fields import Fields
from contextpolicy.policy.key_expressions import selects
from contextpolicy.policy.ros_types import is_known, type_store
from contextpolicy.policy.stream_spec import RosRelease
from contextpolicy.streams.cdr import reader
from contextpolicy.streams.recordings import Excerpt, bounds, timeline_key
from robotkit import json_text
from timelines.datasets.readers import stream_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from contextpolicy.streams.recorded_message import Recording, Topic

    Read = Callable[[bytes], Any]

MOST = 10_000
"""Labels of a file."""
LARGEST = 20_000
"""Values of a ROS message that still goes into the timeline."""
LAST = 0.001
"""Seconds that a timeline lasts after its last message: what is at its very end is not played."""
_NOT_FINITE = {math.inf: "Infinity", -math.inf: "-Infinity"}


class LabelError(FindingsError):
    """Labels that can't be used; the message lists everything that is wrong."""


@dataclass(frozen=True, slots=True)
class Label:
    """What is true of the inputs that a key expression selects, from `start` until just before `end`."""

    key: str
    start: float
    end: float
    truth: Any


@dataclass(frozen=True, slots=True)
class Labels:
    """A file of labels; phases are as in a timeline."""

    name: str
    description: str
    phases: tuple[dict[str, Any], ...]
    truth: tuple[Label, ...]

    def of(self, key: str, at: float) -> dict[str, Any]:
        """The truth of an input, as a timeline has it; of several labels the last counts."""
        found = [label.truth for label in self.truth if selects(label.key, key) and label.start <= at < label.end]
        return {"truth": found[-1]} if found else {}


def load_labels(path: Path) -> Labels:
    """Read a file; LabelError carries everything that is wrong with it."""
    findings: list[Finding] = []
    try:
        fields = Fields(yaml.safe_load(path.read_text(encoding="utf-8")), "labels", findings)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise LabelError(str(path), (Finding("file", str(path), f"a readable YAML file ({error})"),)) from error
    labels = Labels(
        name=fields.text("name", pattern=r"[A-Za-z0-9_-]+", allowed="letters, digits, '_' and '-'"),
        description=fields.text("description", "a labelled recording"),
        phases=tuple(_phase(own) for own in fields.nested_list("phases", limit=MOST)),
        truth=tuple(_label(own) for own in fields.nested_list("truth", limit=MOST)),
    )
    fields.close()
    if findings:
        raise LabelError(str(path), tuple(findings))
    return labels


def _phase(fields: Fields) -> dict[str, Any]:
    start, end = _span(fields)
    phase = {"name": fields.text("name"), "from": start, "to": end, "truth": fields.raw("truth")}
    fields.close()
    return {name: value for name, value in phase.items() if value is not None}


def _label(fields: Fields) -> Label:
    start, end = _span(fields)
    label = Label(fields.key_expression("key"), start, end, fields.raw("truth"))
    if label.truth is None:
        fields.refuse("truth", None, "the ground truth of these inputs")
    fields.close()
    return label


def _span(fields: Fields) -> tuple[float, float]:
    start, end = fields.number("from"), fields.number("to")
    if start is not None and end is not None and end <= start:
        fields.refuse("to", end, f"after from, {start:g}")
    return start or 0.0, math.inf if end is None else end


def labelled(recording: Recording, labels: Labels) -> dict[str, Any]:
    """The timeline's document; what it names is stream `stream_of(topic)` of the data set `labels.name`."""
    begin, end = bounds(recording, Excerpt())
    duration = (end - begin) / 1e9 + LAST
    return {
        "$schema": "schema.json",
        "name": labels.name,
        "description": labels.description,
        "duration": duration,
        "phases": [{**phase, "to": min(phase["to"], duration)} for phase in labels.phases if phase["from"] < duration],
        "inputs": list(_inputs(recording, labels, begin, duration)),
    }


def _inputs(recording: Recording, labels: Labels, begin: int, duration: float) -> Iterator[dict[str, Any]]:
    for topic in recording.topics.values():
        read, form = _reader(topic)
        if read is None:
            key = timeline_key(topic)
            whole = {"key": key, "encoding": "binary", "from": 0, "to": duration}
            rate = min(max(round(topic.messages / duration, 3), 0.001), 1000)
            yield {**whole, "dataset": f"{labels.name}/{stream_of(topic.name)}", "rate": rate, **labels.of(key, 0.0)}
            continue
        for message in recording.messages([topic.name], recording.begin, recording.end):
            at = round((message.at - begin) / 1e9, 6)
            yield {**form, "at": at, "value": read(message.payload), **labels.of(form["key"], at)}


def _reader(topic: Topic) -> tuple[Read | None, dict[str, Any]]:
    """How a topic's messages become values, and the fields of its entries; None if they stay in the recording."""
    if topic.encoding == "json":
        return _from_json, {"key": timeline_key(topic), "encoding": "json"}
    store = type_store(RosRelease.LATEST, ())
    if topic.encoding != "cdr" or not is_known(topic.type, store) or topic.type in _BULKY:
        return None, {}
    decode = reader(topic.type, store, max_values=LARGEST)
    form = {"key": timeline_key(topic), "encoding": "cdr", "type": topic.type}
    return lambda payload: _plain(decode(payload)), form


def _from_json(payload: bytes) -> Any:
    try:
        value = json_text.loads(payload)
    except ValueError as error:
        raise DecodeError(f"a message is not JSON:  {error}") from error
    return {name: part for name, part in value.items() if name != "stamp"} if isinstance(value, dict) else value


def _plain(value: Any) -> Any:
    """Without the stamps of headers, and with words for what JSON can't say."""
    if isinstance(value, dict):
        header = {"stamp", "frame_id"} == value.keys()
        return {name: _plain(part) for name, part in value.items() if not (header and name == "stamp")}
    if isinstance(value, list):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not math.isfinite(value):
        return _NOT_FINITE.get(value, "NaN")
    return value


_BULKY = {f"sensor_msgs/msg/{name}" for name in ("Image", "CompressedImage", "PointCloud", "PointCloud2")}
"""Types that would make a timeline unreadable."""
