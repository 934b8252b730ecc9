"""Timelines: timed inputs with ground truth, one JSON file per experiment (paper VI-A).

The simulation reads in virtual time the very inputs that the player publishes in real time. Values are JSON; with the
encoding cdr they are ROS 2 messages of the entry's type.
"""

from __future__ import annotations

import gc
import heapq
import json
import math
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import DefinitionError, Fault, Finding, TimelineError, unreadable
from contextpolicy.policy.stream_spec import RosRelease
from contextpolicy.streams.timeline_shape import findings_in

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.policy.definition_files import Definitions
    from contextpolicy.streams.ros_message import RosMessage

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
    type: str = ""


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
    type: str = ""
    """The ROS type that the recording has of it; empty if unknown."""

    def at_rate(self, rate: float) -> TimelineEntry:
        """See `Timeline.at_rate`; `offset` counts in the data set's own time, which stays."""
        return replace(
            self,
            start=self.start / rate,
            end=self.end / rate,
            rate=self.rate and self.rate * rate,
            dataset_rate=self.dataset_rate and self.dataset_rate * rate,
        )

    def inputs(self) -> Iterator[TimedInput]:
        """All inputs of this entry; each time is computed from the start, so that a long entry does not drift."""
        # The tolerance absorbs rounding: (1.3 - 1.0) * 10 is a little more than 3, and means 3.
        count = math.ceil((self.end - self.start) * self.rate - 1e-9) if self.rate else 1
        for index in range(count):
            at = self.start + index / self.rate if self.rate else self.start
            yield TimedInput(
                at, self.key, self.encoding, self.value, self.dataset, self.message, self.payload, self.type
            )


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
    notes: tuple[str, ...] = ()
    """What of a recording could not be read, a sentence each."""

    def inputs(self) -> Iterator[TimedInput]:
        """All inputs in time order; those of one instant in the order of the file."""
        return heapq.merge(*map(_in_turn, _runs(self.entries)), key=attrgetter("at"))

    def at_rate(self, rate: float) -> Timeline:
        """The same inputs, `rate` times as fast: what a machine of 1/`rate` of the speed has to do. Values stay."""
        return replace(
            self,
            duration=self.duration / rate,
            entries=tuple(entry.at_rate(rate) for entry in self.entries),
            phases=tuple(replace(one, start=one.start / rate, end=one.end / rate) for one in self.phases),
        )


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
        text = Path(path).read_text(encoding="utf-8")
        document = json.loads(text, parse_constant=_refuse_constant, parse_float=_finite)
    except OSError as error:
        problem = unreadable(error)
    except RecursionError:
        problem = "not valid JSON: nested too deeply"
    except ValueError as error:  # also broken UTF-8 and NaN
        problem = f"not valid JSON: {error}"
    else:
        return parse(document, definitions, subject=str(path))
    raise TimelineError(str(path), (Finding("", None, problem, Fault.FILE),))


def parse(document: object, definitions: Definitions = (), *, subject: str = "timeline") -> Timeline:
    """Turn decoded JSON into a timeline, or raise TimelineError with everything that is wrong."""
    findings = list(findings_in(document))
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
        findings.append(Finding(f"{path}.type", raw["type"], f"valid message definitions; {error}"))
        return None
    if not is_known(raw["type"], store):
        findings.append(Finding(f"{path}.type", raw["type"], f"a message of ROS 2 {release}, or of --types DIR"))
        return None
    message = RosMessage(raw["type"], store, raw["value"])
    findings += [replace(finding, field=f"{path}.{finding.field}") for finding in message.findings]
    return message


def _refuse_constant(name: str) -> object:
    raise ValueError(f"{name} is not a JSON number")


def _finite(number: str) -> float:
    if math.isinf(float(number)):
        raise ValueError(f"{number} is larger than any double")
    return float(number)
