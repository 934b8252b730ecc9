"""A recording as files that other commands read: a timeline for `simulate`, and the plans as they were. Pure."""

from __future__ import annotations

import json
import math
from collections import Counter
from typing import TYPE_CHECKING, Any

from contextpolicy.errors import DecodeError
from contextpolicy.recorder.flight_recorder import SampleRecord
from contextpolicy.streams.decoding import Decoder

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from contextpolicy.policy.spec import Policy
    from contextpolicy.recorder.flight_recorder import Records

TWICE = 0.1
"""Seconds within which the same payload on the same key, heard by two streams, is one sample."""
ANY = "any"
"""Stands for a wildcard in a key that is not known."""


def recording(policy: Policy, records: Records, now: float, last: float) -> dict[str, Any]:
    """`timeline` (as `simulate` reads it) and `plans` of the last `last` seconds before `now` (monotonic seconds).

    The timeline begins with the newest older sample of each stream, so that a replay knows what was known. Times of
    `plans` count from the timeline's start too.
    """
    start = max(now - last, _first(records, now))
    lost: Counter[str] = Counter()
    inputs = list(_inputs(policy, _wanted(records, start), start, lost))
    return {
        "timeline": {
            "name": f"{policy.namespace}-{policy.name} recorded",
            "description": _description(policy, lost),
            "duration": max(round(now - start, 6), 0.001),
            "inputs": inputs,
        },
        "plans": [
            {"at": round(plan.published - start, 6), **json.loads(plan.payload)}
            for plan in records.plans
            if plan.published >= start
        ],
    }


def bare(body: Mapping[str, Any]) -> dict[str, Any]:
    """The policy as its author wrote it, for a file: without what the API server and GitOps tools keep in it."""
    metadata = {field: body["metadata"][field] for field in ("name", "namespace")}
    return {field: body[field] for field in ("apiVersion", "kind")} | {"metadata": metadata, "spec": body["spec"]}


def _first(records: Records, now: float) -> float:
    """The oldest moment since when everything is still there."""
    moments = [queue[0][0] for queue in (records.samples, records.plans) if queue]
    return min(moments, default=now)


def _wanted(records: Records, start: float) -> Iterator[SampleRecord]:
    """The samples from `start` on, and each stream's last one before it as if it came just then."""
    latest = {stream: SampleRecord._make(raw) for stream, raw in records.before.items()}
    later = []
    for raw in records.samples:
        sample = SampleRecord._make(raw)
        if sample.arrived < start:
            latest[sample.stream] = sample
        else:
            later.append(sample)
    yield from (sample._replace(arrived=start) for sample in latest.values())
    yield from later


def _inputs(
    policy: Policy, samples: Iterable[SampleRecord], start: float, lost: Counter[str]
) -> Iterator[dict[str, Any]]:
    streams = {stream.name: stream for stream in policy.streams}
    decoders: dict[str, Decoder] = {}
    heard: dict[tuple[str, bytes], tuple[str, float]] = {}
    for sample in samples:
        stream = streams.get(sample.stream)
        if stream is None:
            lost["of a stream that the policy no longer has"] += 1
            continue
        key = sample.key or key_without_wildcards(stream.key)
        other, at = heard.get((key, sample.payload), ("", -math.inf))
        if other not in ("", sample.stream) and sample.arrived - at < TWICE:
            continue
        heard[key, sample.payload] = sample.stream, sample.arrived
        decoder = decoders.setdefault(sample.stream, Decoder(stream))
        try:
            value = decoder.decode(sample.payload, sample.attachment).value
        except DecodeError:
            lost["undecodable"] += 1
            continue
        yield {"at": round(sample.arrived - start, 6), "key": key, "encoding": "json", "value": _json(value, lost)}


def key_without_wildcards(key: str) -> str:
    """A key that the expression selects: `robot/*/imu` becomes `robot/any/imu`."""
    return "/".join(ANY if "*" in chunk else chunk for chunk in key.split("/"))


def _json(value: Any, lost: Counter[str]) -> Any:
    """JSON has neither NaN and infinities, which become null, nor bytes, which become a list of numbers."""
    match value:
        case dict():
            return {str(name): _json(inner, lost) for name, inner in value.items()}
        case list() | tuple():
            return [_json(inner, lost) for inner in value]
        case bytes():
            return list(value)
        case float() if not math.isfinite(value):
            lost["numbers that JSON can't represent (NaN, infinity), now null"] += 1
            return None
    return value


def _description(policy: Policy, lost: Mapping[str, int]) -> str:
    description = f"Recorded on the robot by the policy {policy.reference}."
    if lost:
        description += (
            " Changed in the recording: " + ", ".join(f"{count} {what}" for what, count in sorted(lost.items())) + "."
        )
    return description
