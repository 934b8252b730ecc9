"""CEL over streams: compiled once, checked for names and cost, evaluated on samples (about 1 us each)."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import cel

from contextpolicy.errors import ExpressionError
from contextpolicy.planning import syntax

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MAX_LENGTH = 1024

Value = TypeVar("Value")

# The library logs each failing function besides raising it: one line per bad sample, at the sensor's rate.
logging.getLogger("cel").setLevel(logging.CRITICAL)


def norm(vector: Sequence[float] | dict[str, float]) -> float:
    """Euclidean length of a list, or of a map's values (ROS vectors are {x, y, z})."""
    values = vector.values() if isinstance(vector, dict) else vector
    return math.hypot(*values)


_BUILT_IN = {
    *("size", "contains", "startsWith", "endsWith", "matches", "has", "type", "dyn"),
    *("int", "uint", "double", "string", "bytes", "timestamp", "duration"),
    *syntax.MACROS,
    *("getFullYear", "getMonth", "getDate", "getDayOfMonth", "getDayOfWeek", "getDayOfYear"),
    *("getHours", "getMinutes", "getSeconds", "getMilliseconds"),
}
"""What the CEL implementation itself defines."""

FUNCTIONS: dict[str, Callable[..., Any]] = {
    "norm": norm,
    "abs": abs,
    "min": min,
    "max": max,
    "sqrt": math.sqrt,
}


class Expression:
    """A compiled CEL expression with the variables it reads and the functions that nobody defines."""

    __slots__ = ("_max_size", "_program", "reads", "source", "unknown_functions", "variables")

    def __init__(self, source: str) -> None:
        """Compile; ValueError says what is wrong with the source."""
        if len(source) > MAX_LENGTH:
            raise ValueError(f"has {len(source)} characters, allowed: {MAX_LENGTH}")
        self.source = source
        self._program = cel.compile(source)
        scanned = syntax.scan(source)
        self.reads, self.variables, self._max_size = scanned.reads, scanned.streams, scanned.max_size
        self.unknown_functions = {name for name in self._program.functions() if name[0].isalpha()} - (
            _BUILT_IN | FUNCTIONS.keys()
        )

    def evaluate(self, scope: Scope) -> Any:
        """The value on the scope's latest samples; ExpressionError when it has none."""
        if self._max_size is not None:
            self._check_size(scope, self._max_size)
        try:
            return self._program.execute(scope.context)
        except KeyError as error:
            raise ExpressionError(f"{self.source}: the sample has no field {error}") from error
        except (ValueError, TypeError, RuntimeError, ArithmeticError, LookupError) as error:
            raise ExpressionError(f"{self.source}: {error}") from error

    def truth(self, scope: Scope) -> bool:
        """A condition's value; ExpressionError when it is not a boolean."""
        value = self.evaluate(scope)
        if not isinstance(value, bool):
            raise ExpressionError(f"{self.source}: is {value!r}, allowed: true or false")
        return value

    def number(self, scope: Scope) -> float:
        """A finite number; ExpressionError for anything else, infinities and NaN too."""
        value = self.evaluate(scope)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ExpressionError(f"{self.source}: is {value!r}, allowed: a finite number")
        return float(value)

    def _check_size(self, scope: Scope, allowed: int) -> None:
        size = sum(scope.size(name) for name in self.variables)
        if size > allowed:
            raise ExpressionError(f"{self.source}: reads {size} values, allowed for what it does with them: {allowed}")


class Listener(Protocol):
    """Who is told that an expression has no value."""

    def on_expression_error(self, source: str, reason: str) -> None:
        """The expression failed on this sample."""

    def on_expression_recovery(self, source: str) -> None:
        """The expression that failed has a value again."""


class Guarded:
    """An expression whose failure is an answer and is told, not raised: bad samples happen."""

    def __init__(self, expression: Expression, scope: Scope, listener: Listener) -> None:
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
        return syntax.size(self._values.get(stream))


def _grow(reads: dict[str, dict[str, Any]], path: syntax.Path) -> None:
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
