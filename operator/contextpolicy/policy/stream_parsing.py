"""A stream of a ContextPolicy, with its features and sources, as read from `spec.streams`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.field_types import value_of
from contextpolicy.policy.fields import (
    FEATURE_NAME,
    FEATURE_NAME_ALLOWED,
    FIELD_PATH,
    OBJECT_NAME,
    ROS_TYPE,
    STREAM_NAME,
    STREAM_NAME_ALLOWED,
)
from contextpolicy.policy.stream_spec import Encoding, Feature, FeatureOp, Stream

if TYPE_CHECKING:
    from contextpolicy.policy.fields import Fields


def parse_stream(fields: Fields) -> Stream:
    """Read an entry of `spec.streams`; the fields hold what is wrong with it."""
    result = value_of(
        Stream,
        fields,
        name=fields.text("name", pattern=STREAM_NAME, allowed=STREAM_NAME_ALLOWED),
        key=fields.key_expression("key"),
        type=fields.optional_text("type", pattern=ROS_TYPE, allowed="a ROS 2 type such as sensor_msgs/msg/Imu"),
        types=fields.optional_text("types", pattern=OBJECT_NAME, allowed="the name of a ConfigMap"),
        definitions=None,
        liveliness=fields.key_expression("liveliness") if "liveliness" in fields else fields.raw("liveliness"),
        timestamp=fields.optional_text("timestamp", pattern=FIELD_PATH, allowed="a field path such as header.stamp"),
        sources=fields.whole("sources", most=16) or 0,
        example=fields.raw("example"),
        features=tuple(_feature(item) for item in fields.nested_list("features", limit=16)),
    )
    if "fallback" in fields and "staleAfter" not in fields and "liveliness" not in fields:
        fields.refuse("staleAfter", None, "staleAfter or liveliness, as a stream with neither never falls back")
    if (result.encoding is Encoding.CDR) != (result.type is not None):
        fields.refuse("type", fields.raw("type"), "a ROS 2 type with encoding cdr, and no type with other encodings")
    if result.sources:
        _check_sources(fields, result)
    for name in ("ros", "types"):
        if name in fields and result.encoding is not Encoding.CDR:
            fields.refuse(name, fields.raw(name), "encoding cdr, as other encodings have no message types")
    fields.close()
    return result


def _check_sources(fields: Fields, stream: Stream) -> None:
    if stream.key and "*" not in stream.key:
        fields.refuse("sources", stream.sources, "only with wildcards in key, which distinguish the sources")
    for name in ("debounce", "sampleEvery"):
        if name in fields:
            expected = "only without sources: it would drop samples of one source in favour of another"
            fields.refuse(name, fields.raw(name), expected)
    for number, feature in enumerate(stream.features):
        if feature.name in {"source", "sources"}:
            fields.refuse(f"features[{number}].name", feature.name, "another name, as sources gives samples this field")


def _feature(fields: Fields) -> Feature:
    result = value_of(
        Feature,
        fields,
        name=fields.text("name", pattern=FEATURE_NAME, allowed=FEATURE_NAME_ALLOWED),
        op=FeatureOp.COUNT if "op" not in fields else fields.choice("op", FeatureOp.COUNT),
        over=fields.duration("over") or 0.0,
    )
    if "op" not in fields:
        fields.refuse("op", fields.raw("op"), "one of " + ", ".join(FeatureOp))
    if result.over <= 0:
        fields.refuse("over", fields.raw("over"), "a duration above 0")
    if result.of is None and result.op not in (FeatureOp.RATE, FeatureOp.COUNT):
        fields.refuse("of", None, "a CEL number, which mean, min and max need")
    fields.close()
    return result
