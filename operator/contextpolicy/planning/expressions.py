"""CEL over streams: compiled once, checked for names, evaluated on samples (about 10 us each).

Bounds against expressions that would run away: at most 1024 characters and two comprehensions inside each other
(`streams` bounds the payload, so a comprehension is at most a few thousand steps).
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any

import cel

from contextpolicy.errors import ExpressionError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MAX_LENGTH = 1024
MAX_NESTED_COMPREHENSIONS = 2
_MACROS = ("all", "exists", "exists_one", "map", "filter")
_BOUND = re.compile(rf"\.(?:{'|'.join(_MACROS)})\(\s*([A-Za-z_]\w*)\s*,")


def norm(vector: Sequence[float] | dict[str, float]) -> float:
    """Euclidean length of a list, or of a map's values (ROS vectors are {x, y, z})."""
    values = vector.values() if isinstance(vector, dict) else vector
    return math.hypot(*values)


_BUILT_IN = {
    *("size", "contains", "startsWith", "endsWith", "matches", "has", "type", "dyn"),
    *("int", "uint", "double", "string", "bytes", "timestamp", "duration"),
    *("all", "exists", "exists_one", "existsOne", "map", "filter"),
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

    __slots__ = ("_program", "source", "unknown_functions", "variables")

    def __init__(self, source: str) -> None:
        """Compile; ValueError says what is wrong with the source."""
        self.source = source
        self._program = _compile(source)
        self.variables = frozenset(self._program.variables()) - set(_BOUND.findall(source))
        self.unknown_functions = {name for name in self._program.functions() if name[0].isalpha()} - (
            _BUILT_IN | FUNCTIONS.keys()
        )

    def evaluate(self, scope: Scope) -> Any:
        """The value on the scope's latest samples; ExpressionError when it has none."""
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


class Scope:
    """The variables an expression sees: the latest sample of each stream under the stream's name."""

    __slots__ = ("context",)

    def __init__(self) -> None:
        self.context = cel.Context(functions=FUNCTIONS)

    def bind(self, stream: str, value: dict[str, Any]) -> None:
        """Make `value` the stream's latest sample; ExpressionError when CEL has no such type."""
        try:
            self.context.add_variable(stream, value)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise ExpressionError(f"{stream}: {error}") from error


def _compile(source: str) -> cel.Program:
    if len(source) > MAX_LENGTH:
        raise ValueError(f"has {len(source)} characters, allowed: {MAX_LENGTH}")
    if _comprehension_depth(source) > MAX_NESTED_COMPREHENSIONS:
        raise ValueError(f"nests comprehensions deeper than {MAX_NESTED_COMPREHENSIONS}")
    return cel.compile(source)


def _comprehension_depth(source: str) -> int:
    """How deeply all/exists/map/filter calls nest, counting parentheses; strings in the source only overcount."""
    open_calls: list[bool] = []
    deepest = 0
    for position, character in enumerate(source):
        if character == "(":
            open_calls.append(source[:position].rstrip().endswith(tuple(f".{macro}" for macro in _MACROS)))
            deepest = max(deepest, sum(open_calls))
        elif character == ")" and open_calls:
            open_calls.pop()
    return deepest
