"""Type checks of CEL expressions, from their source and the shapes of their streams.

Reports only what fails, or never holds, on every sample of these shapes: an unknown operand may be anything.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.cel_functions import FUNCTIONS, HAS, MACROS, Macro
from contextpolicy.policy.cel_kinds import CallForm, Function, ValueKind
from contextpolicy.policy.cel_syntax import Construct, Node, parse
from contextpolicy.policy.context_reads import CONTEXTS
from contextpolicy.policy.validation.cel_trials import failing_call, failing_pattern
from contextpolicy.policy.validation.shapes import (
    ANY,
    BOOL,
    BYTES,
    DURATION,
    LIST,
    MAP,
    NULL,
    NUMBER,
    PLAIN,
    TEXT,
    TIME,
    Shape,
    known_fields,
    list_of,
    of_kind,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

_ADDED = (NUMBER, TEXT, BYTES, LIST)
_ORDERED = (NUMBER, TEXT, BYTES, BOOL, TIME, DURATION)
_CALENDAR = (TIME, DURATION)


def mistakes(source: str, wanted: Shape, shapes: Mapping[str, Shape]) -> list[str]:
    """What is wrong with an expression that must yield `wanted`, each in words for a finding's `allowed`."""
    try:
        tree = parse(source)
    except ValueError as error:
        return [f"a CEL expression; it {error}"]
    checker = _Checker(source, shapes, frozenset(_asked(tree)))
    found = checker.shape(tree)
    if not checker.found and ANY.kind not in (found.kind, wanted.kind) and found.kind != wanted.kind:
        checker.found.append(f"expected {wanted.kind}; this is {found.kind}{checker.meant(tree)}")
    return list(dict.fromkeys(checker.found))


def _asked(tree: Node) -> Iterator[tuple[str, ...] | None]:
    """Paths that the expression tests with `has`: it is prepared for samples without them."""
    if tree.kind is Construct.CALL and tree.text == HAS.name:
        yield from (part.path() for part in tree.parts)
    for part in tree.parts:
        yield from _asked(part)


