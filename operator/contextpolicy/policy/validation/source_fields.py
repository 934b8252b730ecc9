"""Warnings about `sources` and `source`: of streams without them, beyond their number, and names that none has."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_functions import MACROS, Macro
from contextpolicy.policy.cel_syntax import Construct
from contextpolicy.policy.key_chunks import may_match
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.policy.validation.unknowns import compiled, constant
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.policy.cel_syntax import Node
    from contextpolicy.policy.spec import Policy
    from contextpolicy.policy.stream_spec import Stream

GIVEN = frozenset({"source", "sources"})
"""The fields that a stream with `sources` has, whatever its samples are."""


def source_fields(policy: Policy) -> Iterator[Finding]:
    """Each expression that reads them of a stream with a wildcard, without `sources` and with unknown samples.

    And each stream with `sources` whose own samples have such a field, and what asks it for sources that it can't have.
    """
    for index, one in enumerate(policy.streams):
        for name in sorted(GIVEN.intersection(one.example if isinstance(one.example, dict) else ())):
            if one.sources:
                message = f"its samples' own field {name} can't be read: sources gives them another one of this name"
                yield Finding(f"spec.streams[{index}].sources", one.sources, message)
    apart = {stream.name for stream in policy.streams if stream.sources or "*" not in stream.key}
    known = {stream.name for stream in policy.streams if stream.example is not None or stream.encoding is Encoding.CDR}
    for written in expressions(policy):
        for stream, *fields in sorted(Expression(written.source).reads):
            if fields and fields[0] in GIVEN and stream not in apart | known:
                message = (
                    f"{stream}.{fields[0]} is a field of its samples, since stream {stream} has no sources, "
                    "which would keep them apart"
                )
                yield Finding(written.field, written.source, message)
    kept = {stream.name: stream for stream in policy.streams if stream.sources}
    for written in expressions(policy):
        for wrong in dict.fromkeys(_impossible(compiled(written.source).tree, kept)):
            yield Finding(written.field, written.source, wrong)


def _impossible(node: Node, streams: Mapping[str, Stream]) -> Iterator[str]:
    """Indices beyond the sources of streams, and names that none has; a loop's variable is one of its stream's."""
    if node.kind is Construct.METHOD and node.text in MACROS and len(node.parts) > 2:
        yield from _in_loop(node, streams)
        return
    if node.kind is Construct.INDEX:
        stream, index = _listed(node.parts[0], streams), constant(node.parts[1])
        if stream and isinstance(index, int) and not 0 <= index < stream.sources:
            yield f"{stream.name}.sources has no [{index}]: the first is [0], the last at most [{stream.sources - 1}]"
    elif node.kind is Construct.BINARY and node.text in {"==", "!="}:
        for one, other in (node.parts, node.parts[::-1]):
            stream, name = _named(one, streams), constant(other)
            if stream and isinstance(name, str) and not may_match(stream.key, name):
                yield f"no source of {stream.name} is {name!r}: a source is what the wildcards of {stream.key} match"
    for part in node.parts:
        yield from _impossible(part, streams)


def _in_loop(node: Node, streams: Mapping[str, Stream]) -> Iterator[str]:
    """The variable hides a stream of its name."""
    over, variable, *bodies = node.parts
    yield from _impossible(over, streams)
    inner = {name: stream for name, stream in streams.items() if name != variable.text}
    walked = _listed(over, streams)
    if walked:
        inner[variable.text] = walked
    for body in bodies:
        yield from _impossible(body, inner)


def _listed(node: Node, streams: Mapping[str, Stream]) -> Stream | None:
    """The stream whose sources, or some of them, a list has."""
    if node.kind is Construct.METHOD and node.text == Macro.FILTER:
        return _listed(node.parts[0], streams)
    name, *fields = node.path() or ("",)
    return streams.get(name) if fields == ["sources"] else None


def _named(node: Node, streams: Mapping[str, Stream]) -> Stream | None:
    """The stream of which a value names a source."""
    if node.kind is not Construct.SELECT or node.text != "source":
        return None
    owner = node.parts[0]
    if owner.kind is Construct.INDEX:
        return _listed(owner.parts[0], streams)
    return streams.get(owner.text) if owner.kind is Construct.NAME else None
