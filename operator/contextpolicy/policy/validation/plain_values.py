"""Warnings about streams that may send plain values, and are read as maps of fields."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.cel import Expression
from contextpolicy.policy.cel_functions import MACROS
from contextpolicy.policy.cel_syntax import Construct
from contextpolicy.policy.stream_spec import Encoding
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.cel_syntax import Node
    from contextpolicy.policy.spec import Policy

_WALKING = frozenset({*MACROS, "size", "norm"})


def plain_values(policy: Policy) -> Iterator[Finding]:
    """Each expression that walks over a whole sample of which nothing is known; with an example it is an error."""
    known = {stream.name for stream in policy.streams if stream.example is not None or stream.encoding is Encoding.CDR}
    for field, source in [*((one.field, one.source) for one in expressions(policy)), *_of_streams(policy)]:
        own = Expression(source)
        for name in dict.fromkeys(_walked(own.tree)):
            if name in own.variables - known:
                message = (
                    f"reads the fields of {name}; a sample that is a list, such as [1, 2], is read as {name}.value "
                    f"(an example of {name} would show which it is)"
                )
                yield Finding(field, source, message)


def _of_streams(policy: Policy) -> Iterator[tuple[str, str]]:
    """The expressions that read a stream's own samples."""
    for index, stream in enumerate(policy.streams):
        if stream.filter is not None:
            yield f"spec.streams[{index}].filter", stream.filter
        for number, feature in enumerate(stream.features):
            if feature.of is not None:
                yield f"spec.streams[{index}].features[{number}].of", feature.of


def _walked(node: Node) -> Iterator[str]:
    """The names whose fields are walked over."""
    calls = node.kind in {Construct.CALL, Construct.METHOD} and node.text in _WALKING
    asks = node.kind is Construct.BINARY and node.text == "in"
    over = node.parts[:1] if calls else node.parts[1:] if asks else ()
    yield from (one.text for one in over if one.kind is Construct.NAME)
    for part in node.parts:
        yield from _walked(part)