class _Checker:
    """Walks one tree. A mistake is reported once; its result is ANY, so that it causes no further reports."""

    def __init__(self, source: str, shapes: Mapping[str, Shape], asked: frozenset[tuple[str, ...] | None]) -> None:
        self.found: list[str] = []
        self._source, self._asked = source, asked
        self._known = dict(shapes)
        self._streams = {name for name in shapes if name != CONTEXTS}
        self._rules: dict[Construct, Callable[[Node], Shape]] = {
            Construct.SELECT: self._select,
            Construct.INDEX: self._index,
            Construct.CALL: self._call,
            Construct.METHOD: self._method,
            Construct.LIST: self._list,
            Construct.UNARY: self._unary,
            Construct.BINARY: self._binary,
            Construct.CHOICE: self._choice,
        }

    def shape(self, node: Node) -> Shape:
        if node.kind in self._rules:
            return self._rules[node.kind](node)
        match node.kind:
            case Construct.NUMBER:
                return NUMBER
            case Construct.TEXT:
                # Prefixes come before the opening quote: b"..." is bytes, r"..." still text.
                return BYTES if "b" in node.text.lower().partition(node.text[-1])[0] else TEXT
            case Construct.CONSTANT:
                return NULL if node.text == "null" else BOOL
            case Construct.NAME:
                return self._known.get(node.text, ANY)
            case _:
                for part in node.parts:
                    self.shape(part)
                return MAP

    def _text(self, node: Node) -> str:
        return self._source[slice(*node.span)]

    def _want(self, node: Node, *wanted: Shape) -> Shape:
        """The node's shape; reported, and ANY, if it is none of those wanted."""
        shape = self.shape(node)
        if ANY in (shape, *wanted) or shape.kind in (one.kind for one in wanted):
            return shape
        allowed = " or ".join(one.kind for one in wanted)
        self.found.append(f"{self._text(node)} is {shape.kind}, expected {allowed}{self.meant(node)}")
        return ANY

    def meant(self, node: Node) -> str:
        """How to read a plain value, where its stream was used in its place; else empty."""
        if node.kind is not Construct.NAME or node.text not in self._streams:
            return ""
        return f"; a sample that is a plain value, such as 5, is read as {node.text}.value"

    def _walked(self, node: Node) -> Shape:
        """What a loop, `in` or `size` walks over; a sample that is a plain value has nothing to walk over."""
        shape = self._want(node, LIST, MAP)
        if shape.kind == MAP.kind and shape.owner == PLAIN:
            self.found.append(f"{self._text(node)} is a map of one field{self.meant(node)}")
            return ANY
        return shape

    def _names(self, node: Node, shape: Shape) -> Shape:
        """What is in a list or a map: a sample's fields have names."""
        if shape.kind == LIST.kind and shape.item:
            return shape.item
        return TEXT if self._has_names(node, shape) else ANY

    def _in(self, node: Node) -> None:
        one, (part, over) = self.shape(node.parts[0]), node.parts
        item = self._names(over, self._walked(over))
        if one.kind != item.kind and not {one.kind, item.kind} & {ANY.kind, NULL.kind}:
            meant = self.meant(part) or self.meant(over)
            self.found.append(
                f"{self._text(part)} is {one.kind}, and everything in {self._text(over)} is {item.kind}{meant}"
            )

    def _select(self, node: Node) -> Shape:
        owner, name = self.shape(node.parts[0]), node.text
        if owner.kind not in (ANY.kind, MAP.kind):
            self.found.append(f"{self._text(node.parts[0])} is {owner.kind}, which has no field {name}")
            return ANY
        if owner.fields is None:
            return ANY
        optional = not owner.complete and node.path() in self._asked
        if name not in owner.fields and not optional:
            self.found.append(f"{self._text(node.parts[0])} has no field {name}: {known_fields(owner, name)}")
        return owner.fields.get(name, ANY)

    def _index(self, node: Node) -> Shape:
        owner, index = self._want(node.parts[0], LIST, MAP), node.parts[1]
        self.shape(index)
        if index.kind is Construct.NUMBER and self._has_names(node.parts[0], owner):
            what = self._text(node.parts[0])
            self.found.append(f"{what} is a map, whose fields have names, not numbers{self.meant(node.parts[0])}")
            return ANY
        return owner.item or ANY

    def _has_names(self, node: Node, shape: Shape) -> bool:
        """Whether it is a map of a sample, whose keys are texts."""
        is_stream = node.kind is Construct.NAME and node.text in self._streams
        return shape.kind == MAP.kind and (shape.fields is not None or is_stream)

    def _call(self, node: Node) -> Shape:
        function = FUNCTIONS.get(node.text)
        wanted = function.kinds(len(node.parts)) if function and _is_form(function, node) else None
        if function is None or wanted is None:
            return self._miscalled(node, function)
        if node.kind is Construct.CALL and all(part.kind is Construct.TEXT for part in node.parts):
            self.found += failing_call(self._text(node), function)
        known = len(self.found)
        for part, kinds in zip(node.parts, wanted, strict=True):
            shape = self._want(part, *map(of_kind, kinds))
            if shape.kind == MAP.kind and ValueKind.LIST in kinds:
                self._check_map(part, shape, function)
            if ValueKind.PATTERN in kinds and part.kind is Construct.TEXT:
                self.found += failing_pattern(part.text)
        if node.kind is Construct.METHOD and len(self.found) > known:
            self.found[-1] += f" ({function.name}: {function.meaning})"
        return of_kind(function.returns)

    def _check_map(self, part: Node, shape: Shape, function: Function) -> None:
        """A map in place of a vector, whose fields all have to be numbers, or in place of a list."""
        fields = (shape.fields or {}).items()
        other = [name for name, field in fields if field.kind not in {NUMBER.kind, ANY.kind}]
        if other and function.returns is ValueKind.DOUBLE:
            self.found.append(f"{self._text(part)} is a map whose field {other[0]} is not a number{self.meant(part)}")
        elif shape.owner == PLAIN:
            self._walked(part)

    def _miscalled(self, node: Node, function: Function | None) -> Shape:
        for part in node.parts:
            self.shape(part)
        if (
            function
            and function.form is CallForm.METHOD
            and ValueKind.TIME in function.takes[0]
            and len(node.parts) == 2
        ):
            zone = self._text(node.parts[1])
            self.found.append(f"{self._text(node)}: {function.name}() takes no time zone, such as {zone}; it is in UTC")
        elif function:
            wrong = f"expected a call such as {function.example}, not {self._text(node)} ({function.meaning})"
            self.found.append(wrong)
        return ANY

    def _method(self, node: Node) -> Shape:
        receiver, *arguments = node.parts
        if node.text in MACROS and len(arguments) > 1:
            return self._macro(node, self._walked(receiver), arguments)
        return self._call(node)

    def _macro(self, node: Node, over: Shape, arguments: list[Node]) -> Shape:
        name, variable, body, known = node.text, arguments[0].text, arguments[-1], len(self.found)
        # The macro's variable hides a stream of the same name, but only inside the macro.
        before = self._known.get(variable)
        self._known[variable] = self._names(node.parts[0], over)
        for condition in arguments[1:-1]:
            self._want(condition, BOOL)
        result = self.shape(body) if name == Macro.MAP else self._want(body, BOOL)
        self._known.pop(variable)
        if before is not None:
            self._known[variable] = before
        if len(self.found) > known and over.kind == MAP.kind:
            self.found[-1] += f": {variable} is the name of a field{self.meant(node.parts[0])}"
        if name == Macro.MAP:
            return list_of(result)
        return (over if over.kind == LIST.kind else LIST) if name == Macro.FILTER else BOOL

    def _list(self, node: Node) -> Shape:
        shapes = [self.shape(part) for part in node.parts]
        return list_of(shapes[0] if shapes and all(shape == shapes[0] for shape in shapes) else ANY)

    def _unary(self, node: Node) -> Shape:
        if node.text == "-":
            return self._want(node.parts[0], NUMBER, DURATION)
        self._want(node.parts[0], BOOL)
        return BOOL

    def _binary(self, node: Node) -> Shape:
        match node.text:
            case "&&" | "||":
                for part in node.parts:
                    self._want(part, BOOL)
            case "<" | "<=" | ">" | ">=":
                self._alike(node, _ORDERED)
            case "==" | "!=":
                self._alike(node, ())
            case "in":
                self._in(node)
            case "+":
                return self._alike(node, (*_ADDED, *_CALENDAR))
            case _:
                return self._alike(node, (NUMBER, *_CALENDAR))
        return BOOL

    def _alike(self, node: Node, wanted: tuple[Shape, ...]) -> Shape:
        """The common shape of both sides; reported, and ANY, if they differ."""
        one, other = (self._want(part, *wanted) if wanted else self.shape(part) for part in node.parts)
        # Null compares with everything, and times mix with durations: time - time, time + duration.
        free = {ANY.kind, NULL.kind}
        calendar = {shape.kind for shape in _CALENDAR}
        if one.kind != other.kind and not {one.kind, other.kind} & free and not {one.kind, other.kind} <= calendar:
            verb = "never equal" if node.text in ("==", "!=") else f"{node.text} takes two values of the same kind"
            meant = "".join(map(self.meant, node.parts))
            self.found.append(f"{self._text(node)} has {one.kind} and {other.kind}: {verb}{meant}")
            return ANY
        known = other if one.kind in free else one
        return ANY if known.kind in calendar else known

    def _choice(self, node: Node) -> Shape:
        self._want(node.parts[0], BOOL)
        yes, no = map(self.shape, node.parts[1:])
        return yes if yes == no else ANY


def _is_form(function: Function, node: Node) -> bool:
    return function.form in {CallForm.EITHER, CallForm.CALL if node.kind is Construct.CALL else CallForm.METHOD}
