"""Every expression of a policy against what is known of its streams: ROS 2 types, examples and features."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.errors import DefinitionError, Fault, Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.context_reads import CONTEXTS
from contextpolicy.policy.ros_types import is_known, store_of
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.policy.validation.cel_types import mistakes
from contextpolicy.policy.validation.shapes import (
    ANY,
    BOOL,
    MAP,
    NUMBER,
    PLAIN,
    TEXT,
    Shape,
    known_fields,
    list_of,
    of_example,
    of_message,
)
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream


def expression_findings(policy: Policy) -> Iterator[Finding]:
    """Conditions that are not boolean, scores that are not numbers, unknown fields, operands that do not fit."""
    samples = {stream.name: _from_source(_shape(stream), stream) for stream in policy.streams}
    shapes = {stream.name: _with_features(samples[stream.name], stream) for stream in policy.streams}
    shapes[CONTEXTS] = _contexts(policy)
    for field, source, is_number in expressions(policy):
        wanted = NUMBER if is_number else BOOL
        yield from (Finding(field, source, wrong, Fault.RULE) for wrong in mistakes(source, wanted, shapes))
    for index, stream in enumerate(policy.streams):
        own = {stream.name: samples[stream.name]}
        for field, source, wanted in _own(stream):
            path = f"spec.streams[{index}].{field}"
            yield from (Finding(path, source, wrong, Fault.RULE) for wrong in mistakes(source, wanted, own))
        if stream.timestamp:
            yield from _timestamp(f"spec.streams[{index}].timestamp", stream.timestamp, samples[stream.name])


def _timestamp(field: str, path: str, shape: Shape) -> Iterator[Finding]:
    for name in path.split("."):
        if shape.fields is None:
            return
        if name not in shape.fields:
            yield Finding(field, path, f"the path of a field: {known_fields(shape, name)}")
            return
        shape = shape.fields[name]


def _contexts(policy: Policy) -> Shape:
    """All that are declared or read: `references` reports the others."""
    read = (name for written in expressions(policy) for name in Expression(written.source).contexts)
    return Shape(MAP.kind, dict.fromkeys([*(context.name for context in policy.contexts), *read], BOOL))


def _own(stream: Stream) -> Iterator[tuple[str, str, Shape]]:
    """A stream's own expressions, which see its sample before features are computed."""
    if stream.filter is not None:
        yield "filter", stream.filter, BOOL
    for number, feature in enumerate(stream.features):
        if feature.of is not None:
            yield f"features[{number}].of", feature.of, NUMBER


def _shape(stream: Stream) -> Shape:
    if stream.encoding is Encoding.CDR:
        return _message_shape(stream, stream.type or "")
    if stream.example is None:
        return MAP  # a plain value, too, is read as a map of one field
    if isinstance(stream.example, dict):
        return of_example(stream.example, "its example")
    return of_example({"value": stream.example}, PLAIN)


def _message_shape(stream: Stream, type_name: str) -> Shape:
    """ANY for a message whose definition is missing or wrong, which is a finding of its own."""
    try:
        store = store_of(stream)
    except DefinitionError:
        return ANY
    return of_message(store, type_name) if is_known(type_name, store) else ANY


def _with_features(sample: Shape, stream: Stream) -> Shape:
    if sample.fields is None or sample.kind != MAP.kind:
        return sample
    sources = {"sources": list_of(sample)} if stream.sources else {}
    return replace(sample, fields={**sample.fields, **{feature.name: NUMBER for feature in stream.features}, **sources})


def _from_source(sample: Shape, stream: Stream) -> Shape:
    if not stream.sources or sample.fields is None or sample.kind != MAP.kind:
        return sample
    return replace(sample, fields={**sample.fields, "source": TEXT})
