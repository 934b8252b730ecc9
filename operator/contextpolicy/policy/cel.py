"""CEL over streams: compiled once, checked for names and cost, evaluated on samples (about 1 us each). No state."""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Any, Protocol

import cel

from contextpolicy.errors import ExpressionError
from contextpolicy.policy import cel_syntax

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

MAX_LENGTH = 1024

# The library logs each failing function besides raising it: one line per bad sample, at the sensor's rate.
logging.getLogger("cel").setLevel(logging.CRITICAL)


def norm(vector: Sequence[float] | dict[str, float]) -> float:
    """Euclidean length of a list, or of a map's values (ROS vectors are {x, y, z})."""
    values = vector.values() if isinstance(vector, dict) else vector
    return math.hypot(*values)


_BUILT_IN = {
    *("size", "contains", "startsWith", "endsWith", "matches", "has", "type", "dyn"),
    *("int", "uint", "double", "string", "bytes", "timestamp", "duration"),
    *cel_syntax.MACROS,
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


class Bindings(Protocol):
    """The variables that an expression is evaluated on."""

    context: cel.Context

    def size(self, stream: str) -> int:
        """How many values expressions see of the stream."""


class Expression:
    """A compiled CEL expression with the variables it reads and the functions that nobody defines."""

    __slots__ = ("_max_size", "_program", "reads", "source", "unknown_functions", "variables")

    def __init__(self, source: str) -> None:
        """Compile; ValueError says what is wrong with the source."""
        if len(source) > MAX_LENGTH:
            raise ValueError(f"has {len(source)} characters, allowed: {MAX_LENGTH}")
        self.source = source
        self._program = cel.compile(source)
        scanned = cel_syntax.scan(source)
        self.reads, self.variables, self._max_size = scanned.reads, scanned.streams, scanned.max_size
        self.unknown_functions = {name for name in self._program.functions() if name[0].isalpha()} - (
            _BUILT_IN | FUNCTIONS.keys()
        )

    def evaluate(self, scope: Bindings) -> Any:
        """The value on the scope's latest samples; ExpressionError when it has none."""
        if self._max_size is not None:
            self._check_size(scope, self._max_size)
        try:
            return self._program.execute(scope.context)
        except KeyError as error:
            raise ExpressionError(f"{self.source}: the sample has no field {error}") from error
        except (ValueError, TypeError, RuntimeError, ArithmeticError, LookupError) as error:
            raise ExpressionError(f"{self.source}: {error}") from error

    def truth(self, scope: Bindings) -> bool:
        """A condition's value; ExpressionError when it is not a boolean."""
        value = self.evaluate(scope)
        if not isinstance(value, bool):
            raise ExpressionError(f"{self.source}: is {value!r}, allowed: true or false")
        return value

    def number(self, scope: Bindings) -> float:
        """A finite number; ExpressionError for anything else, infinities and NaN too."""
        value = self.evaluate(scope)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ExpressionError(f"{self.source}: is {value!r}, allowed: a finite number")
        return float(value)

    def _check_size(self, scope: Bindings, allowed: int) -> None:
        size = sum(scope.size(name) for name in self.variables)
        if size > allowed:
            raise ExpressionError(f"{self.source}: reads {size} values, allowed for what it does with them: {allowed}")
