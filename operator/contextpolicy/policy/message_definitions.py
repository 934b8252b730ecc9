"""ROS 2 messages that are part of no release, from their definitions.

Definitions are untrusted input from which rosbags generates code, so only plain names and sizes get that far.
"""

from __future__ import annotations

import re
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeAlias

from rosbags.interfaces import Nodetype
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from contextpolicy.errors import DefinitionError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.policy.definition_files import Definitions

Types: TypeAlias = dict[str, tuple[list[Any], list[Any]]]
"""Constants and fields of each message type, as rosbags describes them."""

MAX_ITEMS = 10_000
"""Fields of a message plus items of its fixed-length arrays: no sample may hold more values, and code is generated for
each."""
MAX_DEPTH = 32
"""Levels of messages inside each other; no sample may nest deeper."""

_MSG_NAME = re.compile(r"(?:.*[./])?([a-z][a-z0-9_]*)[./]msg[./]([A-Z][A-Za-z0-9]*)\.msg")
_TYPE = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*)+", re.ASCII)
_FIELD = re.compile(r"[A-Za-z]\w*", re.ASCII)
_IDL_PROSE = re.compile(r'(?s)"(?:\\.|[^"\\])*"|/\*.*?\*/|//[^\n]*')
"""String literals and comments."""
_PLAIN = frozenset(("bool", "byte", "char", "string", "float32", "float64")) | {
    f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)
}


def parse(definitions: Definitions) -> Types:
    """The types that the files define, without constants; DefinitionError lists everything that is wrong."""
    types: Types = {}
    problems: list[str] = []
    for name, text in definitions:
        try:
            found = _types(name, text)
        except DefinitionError as error:
            problems.append(f"{name}: {error}")
            continue
        for type_name, (_, fields) in found.items():
            if types.get(type_name, ([], fields))[1] != fields:
                problems.append(f"{name}: defines {type_name} again, differently")
            types[type_name] = ([], fields)
    if problems:
        raise DefinitionError("; ".join(problems))
    return types


def check_references(types: Types, standard: Mapping[str, Any]) -> None:
    """DefinitionError for messages that contain undefined messages or themselves, or nest too deeply."""
    problems: list[str] = []
    depths: dict[str, int] = {}

    def depth(name: str, inside: tuple[str, ...]) -> int:
        if name not in types:
            return 1
        if name in inside or len(inside) > MAX_DEPTH:
            problems.append(f"{inside[0]} contains itself, or more than {MAX_DEPTH} levels of messages")
            return 1
        if name not in depths:
            depths[name] = 1 + max((depth(part, (*inside, name)) for part in _parts(types[name][1])), default=0)
        return depths[name]

    for name, (_, fields) in types.items():
        unknown = {part for part in _parts(fields) if part not in types and part not in standard}
        problems += [f"{name} contains {part}, which is not defined" for part in sorted(unknown)]
        if depth(name, ()) > MAX_DEPTH:
            problems.append(f"{name} contains more than {MAX_DEPTH} levels of messages")
    if problems:
        raise DefinitionError("; ".join(dict.fromkeys(problems)))


def _types(name: str, text: str) -> Types:
    try:
        found = _from_idl(text) if name.endswith(".idl") else _from_msg(name, text)
    except DefinitionError:
        raise
    except Exception as error:  # a third-party parser on untrusted input
        raise DefinitionError(f"can't be read: {error!r:.80}") from error
    for type_name, (_, fields) in found.items():
        _check(type_name, fields)
    return found


def _from_msg(name: str, text: str) -> Types:
    match = _MSG_NAME.fullmatch(name)
    if match is None:
        raise DefinitionError("is not a type name; a .msg is named like my_msgs.msg.Mood.msg")
    try:
        return dict(get_types_from_msg(f"{text}\n", "/msg/".join(match.groups())))
    except TypesysError as error:
        header = len(f"MSG: {'/msg/'.join(match.groups())}\n")
        raise DefinitionError(_where(str(error), text, header)) from error


def _from_idl(text: str) -> Types:
    if "<<" in _IDL_PROSE.sub("", text):
        raise DefinitionError("shifts a constant; write the number")  # the parser would compute it, whatever its size
    text = re.sub(r"(?m)^[ \t]*#.*$", "", text)  # drop includes: all definitions come together anyway
    try:
        return dict(get_types_from_idl(text))
    except TypesysError as error:
        raise DefinitionError(_where(str(error), text, 0)) from error


def _where(message: str, text: str, header: int) -> str:
    """The parser's message repeats the whole file, then gives a character offset; readers need the line."""
    stopped = re.match(r"(?s)[^\n]*\n[^\n]*\n(\d+)", message)
    if stopped is None:
        return f"can't be read: {message[:200]}"
    return f"has a syntax error in line {text.count(chr(10), 0, max(int(stopped[1]) - header, 0)) + 1}"


def _check(type_name: str, fields: list[Any]) -> None:
    if not _TYPE.fullmatch(type_name):
        raise DefinitionError(f"defines {type_name!r:.80}, which is not a type name")
    items = 0
    for field, description in fields:
        if not _FIELD.fullmatch(field):
            raise DefinitionError(f"has the field {field!r:.80}, which is not a valid name")
        kind, size = _element(description)
        if not isinstance(size, int) or not size >= 0:
            raise DefinitionError(f"{field} has the size {size!r:.80}")
        items += size if description[0] is Nodetype.ARRAY else 1
        if kind[0] is Nodetype.BASE and kind[1][0] not in _PLAIN:
            raise DefinitionError(
                f"{field} is of type {kind[1][0]}; expected one of {', '.join(sorted(_PLAIN))}, and messages"
            )
        if kind[0] is Nodetype.NAME and not _TYPE.fullmatch(kind[1]):
            raise DefinitionError(f"{field} is of type {kind[1]!r:.80}, which is not a type name")
    if items > MAX_ITEMS:
        raise DefinitionError(f"{type_name} has {items} fields and items of arrays, expected at most {MAX_ITEMS}")


def _element(description: Any) -> tuple[Any, int]:
    """The type of a field or of its items, and their number: exact for an array, at most that for a sequence."""
    if description[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return description[1]  # type: ignore[no-any-return]
    return description, 0


def _parts(fields: list[Any]) -> Iterator[str]:
    """The messages that a message holds."""
    elements = (_element(description)[0] for _, description in fields)
    return chain.from_iterable((element[1],) for element in elements if element[0] is Nodetype.NAME)
