"""CEL source as a tree: the CEL library exposes none, and the other `cel` modules and explanations need one.

Only source that the library compiles is parsed, so this is CEL's grammar without its checks. ValueError for what is no
expression or nests too deeply to walk.
"""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass, field
from enum import Enum, auto

LARGEST = sys.float_info.max
MAX_BRACKETS = 32
MAX_DEPTH = 64
"""Operands within operands; long sums and chains of selections nest, too. The library takes 96."""

_CONSTANTS = frozenset({"true", "false", "null"})
_CLOSES = {"(": ")", "[": "]", "{": "}"}
_LEVELS = (
    ("||",),
    ("&&",),
    ("<", "<=", ">=", ">", "==", "!=", "in"),
    ("+", "-"),
    ("*", "/", "%"),
)
"""Binary operators, the loosest first; all group to the left."""

_TOKEN = re.compile(
    r"""\s+|//[^\n]*
    |(?P<text>(?:[rR][bB]?|[bB][rR])(?:\"{3}(?s:.*?)\"{3}|'{3}(?s:.*?)'{3}|"[^"\n]*"|'[^'\n]*')
      |[bB]?(?:\"{3}(?s:.*?)\"{3}|'{3}(?s:.*?)'{3}|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'))
    |(?P<name>[A-Za-z_]\w*)
    |(?P<number>0[xX][0-9a-fA-F]+[uU]?|(?:\d+(?:\.\d+)?|\.\d+)(?:[eE][+-]?\d+)?[uU]?)
    |(?P<operator>==|!=|<=|>=|&&|\|\||.)""",
    re.VERBOSE,
)
_PLAIN_TEXT = re.compile(r""""[^"\\]*"|'[^'\\]*'""")


class Construct(Enum):
    """What a node is, and what its `text` and `parts` are."""

    NUMBER = auto()
    TEXT = auto()
    """A string or bytes, quotes included."""
    CONSTANT = auto()
    NAME = auto()
    SELECT = auto()
    """`text` is the field, the part what it is selected from, be it as `imu.gyro` or as `imu['gyro']`."""
    INDEX = auto()
    """The parts are what is indexed and the index, which is no plain string."""
    CALL = auto()
    METHOD = auto()
    """A call whose first part is the receiver."""
    LIST = auto()
    MAP = auto()
    """The parts are keys and values in turn."""
    UNARY = auto()
    BINARY = auto()
    """Two parts; for `&&` and `||` one for each operand in a row."""
    CHOICE = auto()
    """Condition, value if true, value if false."""


_COLLECTIONS = {"[": Construct.LIST, "{": Construct.MAP}
_LITERALS = {"number": Construct.NUMBER, "text": Construct.TEXT}


@dataclass(frozen=True, slots=True)
class Node:
    """One operand with all below it."""

    kind: Construct
    text: str
    parts: tuple[Node, ...] = ()
    span: tuple[int, int] = field(default=(0, 0), compare=False)
    """Start and end in the source, without enclosing brackets."""
    depth: int = field(default=0, compare=False)
    _hash: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_hash", hash((self.kind, self.text, self.parts)))

    def __hash__(self) -> int:
        """Found once, not by a walk of all below it each time that it is looked up."""
        return self._hash

    def path(self) -> tuple[str, ...] | None:
        """`("imu", "gyro")` for imu.gyro and imu['gyro']; None for anything but selections from a name."""
        names, node = [], self
        while node.kind is Construct.SELECT:
            names.append(node.text)
            node = node.parts[0]
        return (node.text, *reversed(names)) if node.kind is Construct.NAME else None


def parse(source: str) -> Node:
    """The tree of a source that compiles; ValueError for what is no expression or nests too deeply."""
    tokens = [Token(m[0], m.lastgroup or "", m.start(), m.end()) for m in _TOKEN.finditer(source) if m.lastgroup]
    # Checked before parsing: the parser recurses for each bracket and each `?`.
    brackets = 0
    for token in tokens:
        brackets += (token.text in _CLOSES) - (token.text in _CLOSES.values())
        if brackets > MAX_BRACKETS:
            raise ValueError(f"nests brackets deeper than {MAX_BRACKETS}")
    if sum(token.text == "?" for token in tokens) > MAX_BRACKETS:
        raise ValueError(f"uses ? more than {MAX_BRACKETS} times")
    parser = _Parser(tokens)
    tree = parser.expression()
    parser.end()
    return tree


def plain_text(node: Node) -> str | None:
    """What a string says that has neither escapes nor three quotes; None for any other node."""
    plain = node.kind is Construct.TEXT and _PLAIN_TEXT.fullmatch(node.text)
    return node.text[1:-1] if plain else None


