"""Every expression of a policy against what is known of its streams: ROS 2 types, examples and features."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from contextpolicy.errors import DefinitionError, Finding
from contextpolicy.policy.ros_types import is_known, store_of
from contextpolicy.policy.spec import Encoding
from contextpolicy.policy.validation.cel_types import mistakes
from contextpolicy.policy.validation.shapes import ANY, BOOL, MAP, NUMBER, Shape, known_fields, of_example, of_message

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy, Stream


def expression_findings(policy: Policy) -> Iterator[Finding]:
    """Conditions that are not boolean, scores that are not numbers, unknown fields, operands that do not fit."""
    samples = {stream.name: _shape(stream) for stream in policy.streams}
    shapes = {stream.name: _with_features(samples[stream.name], stream) for stream in policy.streams}
    for field, source, wanted in _shared(policy):
        yield from (Finding(field, source, told) for told in mistakes(source, wanted, shapes))
    for index, stream in enumerate(policy.streams):
        own = {stream.name: samples[stream.name]}
        for field, source, wanted in _own(stream):
            path = f"spec.streams[{index}].{field}"
            yield from (Finding(path, source, told) for told in mistakes(source, wanted, own))
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


def _shared(policy: Policy) -> Iterator[tuple[str, str, Shape]]:
    """Fields, sources and required shapes of the expressions that may read every stream."""
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            yield f"spec.tasks[{index}].activity[{number}].when", activity.when, BOOL
            if activity.score_from is not None:
                yield f"spec.tasks[{index}].activity[{number}].scoreFrom", activity.score_from, NUMBER
        for number, requirement in enumerate(task.requires):
            if requirement.when is not None:
                yield f"spec.tasks[{index}].requires[{number}].when", requirement.when, BOOL
    for index, context in enumerate(policy.contexts):
        if context.when is not None:
            yield f"spec.contexts[{index}].when", context.when, BOOL


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
        return ANY
    sample = stream.example if isinstance(stream.example, dict) else {"value": stream.example}
    return of_example(sample, "its example")


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
    return replace(sample, fields={**sample.fields, **{feature.name: NUMBER for feature in stream.features}})
