"""Timelines: timed inputs with ground truth, one JSON file per experiment (paper VI-A).

The simulation reads in virtual time the very inputs that the player publishes in real time. Values are JSON; with the
encoding cdr they are ROS 2 messages of the entry's type.
"""

from __future__ import annotations

import gc
import heapq
import json
import math
import re
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.errors import DefinitionError, Finding, TimelineError
from contextpolicy.policy.spec import RosRelease

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping

    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.streams.ros_message import RosMessage

    Check: TypeAlias = tuple[Callable[[Any], bool], str]

MAX_RATE = 1000.0
RECORDED = "recorded"
"""The encoding of inputs whose payload is what came over the bus: each stream decodes it by its own encoding."""


@dataclass(frozen=True, slots=True)
class TimedInput:
    """One input, `at` seconds from the start; a data set is announced once, at its start."""

    at: float
    key: str
    encoding: str
    value: object | None
    dataset: str | None
    message: RosMessage | None = None
    payload: bytes | None = None


@dataclass(frozen=True, slots=True)
class TimelineEntry:
    """One line of the file: a value at an instant, a value at a rate, or a data set."""

    start: float
    end: float
    key: str
    encoding: str
    rate: float | None
    value: object | None
    dataset: str | None
    truth: object | None
    message: RosMessage | None = None
    dataset_rate: float | None = None
    """Samples of the data set a second: what can be known of it without having it."""
    offset: float = 0.0
    """Seconds of the data set that are left out at its begin."""
    payload: bytes | None = None
    """A recorded message, as it came over the bus."""

    def inputs(self) -> Iterator[TimedInput]:
        """All inputs of this entry; each time is computed from the start, so that a long entry does not drift."""
        # The tolerance absorbs rounding: (1.3 - 1.0) * 10 is a little more than 3, and means 3.
        count = math.ceil((self.end - self.start) * self.rate - 1e-9) if self.rate else 1
        for index in range(count):
            at = self.start + index / self.rate if self.rate else self.start
            yield TimedInput(at, self.key, self.encoding, self.value, self.dataset, self.message, self.payload)


@dataclass(frozen=True, slots=True)
class StoryPhase:
    """A stretch of the story, with what is true in it: reports and pictures show it, nothing is decided by it."""

    name: str
    start: float
    end: float
    truth: object | None = None


@dataclass(frozen=True, slots=True)
class Timeline:
    """A whole file; `inputs` may be called any number of times."""

    name: str
    duration: float
    entries: tuple[TimelineEntry, ...]
    phases: tuple[StoryPhase, ...] = ()
    begin: float | None = None
    """When a recording began, in Unix seconds or of simulated time; a timeline can begin at any time."""

    def inputs(self) -> Iterator[TimedInput]:
        """All inputs in time order; those of one instant in the order of the file."""
        return heapq.merge(*map(_in_turn, _runs(self.entries)), key=attrgetter("at"))


def _runs(entries: Iterable[TimelineEntry]) -> Iterator[list[TimelineEntry]]:
    """Groups of consecutive single inputs in time order, which need no merging: a recording is one run."""
    run: list[TimelineEntry] = []
    for entry in entries:
        if run and (entry.rate or run[-1].rate or entry.start < run[-1].start):
            yield run
            run = []
        run.append(entry)
    if run:
        yield run


def _in_turn(run: Iterable[TimelineEntry]) -> Iterator[TimedInput]:
    return chain.from_iterable(entry.inputs() for entry in run)


def load(path: Path | str, definitions: Definitions = ()) -> Timeline:
    """Read a timeline file, or raise TimelineError with everything that is wrong with it.

    `definitions` are those of ROS 2 messages that are not standard.
    """
    with _uncollected():
        return _load(path, definitions)


