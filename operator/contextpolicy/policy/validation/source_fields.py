"""Warnings about `sources` and `source` of streams that don't keep their sources apart, or that send such fields."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy

GIVEN = frozenset({"source", "sources"})
"""The fields that a stream with `sources` has, whatever its samples are."""


def source_fields(policy: Policy) -> Iterator[Finding]:
    """Each expression that reads them of a stream with a wildcard, without `sources` and with unknown samples.

    And each stream with `sources` whose own samples have such a field.
    """
    for index, one in enumerate(policy.streams):
        for name in sorted(GIVEN.intersection(one.example if isinstance(one.example, dict) else ())):
            if one.sources:
                told = f"its samples' own field {name} can't be read: sources gives them another one of this name"
                yield Finding(f"spec.streams[{index}].sources", one.sources, told)
    apart = {stream.name for stream in policy.streams if stream.sources or "*" not in stream.key}
    known = {stream.name for stream in policy.streams if stream.example is not None or stream.encoding is Encoding.CDR}
    for written in expressions(policy):
        for stream, *fields in sorted(Expression(written.source).reads):
            if fields and fields[0] in GIVEN and stream not in apart | known:
                told = (
                    f"{stream}.{fields[0]} is a field of its samples, since stream {stream} has no sources, "
                    "which would keep them apart"
                )
                yield Finding(written.field, written.source, told)
