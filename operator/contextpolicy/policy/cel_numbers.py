"""Numbers as expressions see them: real numbers, however a sensor or a policy spelled them.

CEL keeps integers and doubles apart and converts neither. Here each number has one form that depends on its value
alone, so no expression distinguishes `1` from `1.0`: a double, except integers from 2^53 up to 64 bits (stamps in
nanoseconds, identifiers), which doubles can't hold. The library compares them correctly: two integers exactly, and
next to a double it rounds the integer to one, which leaves it at 2^53 or more, above every smaller double.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

EXACT = 1 << 53
"""A double holds every integer below it, and no larger one is rounded to one of them."""
_LEAST, _MOST = -(1 << 63), (1 << 64) - 1

Number = int | float


class Normal:
    """Brings samples into the one form; `whole` says whether an integer was found that is not a double."""

    __slots__ = ("whole",)

    def __init__(self) -> None:
        self.whole = False

    def value(self, value: Any) -> Any:
        """A sample or a part of it; anything but a number stays as it is."""
        kind = type(value)
        if kind is float and -EXACT < value < EXACT:
            return value
        if kind is int or kind is float:
            number = normal(value)
            self.whole = self.whole or type(number) is int
            return number
        # Nearly all that a sample holds are plain doubles: they pass without a function call.
        if kind is dict:
            return {n: v if type(v) is float and -EXACT < v < EXACT else self.value(v) for n, v in value.items()}
        if kind is list:
            return [v if type(v) is float and -EXACT < v < EXACT else self.value(v) for v in value]
        return value


def normal(number: Number) -> Number:
    """The one form of a number; OverflowError where it is larger than any double."""
    if -EXACT < number < EXACT:
        return float(number)
    if isinstance(number, int):
        return number if _LEAST <= number <= _MOST else float(number)
    return int(number) if _LEAST <= number <= _MOST else number


def literal(number: Number) -> str:
    """A number >= 0 as a CEL literal."""
    return f"{number}u" if isinstance(number, int) and number >= 1 << 63 else repr(number)


def key(value: Any) -> Any:
    """An index or a map's key: a whole double as the integer that CEL requires, anything else as it is."""
    return int(value) if isinstance(value, float) and value.is_integer() and _LEAST <= value <= _MOST else value


def add(left: Any, right: Any) -> Any:
    """Add numbers, or join what CEL joins with `+`; TypeError for a mix."""
    if _are_numbers(left, right):
        first, second = _exact(left, right)
        return normal(first + second)
    return _joined(left, right, "+", lambda: left + right)


def subtract(left: Any, right: Any) -> Any:
    """Subtract numbers, or times and durations; TypeError for a mix."""
    if _are_numbers(left, right):
        first, second = _exact(left, right)
        return normal(first - second)
    return _joined(left, right, "-", lambda: left - right)


def multiply(left: Any, right: Any) -> Any:
    """Multiply numbers; TypeError for anything else."""
    _check(left, right, "*")
    first, second = _exact(left, right)
    return normal(first * second)


def divide(left: Any, right: Any) -> Any:
    """Divide as doubles do: by zero gives infinity, and 0 / 0 gives NaN; TypeError for anything but numbers."""
    _check(left, right, "/")
    if right == 0:
        return left * math.copysign(math.inf, right)
    first, second = _exact(left, right)
    whole = isinstance(first, int) and isinstance(second, int) and first % second == 0
    return normal(first // second if whole else first / second)


def remainder(left: Any, right: Any) -> Number:
    """The remainder, with the sign of `left` as in C; TypeError unless both are integers."""
    _check(left, right, "%")
    whole, divisor = _whole(left), _whole(right)
    if divisor == 0:
        raise ZeroDivisionError("% by zero")
    return normal(int(math.copysign(1, whole)) * (abs(whole) % abs(divisor)))


def negate(value: Any) -> Number:
    """A number with the other sign."""
    _check(value, 0, "-")
    return normal(-value)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "__key": key,
    "__add": add,
    "__subtract": subtract,
    "__multiply": multiply,
    "__divide": divide,
    "__remainder": remainder,
    "__negate": negate,
}
"""What `cel_rewriting` writes in place of operators."""


def _exact(left: Number, right: Number) -> tuple[Number, Number]:
    """Operands of one type stay; next to an integer a double becomes one, too, if it can."""
    return (left, right) if type(left) is type(right) else (key(left), key(right))


def _are_numbers(left: Any, right: Any) -> bool:
    return type(left) in (int, float) and type(right) in (int, float)


def _check(left: Any, right: Any, operator: str) -> None:
    if not _are_numbers(left, right):
        raise TypeError(f"{left!r} {operator} {right!r}; expected numbers")


def _whole(number: Number) -> int:
    if isinstance(number, float) and not number.is_integer():
        raise TypeError(f"{number!r} is an operand of %; expected integers")
    return int(number)


def _joined(left: Any, right: Any, operator: str, join: Callable[[], Any]) -> Any:
    if isinstance(left, bool | int | float) or isinstance(right, bool | int | float):
        raise TypeError(f"{left!r} {operator} {right!r}; expected two numbers, two strings or two lists")
    return join()