def number(literal: str) -> int | float:
    """The value of a number literal; ValueError for anything else, and for a number that is larger than any double."""
    digits = literal.rstrip("uU").lower()
    if digits.startswith("0x"):
        return int(digits, 16)
    if math.isinf(float(digits)):
        raise ValueError(f"has the number {literal}, expected one of at most {LARGEST:.2g}")
    return int(digits) if digits.isdigit() else float(digits)


@dataclass(frozen=True, slots=True)
class Token:
    """A word of the source; `kind` is the group of `_TOKEN` that it matched."""

    text: str
    kind: str
    start: int
    end: int


_NOTHING = Token("", "", 0, 0)


@dataclass
class _Parser:
    """Recursive descent; brackets bound its depth."""

    tokens: list[Token]
    at: int = 0

    def expression(self) -> Node:
        start = self._next().start
        condition = self._binary(0)
        if not self._skip("?"):
            return condition
        yes = self.expression()
        self._expect(":")
        no = self.expression()
        return self._node(Construct.CHOICE, "?", condition, yes, no, start=start)

    def end(self) -> None:
        if self.at < len(self.tokens):
            raise self._unexpected()

    def _binary(self, level: int) -> Node:
        if level == len(_LEVELS):
            return self._unary()
        start = self._next().start
        left = self._binary(level + 1)
        while (operator := self._next().text) in _LEVELS[level]:
            self.at += 1
            right = self._binary(level + 1)
            row = left.parts if level < 2 and left.kind is Construct.BINARY and left.text == operator else (left,)
            left = self._node(Construct.BINARY, operator, *row, right, start=start)
        return left

    def _unary(self) -> Node:
        signs = []
        while self._next().text in {"!", "-"}:
            signs.append(self._take())
        operand = self._member()
        for sign in reversed(signs):
            operand = self._node(Construct.UNARY, sign.text, operand, start=sign.start)
        return operand

    def _member(self) -> Node:
        start = self._next().start
        operand = self._primary()
        while self._next().text in {".", "["}:
            if self._take().text == "[":
                index = self.expression()
                self._expect("]")
                operand = self._indexed(operand, index, start)
                continue
            name = self._name()
            if self._next().text == "(":
                operand = self._node(Construct.METHOD, name.text, operand, *self._arguments("("), start=start)
            else:
                operand = self._node(Construct.SELECT, name.text, operand, start=start)
        return operand

    def _indexed(self, operand: Node, index: Node, start: int) -> Node:
        name = plain_text(index)
        if name is not None:
            return self._node(Construct.SELECT, name, operand, start=start)
        return self._node(Construct.INDEX, "[", operand, index, start=start)

    def _primary(self) -> Node:
        token = self._next()
        if token.text == "(":
            self.at += 1
            inner = self.expression()
            self._expect(")")
            return inner
        if token.text in _COLLECTIONS:
            return self._node(_COLLECTIONS[token.text], token.text, *self._arguments(token.text), start=token.start)
        if token.kind in _LITERALS:
            if token.kind == "number":
                number(token.text)  # the library would take 1e400 for infinity
            return self._node(_LITERALS[token.kind], self._take().text, start=token.start)
        return self._named(self._name())

    def _named(self, name: Token) -> Node:
        if self._next().text == "(" and name.text not in _CONSTANTS:
            return self._node(Construct.CALL, name.text, *self._arguments("("), start=name.start)
        construct = Construct.CONSTANT if name.text in _CONSTANTS else Construct.NAME
        return self._node(construct, name.text, start=name.start)

    def _arguments(self, opening: str) -> list[Node]:
        """The expressions between brackets; for a map, keys and values in turn."""
        self._expect(opening)
        items = []
        while self._next().text != _CLOSES[opening]:
            items.append(self.expression())
            if opening == "{":
                self._expect(":")
                items.append(self.expression())
            if not self._skip(","):
                break
        self._expect(_CLOSES[opening])
        return items

    def _name(self) -> Token:
        if self._next().kind != "name" or self._next().text == "in":
            raise self._unexpected()
        return self._take()

    def _next(self) -> Token:
        return self.tokens[self.at] if self.at < len(self.tokens) else _NOTHING

    def _take(self) -> Token:
        self.at += 1
        return self.tokens[self.at - 1]

    def _skip(self, text: str) -> bool:
        found = self._next().text == text
        self.at += found
        return found

    def _expect(self, text: str) -> None:
        if not self._skip(text):
            raise self._unexpected()

    def _unexpected(self) -> ValueError:
        token = self._next()
        return ValueError(
            f"has an unexpected {token.text} at character {token.start + 1}" if token.text else "ends too early"
        )

    def _node(self, kind: Construct, text: str, *parts: Node, start: int) -> Node:
        """A node that ends with the last token taken."""
        depth = 1 + max((part.depth for part in parts), default=0)
        if depth > MAX_DEPTH:
            raise ValueError(f"nests operands deeper than {MAX_DEPTH}")
        return Node(kind, text, parts, (start, self.tokens[self.at - 1].end), depth)