@contextmanager
def _uncollected() -> Iterator[None]:
    """Load without the garbage collector.

    A recording becomes millions of objects and no cycles; walking them over and over takes a third of the time.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


def _load(path: Path | str, definitions: Definitions) -> Timeline:
    try:
        document = json.loads(Path(path).read_text(encoding="utf-8"), parse_constant=_refuse_constant)
    except OSError as error:
        finding = Finding("file", str(path), f"a readable file ({error.strerror})")
    except RecursionError:
        finding = Finding("file", str(path), "JSON that nests less deeply")
    except ValueError as error:  # also broken UTF-8 and NaN
        finding = Finding("file", str(path), f"JSON ({error})")
    else:
        return parse(document, definitions, subject=str(path))
    raise TimelineError(str(path), (finding,))


def parse(document: object, definitions: Definitions = (), *, subject: str = "timeline") -> Timeline:
    """Turn decoded JSON into a timeline, or raise TimelineError with everything that is wrong."""
    findings = list(_findings(document))
    if findings or not isinstance(document, dict):
        raise TimelineError(subject, tuple(findings))
    entries = tuple(_entry(raw, definitions, f"inputs[{i}]", findings) for i, raw in enumerate(document["inputs"]))
    if findings:
        raise TimelineError(subject, tuple(findings))
    phases = tuple(
        StoryPhase(raw["name"], raw["from"], raw["to"], raw.get("truth")) for raw in document.get("phases", ())
    )
    return Timeline(document["name"], float(document["duration"]), entries, phases)


def _entry(raw: Mapping[str, Any], definitions: Definitions, path: str, findings: list[Finding]) -> TimelineEntry:
    start = float(raw["at"] if "at" in raw else raw["from"])
    return TimelineEntry(
        start=start,
        end=float(raw.get("to", start)),
        key=raw["key"],
        encoding=raw["encoding"],
        rate=None if "dataset" in raw else raw.get("rate"),
        value=raw.get("value"),
        dataset=raw.get("dataset"),
        truth=raw.get("truth"),
        message=_message(raw, definitions, path, findings) if raw["encoding"] == "cdr" else None,
        dataset_rate=raw.get("rate") if "dataset" in raw else None,
        offset=float(raw.get("offset", 0)),
    )


def _message(raw: Mapping[str, Any], definitions: Definitions, path: str, findings: list[Finding]) -> RosMessage | None:
    from contextpolicy.policy.ros_types import is_known, type_store  # noqa: PLC0415 - megabytes, for ROS 2 only
    from contextpolicy.streams.ros_message import RosMessage  # noqa: PLC0415

    release = RosRelease(raw.get("ros", RosRelease.LATEST))
    try:
        store = type_store(release, definitions)
    except DefinitionError as error:
        findings.append(Finding(f"{path}.type", raw["type"], f"message definitions without mistakes; {error}"))
        return None
    if not is_known(raw["type"], store):
        findings.append(Finding(f"{path}.type", raw["type"], f"a message of ROS 2 {release}, or of --types DIR"))
        return None
    message = RosMessage(raw["type"], store, raw["value"])
    findings += [replace(finding, field=f"{path}.{finding.field}") for finding in message.findings]
    return message


def _refuse_constant(name: str) -> object:
    raise ValueError(f"{name} is not a JSON number")


def _is_text(value: object) -> bool:
    return isinstance(value, str) and value != ""


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _matches(pattern: str) -> Callable[[object], bool]:
    return lambda value: isinstance(value, str) and re.fullmatch(pattern, value) is not None


@cache
def _is_key(text: str) -> bool:
    """Cached: a recording repeats a few keys a million times."""
    return len(text) <= 256 and re.fullmatch(r"[^/*$?#]+(/[^/*$?#]+)*", text) is not None


_SECONDS: Check = (lambda value: _is_number(value) and value >= 0, "a number of seconds, 0 or more")
_DURATION: Check = (lambda value: _is_number(value) and value > 0, "a number of seconds above 0")
_ANY: Check = (lambda _: True, "any JSON value")
_KEY: Check = (
    lambda value: isinstance(value, str) and _is_key(value),
    "a Zenoh key of at most 256 characters without wildcards, such as robot/imu",
)
_DATASET: Check = (_matches(r"[A-Za-z0-9_-]+/[A-Za-z0-9_-]+"), "a data set, such as euroc/stereo")
_RATE: Check = (lambda value: _is_number(value) and 0 < value <= MAX_RATE, f"Hz, above 0 to {MAX_RATE:g}")
_VALUE_ENCODING: Check = (lambda value: value in ("json", "cdr"), "json or cdr")
_DATASET_ENCODING: Check = (lambda value: value in ("json", "binary"), "json or binary")

_LINE: Check = (_matches(r"[^\x00-\x1f\x7f-\x9f\ud800-\udfff]+"), "one line of text, without control characters")

_TIMELINE: Mapping[str, Check] = {
    "name": _LINE,
    "duration": _DURATION,
    "inputs": (lambda value: isinstance(value, list) and len(value) > 0, "a list of at least one input"),
}
_TIMELINE_OPTIONS: Mapping[str, Check] = {
    "$schema": (_is_text, "a text"),
    "description": (_is_text, "a text"),
    "phases": (lambda value: isinstance(value, list), "a list of phases"),
}
_PHASE: Mapping[str, Check] = {"name": _LINE, "from": _SECONDS, "to": _SECONDS}
_INPUT_OPTIONS: Mapping[str, Check] = {"truth": _ANY}
_ROS_MESSAGE: Mapping[str, Check] = {
    "type": (_matches(r"[A-Za-z]\w*/msg/[A-Z][A-Za-z0-9]*"), "a ROS 2 type such as sensor_msgs/msg/Imu")
}
_ROS_OPTIONS: Mapping[str, Check] = {"ros": (lambda value: value in list(RosRelease), ", ".join(RosRelease))}
_VALUE_ONCE: Mapping[str, Check] = {"key": _KEY, "encoding": _VALUE_ENCODING, "at": _SECONDS, "value": _ANY}
_VALUE_AT_RATE: Mapping[str, Check] = {
    "key": _KEY,
    "encoding": _VALUE_ENCODING,
    "from": _SECONDS,
    "to": _SECONDS,
    "rate": _RATE,
    "value": _ANY,
}
_RECORDED_OPTIONS: Mapping[str, Check] = {"rate": _RATE, "offset": _SECONDS, **_INPUT_OPTIONS}
_RECORDED: Mapping[str, Check] = {
    "key": _KEY,
    "encoding": _DATASET_ENCODING,
    "from": _SECONDS,
    "to": _SECONDS,
    "dataset": _DATASET,
}


def _findings(document: object) -> Iterator[Finding]:
    if not isinstance(document, dict):
        yield Finding("timeline", document, "a JSON object")
        return
    yield from _field_findings("", document, _TIMELINE, _TIMELINE_OPTIONS)
    for listed, shape in (("phases", lambda _: (_PHASE, _INPUT_OPTIONS)), ("inputs", _shape)):
        items = document.get(listed)
        for index, raw in enumerate(items if isinstance(items, list) else ()):
            path = f"{listed}[{index}]"
            if isinstance(raw, dict):
                yield from _field_findings(f"{path}.", raw, *shape(raw))
                yield from _order_findings(path, raw, document.get("duration"))
            else:
                yield Finding(path, raw, "a JSON object")


def _shape(raw: Mapping[str, Any]) -> tuple[Mapping[str, Check], Mapping[str, Check]]:
    """An input's required and optional fields."""
    if "dataset" in raw:
        return _RECORDED, _RECORDED_OPTIONS
    shape = _VALUE_ONCE if "at" in raw else _VALUE_AT_RATE
    if raw.get("encoding") == "cdr":
        return {**shape, **_ROS_MESSAGE}, {**_INPUT_OPTIONS, **_ROS_OPTIONS}
    return shape, _INPUT_OPTIONS


def _field_findings(
    path: str, raw: Mapping[str, Any], required: Mapping[str, Check], options: Mapping[str, Check]
) -> Iterator[Finding]:
    for name, (_, allowed) in required.items():
        if name not in raw:
            yield Finding(f"{path}{name}", None, f"required: {allowed}")
    for name, value in raw.items():
        check = required.get(name) or options.get(name)
        if check is None:
            yield Finding(f"{path}{name}", value, f"one of the fields {', '.join((*required, *options))}")
        elif not check[0](value):
            yield Finding(f"{path}{name}", value, check[1])


def _order_findings(path: str, raw: Mapping[str, Any], duration: object) -> Iterator[Finding]:
    for name in ("at", "from", "to"):
        if _is_number(raw.get(name)) and _is_above(raw[name], duration):
            yield Finding(f"{path}.{name}", raw[name], f"at most the duration, {duration:g}")
    if _is_number(raw.get("from")) and _is_number(raw.get("to")) and raw["to"] <= raw["from"]:
        yield Finding(f"{path}.to", raw["to"], f"after from, {raw['from']:g}")


def _is_above(time: float, duration: object) -> bool:
    return isinstance(duration, int | float) and _is_number(duration) and time > duration
