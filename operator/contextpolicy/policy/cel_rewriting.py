"""Writes a tree as text for the CEL library, so that policies mean what they appear to mean.

- Numbers get their one form (see `cel_numbers`); indices, keys and `%` need integers, and get them.
- Arithmetic stays the library's own on doubles, which is what nearly all samples have. Where an operand may be a whole
  number that is no double, our own functions are called instead, five times slower. The `exact` text does so
  everywhere, for samples with such numbers.
- `size` is ours, which counts a string's code points where the library counts bytes.
- `has(imu.gyro)` is false for a stream without a value, and `heard` and `age` ask what the scope knows about it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.policy import cel_functions, cel_numbers
from contextpolicy.policy.cel_cost import asked_stream
from contextpolicy.policy.cel_functions import FUNCTIONS, INSTEAD, MACROS
from contextpolicy.policy.cel_kinds import ValueKind
from contextpolicy.policy.cel_syntax import Construct, Node, number
from contextpolicy.policy.context_reads import check_name, read_context, variable

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

HEARD, SINCE = "__heard_", "__since_"
"""Prefixes of the variables that say if a stream has a value, and since when. No stream name can begin so."""
REACHED, PASSED = "__reached", "__passed"
"""Functions of that moment and a number of seconds: whether that age is reached, and whether it is exceeded."""

_ARITHMETIC = {"+": "__add", "-": "__subtract", "*": "__multiply", "/": "__divide"}
_MIRRORED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_AGES = {">": ("", PASSED), ">=": ("", REACHED), "<": ("!", REACHED), "<=": ("!", PASSED)}

_SELECTED = re.compile(r"(?!(?:true|false|null|in)$)[A-Za-z_][A-Za-z0-9_]*")
"""Names that can stand after a dot; any other field is read by an index."""


@dataclass(frozen=True, slots=True, order=True)
class Age:
    """A stream's age at which an expression may change its value without a sample."""

    stream: str
    seconds: float
    passed: bool
    """Whether the change comes just after `seconds` (`>`, `<=`) or exactly at it (`>=`, `<`)."""


@dataclass(frozen=True, slots=True)
class Rewriting:
    """`fast` is right for samples whose numbers are all doubles, `exact` for all samples."""

    fast: str
    exact: str
    ages: frozenset[Age]
    asked: frozenset[str]
    """The streams that it tests for a value."""


def rewrite(tree: Node) -> Rewriting:
    """What the library is to evaluate; ValueError for an age that is not compared with a number."""
    exact, fast = _Writer(exact=True), _Writer(exact=_walks_whole(tree))
    return Rewriting(fast.text(tree), exact.text(tree), frozenset(exact.ages), frozenset(exact.asked))


