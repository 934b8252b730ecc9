"""What conditions read, and which constants they compare it with."""

from __future__ import annotations

import operator
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias

from contextpolicy.policy.cel import shared
from contextpolicy.policy.cel_cost import asked_stream
from contextpolicy.policy.cel_functions import AGE, HAS, HEARD, MACROS
from contextpolicy.policy.cel_syntax import Construct, Node, number, plain_text
from contextpolicy.policy.context_reads import read_context

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.policy.cel import Expression

Constant: TypeAlias = int | float | str
Comparison: TypeAlias = tuple[str, Constant]
"""The sign and what is on its right."""
Value: TypeAlias = Constant | bool | None
Unknown: TypeAlias = tuple[str, object]
"""An operand, a truth value or a context, with what says which one."""

COMPARISONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
"""What each sign says of two numbers, or of two texts."""
_ALWAYS_KNOWN = {AGE.name, HEARD.name}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}


def context(name: str) -> Unknown:
    """Whether a context is active."""
    return "context", name


@lru_cache(maxsize=1024)
def compiled(source: str) -> Expression:
    """The expression of a source, kept as many checks look at it."""
    return shared(source)


@lru_cache(maxsize=4096)
def unknowns_of(*sources: str) -> Mapping[Unknown, set[Comparison]]:
    """Each unknown of conditions with all that it is compared with."""
    return _gathered(chain.from_iterable(map(_read, sources)))


def unknowns_in(node: Node) -> Mapping[Unknown, set[Comparison]]:
    """The same of one tree."""
    return _gathered(_unknowns(node))


@lru_cache(maxsize=1024)
def _read(source: str) -> Sequence[tuple[Unknown, Comparison | None]]:
    return list(_unknowns(compiled(source).tree))


def _gathered(read: Iterable[tuple[Unknown, Comparison | None]]) -> Mapping[Unknown, set[Comparison]]:
    found: dict[Unknown, set[Comparison]] = {}
    for unknown, compared in read:
        found.setdefault(unknown, set()).update(() if compared is None else (compared,))
    return found


def _unknowns(node: Node) -> Iterator[tuple[Unknown, Comparison | None]]:
    """Each unknown with the sign and the constant that it is compared with, if it is."""
    compared = comparison_of(node)
    if compared is not None:
        yield compared[0], compared[1:]
    elif is_logic(node):
        for part in node.parts:
            yield from _unknowns(part)
    elif node.kind is not Construct.CONSTANT:
        yield unknown_of(node), None


def is_logic(node: Node) -> bool:
    """Whether it is `&&`, `||` or `!`: CEL decides these although an operand is unknown, if the others suffice."""
    return (node.kind is Construct.BINARY and node.text in {"&&", "||"}) or (
        node.kind is Construct.UNARY and node.text == "!"
    )


def comparison_of(node: Node) -> tuple[Unknown, str, Constant] | None:
    """`imu.x > 1` in its parts, in this order; None for anything but a comparison with a constant."""
    if node.kind is not Construct.BINARY or node.text not in COMPARISONS:
        return None
    left, right = node.parts
    first, second = constant(left), constant(right)
    if (first is None) is (second is None):
        return None
    if second is not None:
        return _measured(left), node.text, second
    return None if first is None else (_measured(right), _MIRRORED.get(node.text, node.text), first)


def constant(node: Node) -> Constant | None:
    """The number or text that a node always is; None for any other node."""
    if node.kind is Construct.UNARY and node.text == "-":
        value = constant(node.parts[0])
        return None if value is None or isinstance(value, str) else -value
    if node.kind is Construct.NUMBER:
        return number(node.text)
    return plain_text(node)


def _measured(node: Node) -> Unknown:
    if node.kind is Construct.CALL and node.text == AGE.name:
        return "age", asked_stream(node)
    return "value", node


def unknown_of(node: Node) -> Unknown:
    """What a part of a condition that is no comparison reads."""
    read = read_context(node)
    if read is not None:
        return context(read)
    if node.kind is Construct.CALL and node.text == HEARD.name:
        return "heard", asked_stream(node)
    return "truth", node


def asks_for_field(node: Node) -> bool:
    """Whether it asks for a field: without a value of the stream that is false, and never unknown."""
    return node.kind is Construct.CALL and node.text == HAS.name


def lacks(node: Node, lost: AbstractSet[tuple[str, ...]], chosen: Callable[[Node], Node] = lambda node: node) -> bool:
    """Whether a part of a condition has no value without those of some paths; `chosen` decides choices."""
    if is_logic(node) or asks_for_field(node) or (node.kind is Construct.CALL and node.text in _ALWAYS_KNOWN):
        return False
    if node.kind is Construct.CHOICE:
        condition, *options = (lacks(part, lost, chosen) for part in node.parts)
        own = chosen(node)
        return condition or (all(options) if own == node else lacks(own, lost, chosen))
    parts = node.parts[:1] if node.kind is Construct.METHOD and node.text in MACROS else node.parts
    return node.path() in lost or any(lacks(part, lost, chosen) for part in parts)
