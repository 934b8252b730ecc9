"""What viewers can draw: our messages in Foxglove's standard schemas (docs.foxglove.dev, message schemas). Pure.

The raw message is always recorded too; these are additions, for people.
"""

from __future__ import annotations

import base64
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robotkit import MessageError, json_text
from robotkit.stereo import decode

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping


@dataclass(frozen=True, slots=True)
class Shown:
    """One message for a viewer: `schema` is the name by which Foxglove knows it; a panel of `topic` shows it."""

    topic: str
    schema: str
    value: dict[str, Any]


def shown(key: str, encoding: str, payload: bytes, stamp: int) -> Iterator[Shown]:
    """What can be drawn of a message; nothing for most. `stamp` is in ns since 1970.

    The keys are ours; a topic of ROS may have the same name, and viewers draw its messages themselves.
    """
    for ending, show in _SHOWS.items():
        if key.endswith(ending) and encoding != "cdr":
            try:
                yield from show(key, payload, _time(stamp))
            except (MessageError, ValueError, KeyError, TypeError, AttributeError):
                return  # not what the key promises: the raw message is in the file


def schema_of(name: str) -> dict[str, Any]:
    """The JSON Schema of one of our topics or of Foxglove's messages; `time` and `bytes` as Foxglove writes them."""
    return {"type": "object", "title": name, "properties": _PROPERTIES.get(name, {})}


def _scan(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    scan = json_text.loads(payload)
    ranges = [float(distance) or _NO_ECHO for distance in scan["ranges"]]
    start, turn = float(scan.get("start_angle", 0.0)), math.tau * (1 - 1 / max(len(ranges), 1))
    angles = {"start_angle": start, "end_angle": float(scan.get("end_angle", start + turn))}
    fields = {"timestamp": time, "frame_id": "robot", "pose": _ORIGIN, **angles}
    yield Shown(f"{key}/shown", "foxglove.LaserScan", {**fields, "ranges": ranges, "intensities": []})


def _pose(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    message = json_text.loads(payload)
    position, orientation = (dict(zip("xyzw", message[name], strict=False)) for name in ("position", "orientation"))
    pose = {"position": position, "orientation": orientation}
    yield Shown(f"{key}/shown", "foxglove.PoseInFrame", {"timestamp": time, "frame_id": "world", "pose": pose})


def _stereo(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    yield _picture(f"{key}/left", decode(payload).left, time)


def _side(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    yield _picture(f"{key}/shown", payload, time)


def _picture(topic: str, data: bytes, time: Mapping[str, int]) -> Shown:
    form = next((form for beginning, form in _FORMS.items() if data.startswith(beginning)), None)
    if form is None:
        raise MessageError(f"a picture that begins with {data[:4]!r}")
    encoded = base64.b64encode(data).decode()
    value = {"timestamp": time, "frame_id": "camera", "data": encoded, "format": form}
    return Shown(topic, "foxglove.CompressedImage", value)


def _sound(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    if len(payload) % 2:
        raise MessageError(f"{len(payload)} bytes are not 16 bit samples")
    fields = {"format": "pcm-s16", "sample_rate": 16000, "number_of_channels": 1}
    yield Shown(
        f"{key}/shown", "foxglove.RawAudio", {"timestamp": time, "data": base64.b64encode(payload).decode(), **fields}
    )


def _plan(key: str, payload: bytes, time: Mapping[str, int]) -> Iterator[Shown]:
    plan = json_text.loads(payload)
    shares = ", ".join(f"{name} {task['share']:g}" for name, task in plan["tasks"].items())
    message = f"{', '.join(plan['contexts']) or 'no context'}; {plan['cause']}; {shares}"
    fields = {"level": 2, "name": str(plan["policy"]), "file": "", "line": 0}
    yield Shown(f"{key}/shown", "foxglove.Log", {"timestamp": time, "message": message, **fields})
    state = {"timestamp": time, "contexts": ", ".join(plan["contexts"]) or "-", "tasks": _parts(plan)}
    yield Shown(f"{key}/state", "contextpolicy.State", state)


def _parts(plan: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Of each task that has a share of its own: that, and its weight as a part of all of theirs (Figures 7 and 5)."""
    leaves = {name for node in plan["nodes"].values() for name in node["tasks"]}
    tasks = {name: task for name, task in plan["tasks"].items() if name in leaves}
    total = sum(task["weight"] for task in tasks.values()) or 1.0
    return {name: {"weight": task["weight"] / total, "share": task["share"]} for name, task in tasks.items()}


def _time(stamp: int) -> dict[str, int]:
    return {"sec": stamp // 10**9, "nsec": stamp % 10**9}


_SHOWS: dict[str, Callable[[str, bytes, Mapping[str, int]], Iterator[Shown]]] = {
    "lidar/scan": _scan,
    "slam/pose": _pose,
    "camera/stereo": _stereo,
    "camera/side": _side,
    "/microphone": _sound,
    "/plan": _plan,
}
_NO_ECHO = 1e6
"""Metres at which a ray is drawn that met nothing: out of sight, as JSON has no infinity and 0 is at the sensor."""
_FORMS = {b"\x89PNG": "png", b"\xff\xd8": "jpeg"}
"""How pictures begin."""
_ORIGIN = {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}
_TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
_TEXT, _NUMBER, _INTEGER = {"type": "string"}, {"type": "number"}, {"type": "integer"}
_NUMBERS = {"type": "array", "items": _NUMBER}
_BYTES = {"type": "string", "contentEncoding": "base64"}


def _object(names: str) -> dict[str, Any]:
    return {"type": "object", "properties": dict.fromkeys(names, _NUMBER)}


_POSE = {"type": "object", "properties": {"position": _object("xyz"), "orientation": _object("xyzw")}}
_FRAME = {"timestamp": _TIME, "frame_id": _TEXT}
_PROPERTIES: dict[str, dict[str, Any]] = {
    "foxglove.LaserScan": {
        **_FRAME,
        "pose": _POSE,
        "start_angle": _NUMBER,
        "end_angle": _NUMBER,
        "ranges": _NUMBERS,
        "intensities": _NUMBERS,
    },
    "foxglove.PoseInFrame": {**_FRAME, "pose": _POSE},
    "foxglove.CompressedImage": {**_FRAME, "data": _BYTES, "format": _TEXT},
    "foxglove.RawAudio": {
        "timestamp": _TIME,
        "data": _BYTES,
        "format": _TEXT,
        "sample_rate": _INTEGER,
        "number_of_channels": _INTEGER,
    },
    "foxglove.Log": {
        "timestamp": _TIME,
        "level": _INTEGER,
        "message": _TEXT,
        "name": _TEXT,
        "file": _TEXT,
        "line": _INTEGER,
    },
    "contextpolicy.State": {
        "timestamp": _TIME,
        "contexts": _TEXT,
        "tasks": {"type": "object", "additionalProperties": {"type": "object"}},
    },
    "cgroup": dict.fromkeys(("limit", "usage", "periods", "throttled", "throttledTime"), _NUMBER),
}
