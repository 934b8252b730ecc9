"""Why a condition does not hold: the parts of its expression that decide, their values, and streams they wait for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from contextpolicy.errors import ExpressionError, UndecidedError
from contextpolicy.policy.cel_numbers import EXACT
from contextpolicy.policy.cel_syntax import Construct, Node

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.planning.conditions.expressions import Guarded, Waiting
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.planner import Planner

_JOINED = {"&&", "||"}
_COMPARED = {"<", "<=", "==", "!=", ">=", ">", "in"}
_UNTOLD = {Construct.NUMBER, Construct.TEXT, Construct.CONSTANT}
"""Operands whose value can be read in the source: not repeated."""


def deciding_parts(condition: Guarded, streams: Mapping[str, StreamState], now: float) -> list[dict[str, Any]]:
    """The parts that decide the condition's value, as plain data.

    For a false `a && b` that is the first false operand, for a false `a || b` both. Each has its source as
    `expression`, its `value`, its `operands` with their values, and if it has no value, `waitsFor` or `error`.
    """
    trace = _Trace(condition, streams, now)
    return [trace.described(part) for part in trace.deciding()]


def absence(stream: StreamState, now: float) -> dict[str, Any]:
    """For how many seconds the stream has had no value, and whether it ever had one."""
    since = now if stream.absent_since is None else stream.absent_since
    return {"stream": stream.spec.name, "for": round(now - since, 6), "heard": stream.value is not None}


def waits(planner: Planner) -> Iterator[tuple[str, Waiting]]:
    """The tasks and contexts that can't be decided now, each with what it waits for."""
    for initiative, task in planner.owned_initiatives():
        for own in (initiative.deciding, initiative.score):
            if own and own.waiting:
                yield f"task {task}", own.waiting
    for context in planner.contexts:
        deciding = context.deciding
        if deciding and deciding.waiting:
            yield f"context {context.spec.name}", deciding.waiting


class _Trace:
    """One walk through an expression, on the current samples."""

    def __init__(self, condition: Guarded, streams: Mapping[str, StreamState], now: float) -> None:
        self._condition, self._streams, self._now = condition, streams, now
        self._source = condition.expression.source

    def deciding(self) -> Iterator[Node]:
        return self._of(self._condition.expression.tree)

    def described(self, node: Node) -> dict[str, Any]:
        """A part that decides, with its operands."""
        found: dict[str, Any] = {"expression": self._text(node), "operands": self._operands(node)}
        try:
            return found | {"value": _as_written(self._value(node))}
        except UndecidedError as error:
            return found | {"value": None, "waitsFor": self._waiting(error)}
        except ExpressionError as error:
            return found | {"value": None, "error": str(error).removeprefix(f"{found['expression']}: ")}

    def _of(self, node: Node) -> Iterator[Node]:
        if node.kind is Construct.BINARY and node.text in _JOINED:
            for part in self._joined(node):
                yield from self._of(part)
        elif node.kind is Construct.UNARY and node.text == "!":
            yield from self._of(node.parts[0])
        elif node.kind is Construct.CHOICE:
            condition, yes, no = node.parts
            yield from self._of(condition)
            if self._truth(condition) is not None:
                yield from self._of(yes if self._truth(condition) else no)
        else:
            yield node

    def _joined(self, node: Node) -> list[Node]:
        """The first true operand decides `||`, the first false one `&&`; if there is none, all that could have."""
        truths = [(part, self._truth(part)) for part in node.parts]
        wanted = node.text == "||"
        decisive = [part for part, truth in truths if truth is wanted]
        undecided = [part for part, truth in truths if truth is None]
        return decisive[:1] or (undecided if undecided and not wanted else list(node.parts))

    def _truth(self, node: Node) -> bool | None:
        try:
            value = self._value(node)
        except ExpressionError:
            return None
        return value if isinstance(value, bool) else None

    def _operands(self, node: Node) -> dict[str, Any]:
        compares = node.kind is Construct.BINARY and node.text in _COMPARED
        operands = [part for part in node.parts if compares and part.kind not in _UNTOLD]
        values = {}
        for operand in operands:
            try:
                values[self._text(operand)] = _as_written(self._value(operand))
            except (ExpressionError, ValueError):  # no value, or an age, which is none by itself
                continue
        return values

    def _waiting(self, error: UndecidedError) -> dict[str, Any]:
        stream = self._streams[error.stream]
        if not stream.fresh:
            return absence(stream, self._now)
        own = self._condition.waiting
        since = own.since if own else self._now
        reason = str(error).rpartition(": ")[2]
        return {"stream": error.stream, "for": round(self._now - since, 6), "heard": True, "reason": reason}

    def _value(self, node: Node) -> Any:
        return self._condition.probe(self._text(node), self._now)

    def _text(self, node: Node) -> str:
        return self._source[slice(*node.span)]


def _as_written(value: Any) -> Any:
    """Whole numbers as integers, the way people write them: CEL computes in doubles here."""
    match value:
        case float() if value.is_integer() and abs(value) < EXACT:
            return int(value)
        case list():
            return [_as_written(inner) for inner in value]
        case dict():
            return {name: _as_written(inner) for name, inner in value.items()}
    return value