class _Writer:
    """Writes nodes as text, and collects the ages and streams that they ask about."""

    def __init__(self, *, exact: bool) -> None:
        self.ages: set[Age] = set()
        self.asked: set[str] = set()
        self._exact = exact
        self._bound: frozenset[str] = frozenset()
        self._writers: dict[Construct, Callable[[Node], str]] = {
            Construct.NUMBER: self._number,
            Construct.SELECT: self._select,
            Construct.INDEX: self._index,
            Construct.CALL: self._call,
            Construct.METHOD: self._method,
            Construct.LIST: self._list,
            Construct.MAP: self._map,
            Construct.UNARY: self._unary,
            Construct.BINARY: self._binary,
            Construct.CHOICE: self._choice,
        }

    def text(self, node: Node) -> str:
        """The node as CEL, in brackets unless it is a single operand."""
        context = read_context(node)
        if context is not None:
            return variable(context)
        write = self._writers.get(node.kind)
        return node.text if write is None else write(node)

    def _select(self, node: Node) -> str:
        of = self.text(node.parts[0])
        return f"{of}.{node.text}" if _SELECTED.fullmatch(node.text) else f"{of}[{node.text!r}]"

    def _index(self, node: Node) -> str:
        return f"{self.text(node.parts[0])}[{self._key(node.parts[1])}]"

    def _list(self, node: Node) -> str:
        return f"[{self._row(node.parts)}]"

    def _map(self, node: Node) -> str:
        pairs = zip(node.parts[::2], node.parts[1::2], strict=True)
        return "{" + ", ".join(f"{self._key(name)}: {self.text(value)}" for name, value in pairs) + "}"

    def _choice(self, node: Node) -> str:
        condition, yes, no = map(self.text, node.parts)
        return f"({condition} ? {yes} : {no})"

    def _row(self, nodes: Sequence[Node]) -> str:
        return ", ".join(map(self.text, nodes))

    def _number(self, node: Node) -> str:
        return cel_numbers.literal(cel_numbers.normal(number(node.text)))

    def _key(self, node: Node) -> str:
        if node.kind is Construct.TEXT:
            return node.text
        if node.kind is Construct.NUMBER:
            return cel_numbers.literal(cel_numbers.key(number(node.text)))
        return f"__key({self.text(node)})"

    def _method(self, node: Node) -> str:
        receiver, *arguments = node.parts
        of, bound = self.text(receiver), self._bound
        if node.text in MACROS:
            self._bound |= {arguments[0].text}
        call = f"{of}.{INSTEAD.get(node.text, node.text)}({self._row(arguments)})"
        self._bound = bound
        return call

    def _call(self, node: Node) -> str:
        if node.text == cel_functions.HEARD.name:
            self.asked.add(asked_stream(node))
            return HEARD + asked_stream(node)
        if node.text == cel_functions.AGE.name:
            raise ValueError("uses age() for something other than a comparison with a number, such as age(imu) > 2")
        call = f"{INSTEAD.get(node.text, node.text)}({self._row(node.parts)})"
        stream = _root(node.parts[0]) if node.text == cel_functions.HAS.name and node.parts else None
        if stream is not None:
            check_name(stream)
        if stream is None or stream in self._bound:
            return call
        self.asked.add(stream)
        return f"({HEARD}{stream} && {call})"

    def _unary(self, node: Node) -> str:
        operand = self.text(node.parts[0])
        exact = node.text == "-" and (self._exact or _may_be_whole(node))
        return f"__negate({operand})" if exact else f"({node.text}{operand})"

    def _binary(self, node: Node) -> str:
        if any(_is_age(part) for part in node.parts):
            return self._age(node)
        if node.text == "%":
            return f"__remainder({self._row(node.parts)})"
        if node.text in _ARITHMETIC and (self._exact or _may_be_whole(node)):
            return f"{_ARITHMETIC[node.text]}({self._row(node.parts)})"
        if node.text == "in":
            return f"({self._sought(*node.parts)} in {self.text(node.parts[1])})"
        return "(" + f" {node.text} ".join(map(self.text, node.parts)) + ")"

    def _sought(self, node: Node, among: Node) -> str:
        """Lists compare numbers by value; only a map's keys must be whole, and the keys of samples are strings."""
        return self.text(node) if among.kind is Construct.LIST or among.path() is not None else self._key(node)

    def _age(self, node: Node) -> str:
        left, right = node.parts[:2]
        operator, call, limit = node.text, left, right
        if not _is_age(left):
            operator, call, limit = _MIRRORED.get(node.text, ""), right, left
        if operator not in _AGES or limit.kind is not Construct.NUMBER:
            raise ValueError(
                "compares age() with something other than a number, or not by <, <=, > or >=, such as age(imu) > 2"
            )
        no, function = _AGES[operator]
        stream, seconds = asked_stream(call), float(number(limit.text))
        self.ages.add(Age(stream, seconds, passed=function == PASSED))
        return f"({no}{function}({SINCE}{stream}, {seconds!r}))"


def _may_be_whole(node: Node) -> bool:
    """Whether the library may see an integer in its value even when no sample holds one."""
    if node.kind is Construct.NUMBER:
        return isinstance(cel_numbers.normal(number(node.text)), int)
    function = FUNCTIONS.get(node.text) if node.kind in {Construct.CALL, Construct.METHOD} else None
    if function and function.returns not in {ValueKind.NUMBER, ValueKind.ANY}:
        return function.returns is ValueKind.WHOLE
    if node.kind is Construct.BINARY and node.text not in _ARITHMETIC:
        return False  # truth values, and `%`, which is ours
    return any(map(_may_be_whole, node.parts))


def _walks_whole(node: Node) -> bool:
    """Whether a macro's variable may be such a number."""
    walks = node.kind is Construct.METHOD and node.text in MACROS
    return (walks and _may_be_whole(node.parts[0])) or any(map(_walks_whole, node.parts))


def _root(node: Node) -> str | None:
    """The variable that a chain of selections and indices begins with; None if it is no variable."""
    while node.kind in {Construct.SELECT, Construct.INDEX}:
        node = node.parts[0]
    return node.text if node.kind is Construct.NAME else None


def _is_age(node: Node) -> bool:
    return node.kind is Construct.CALL and node.text == cel_functions.AGE.name
