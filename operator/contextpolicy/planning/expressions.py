"""CEL expressions on live streams: the variables that they see, and failures that are told instead of raised."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import cel

from contextpolicy.errors import ExpressionError
from contextpolicy.policy import cel_syntax
from contextpolicy.policy.cel import FUNCTIONS, Expression

if TYPE_CHECKING:
    from collections.abc import Callable

Value = TypeVar("Value")


class ExpressionListener(Protocol):
    """Who is told that an expression has no value."""

    def on_expression_error(self, source: str, reason: str) -> None:
        """The expression failed on this sample."""

    def on_expression_recovery(self, source: str) -> None:
        """The expression that failed has a value again."""


class Guarded:
    """An expression whose failure is an answer and is told, not raised: bad samples happen."""

    def __init__(self, expression: Expression, scope: Scope, listener: ExpressionListener) -> None:
        self.variables = expression.variables
        self._expression, self._scope, self._listener = expression, scope, listener
        self._failing = False

    def truth(self) -> bool:
        """False when the condition has no value."""
        return self._try(self._expression.truth) or False

    def number(self) -> float:
        """0 when the expression has no number."""
        return self._try(self._expression.number) or 0.0

    def _try(self, read: Callable[[Scope], Value]) -> Value | None:
        try:
            value = read(self._scope)
        except ExpressionError as error:
            self._failing = True
            source = self._expression.source
            self._listener.on_expression_error(source, str(error).removeprefix(f"{source}: "))
            return None
        if self._failing:
            self._failing = False
            self._listener.on_expression_recovery(self._expression.source)
        return value


class Scope:
    """The variables that expressions see: what they read of the latest sample of each stream.

    Only that is handed to CEL: converting a whole ROS message costs more than all evaluations on it.
    """

    __slots__ = ("_reads", "_values", "context")

    def __init__(self) -> None:
        self.context = cel.Context(functions=FUNCTIONS)
        self._reads: dict[str, dict[str, Any]] = {}
        self._values: dict[str, object] = {}

    def compile(self, source: str) -> Expression:
        """An expression to be evaluated in this scope; ValueError says what is wrong with the source."""
        expression = Expression(source)
        for path in expression.reads:
            _grow(self._reads, path)
        return expression

    def bind(self, stream: str, value: dict[str, Any]) -> None:
        """Make `value` the stream's latest sample; ExpressionError when CEL has no such type."""
        reads = self._reads.get(stream)
        if reads is None:
            return
        part = _prune(value, reads)
        try:
            self.context.add_variable(stream, part)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise ExpressionError(f"{stream}: {error}") from error
        self._values[stream] = part

    def size(self, stream: str) -> int:
        """How many values expressions see of the stream."""
        return cel_syntax.size(self._values.get(stream))


def _grow(reads: dict[str, dict[str, Any]], path: cel_syntax.Path) -> None:
    """Add a path to a tree; an empty branch means all below it."""
    whole = False
    for name in path:
        if whole:
            return
        known = name in reads
        reads = reads.setdefault(name, {})
        whole = known and not reads
    reads.clear()


def _prune(value: Any, reads: dict[str, dict[str, Any]]) -> Any:
    """The part of a sample that the tree names; what is no map is kept, so that CEL can say what is wrong with it."""
    if not reads or not isinstance(value, dict):
        return value
    return {
        name: _prune(value[name], below) if below else value[name] for name, below in reads.items() if name in value
    }
