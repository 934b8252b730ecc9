"""What a timeline file may say: its fields, which of them go together, and what each allows. Pure."""

from __future__ import annotations

import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.errors import Fault, Finding
from contextpolicy.policy.stream_spec import RosRelease

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    Check: TypeAlias = tuple[Callable[[Any], bool], str]

MAX_RATE = 1000.0
"""Hz."""


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
_RATE: Check = (
    lambda value: _is_number(value) and 0 < value <= MAX_RATE,
    f"a rate in Hz above 0 and at most {MAX_RATE:g}",
)
_VALUE_ENCODING: Check = (lambda value: value in ("json", "cdr"), "json or cdr")
_DATASET_ENCODING: Check = (lambda value: value in ("json", "binary"), "json or binary")

_LINE: Check = (_matches(r"[^\x00-\x1f\x7f-\x9f\ud800-\udfff]+"), "one line of text, without control characters")

_TIMELINE: Mapping[str, Check] = {
    "name": _LINE,
    "duration": _DURATION,
    "inputs": (lambda value: isinstance(value, list) and len(value) > 0, "a list of at least one input"),
}
_TIMELINE_OPTIONS: Mapping[str, Check] = {
    "$schema": (_is_text, "a string"),
    "description": (_is_text, "a string"),
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


def findings_in(document: object) -> Iterator[Finding]:
    """Everything that is wrong with decoded JSON as a timeline; whether ROS 2 messages fit their types is not asked."""
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
            yield Finding(f"{path}{name}", None, allowed)
    for name, value in raw.items():
        check = required.get(name) or options.get(name)
        if check is None:
            known = f"one of the fields {', '.join((*required, *options))}"
            yield Finding(f"{path}{name}", value, known, Fault.FIELD)
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
