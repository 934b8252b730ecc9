"""YAML as the API server reads it, with the line and column of every field.

Limits: 2^20 characters per file, 64 levels, 100,000 values after aliases are expanded.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

import yaml

from contextpolicy.errors import ContextPolicyError

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_BYTES = 2**20
MAX_DEPTH = 64
MAX_VALUES = 100_000
_MERGE = "tag:yaml.org,2002:merge"
_OWN = (":timestamp", ":float", ":int", ":value", ":bool")


@dataclass(frozen=True, slots=True)
class Position:
    """A line and a column, counted from 1."""

    line: int
    column: int


WHOLE_FILE = Position(0, 0)
"""Where a problem is that concerns no line of a file, such as one that is not there."""


class DocumentError(ContextPolicyError):
    """A file that is not YAML, or YAML that Kubernetes could not store."""

    def __init__(self, message: str, position: Position) -> None:
        self.position = position
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Document:
    """One YAML document; paths are written as in findings: `spec.tasks[0].min`."""

    body: Any
    positions: dict[str, Position] = field(default_factory=dict)
    duplicates: tuple[str, ...] = ()
    yes_and_no: dict[str, str] = field(default_factory=dict)
    """Words such as y, no and on, which YAML reads as booleans and people mean as text, by path."""
    yes_and_no_keys: dict[str, str] = field(default_factory=dict)
    """The same for keys, which become the texts true and false."""

    def position(self, path: str) -> Position:
        """The field's position; for a missing field, that of the nearest object around it."""
        while path not in self.positions and path:
            path = path[: max(path.rfind("."), path.rfind("["), 0)]
        return self.positions[path]


def text_of(file: TextIO) -> str:
    """Its text, as far as `read` has to see it to refuse a file that is too long: some never end."""
    return file.read(MAX_BYTES + 1)


def read(text: str) -> Iterator[Document]:
    """Every document in the text; DocumentError at the first place that cannot be read."""
    if len(text) > MAX_BYTES:
        raise DocumentError(f"too long: expected at most {MAX_BYTES} characters", Position(1, 1))
    try:
        loader = _Loader(text)
        while loader.check_node():
            node = loader.get_node()
            if node is not None:
                yield _Builder(loader).document(node)
    except yaml.MarkedYAMLError as error:
        message = ": ".join(part for part in (error.context, error.problem) if part)
        raise DocumentError(
            f"not valid YAML: {message}", _position(error.problem_mark or error.context_mark)
        ) from error
    except yaml.YAMLError as error:
        raise DocumentError(f"not valid YAML: {str(error).splitlines()[0]}", Position(1, 1)) from error


class _Loader(yaml.SafeLoader):
    """Resolves plain scalars as Kubernetes' YAML reader does: no dates, no base 60, and 1e3 is a number."""

    yaml_implicit_resolvers = {  # noqa: RUF012 - PyYAML's own protocol
        first: [(tag, pattern) for tag, pattern in resolvers if not tag.endswith(_OWN)]
        for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }
    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        # PyYAML composes recursively: unbounded nesting would end in RecursionError.
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise DocumentError(
                f"nested deeper than {MAX_DEPTH} levels", _position(parent.start_mark if parent else None)
            )
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


_PLAIN_SCALARS = (
    ("bool", r"(y|Y|yes|Yes|YES|n|N|no|No|NO|true|True|TRUE|false|False|FALSE|on|On|ON|off|Off|OFF)$"),
    ("int", r"[-+]?(0b[01_]+|0o?[0-7_]+|0x[0-9a-fA-F_]+|0|[1-9][0-9_]*)$"),
    ("float", r"[-+]?([0-9][0-9_]*\.?[0-9_]*|\.[0-9]+)([eE][-+]?[0-9]+)?$|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$"),
)
for _tag, _pattern in _PLAIN_SCALARS:
    _first = "yYnNtTfFoO" if _tag == "bool" else "-+0123456789."
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(_pattern), list(_first))
_TRUE = frozenset({"y", "yes", "true", "on"})
_BOOL = "tag:yaml.org,2002:bool"


class _Builder:
    """One document's nodes -> plain values; records positions and duplicate keys."""

    def __init__(self, loader: _Loader) -> None:
        self._loader = loader
        self._positions: dict[str, Position] = {}
        self._duplicates: list[str] = []
        self._yes_and_no: dict[str, str] = {}
        self._yes_and_no_keys: dict[str, str] = {}
        self._values = 0

    def document(self, node: yaml.Node) -> Document:
        body = self._value(node, "", ())
        return Document(body, self._positions, tuple(self._duplicates), self._yes_and_no, self._yes_and_no_keys)

    def _value(self, node: yaml.Node, path: str, inside: tuple[int, ...]) -> Any:
        # Counted per visit, not per node: a few nested aliases expand to billions of values.
        self._values += 1
        position = _position(node.start_mark)
        if self._values > MAX_VALUES:
            raise DocumentError(f"more than {MAX_VALUES} values once its aliases are expanded", position)
        if id(node) in inside:
            raise DocumentError("an alias contains itself", position)
        # A value in a mapping keeps the position of its key.
        self._positions.setdefault(path, position)
        inside = (*inside, id(node))
        if isinstance(node, yaml.MappingNode):
            return self._mapping(node, path, inside)
        if isinstance(node, yaml.SequenceNode):
            return [self._value(item, f"{path}[{index}]", inside) for index, item in enumerate(node.value)]
        if node.tag == _BOOL:
            if node.value.lower() not in ("true", "false"):
                self._yes_and_no[path] = node.value
            return node.value.lower() in _TRUE
        try:
            return self._loader.construct_object(node)
        except ValueError as error:
            raise DocumentError(f"not a valid value: {error}", position) from error

    def _mapping(self, node: yaml.MappingNode, path: str, inside: tuple[int, ...]) -> dict[str, Any]:
        result: dict[str, Any] = {}
        merged: dict[str, Any] = {}
        for key_node, value_node in node.value:
            if key_node.tag == _MERGE:
                merged |= self._merged(value_node, path, inside)
                continue
            key = _key(key_node)
            if not key:
                raise DocumentError("a key that is not a string", _position(key_node.start_mark))
            inner = f"{path}.{key}" if path else key
            if key in result:
                self._duplicates.append(inner)
            self._positions[inner] = _position(key_node.start_mark)
            if key_node.tag == _BOOL and key_node.value.lower() not in ("true", "false"):
                before = self._yes_and_no_keys.get(inner)
                self._yes_and_no_keys[inner] = f"{before} and {key_node.value}" if before else key_node.value
            result[key] = self._value(value_node, inner, inside)
        # A mapping's own keys win over merged ones, wherever `<<` is written.
        return merged | result

    def _merged(self, node: yaml.Node, path: str, inside: tuple[int, ...]) -> dict[str, Any]:
        sources = node.value if isinstance(node, yaml.SequenceNode) else [node]
        # Reversed, because the first of several merged mappings wins.
        values = [self._value(source, path, inside) for source in reversed(sources)]
        return {key: value for source in values if isinstance(source, dict) for key, value in source.items()}


def _key(node: yaml.Node) -> str:
    """The key as text, "" if it is not a scalar. JSON keys are text, so Kubernetes turns `y:` into "true"."""
    if not isinstance(node, yaml.ScalarNode):
        return ""
    return str(node.value.lower() in _TRUE).lower() if node.tag == _BOOL else str(node.value)


def _position(mark: Any) -> Position:
    return Position(mark.line + 1, mark.column + 1) if mark is not None else Position(1, 1)
