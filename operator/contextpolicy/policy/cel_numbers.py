"""Numbers as expressions see them: real numbers, however a sensor or a policy spelled them.

CEL keeps whole numbers and doubles apart and converts neither. Here each number has one form that depends on its value
alone, so no expression can tell `1` from `1.0`: a double, except whole numbers from 2^53 up to 64 bits (stamps in
nanoseconds, identifiers), which doubles have no room for. The library compares them rightly: two whole numbers exactly,
and rounding one to a double, as it does beside a double, leaves it at 2^53 or more, above every double that stays one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

EXACT = 1 << 53
"""Below it a double holds every whole number, and no other whole number is rounded to one of them."""
_LEAST, _MOST = -(1 << 63), (1 << 64) - 1

Number = int | float


class Normal:
    """Brings samples into the one form; `whole` says whether a whole number was left that is no double."""

    __slots__ = ("whole",)

    def __init__(self) -> None:
        self.whole = False

    def value(self, value: Any) -> Any:
        """A sample or a part of it; what is no number stays."""
        kind = type(value)
        if kind is float and -EXACT < value < EXACT:
            return value
        if kind is int or kind is float:
            number = normal(value)
            self.whole = self.whole or type(number) is int
            return number
        # Nearly all that a sample holds are plain doubles: they are passed without a call.
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
    """A number above or equal to 0 as CEL writes it."""
    return f"{number}u" if isinstance(number, int) and number >= 1 << 63 else repr(number)


def key(value: Any) -> Any:
    """An index or a map's key: a whole number as CEL wants it there, anything else as it is."""
    return int(value) if isinstance(value, float) and value.is_integer() and _LEAST <= value <= _MOST else value


def add(left: Any, right: Any) -> Any:
    """Numbers, or what CEL joins with `+`."""
    if _are_numbers(left, right):
        first, second = _exact(left, right)
        return normal(first + second)
    return _joined(left, right, "+", lambda: left + right)


def subtract(left: Any, right: Any) -> Any:
    """Numbers, or times and durations."""
    if _are_numbers(left, right):
        first, second = _exact(left, right)
        return normal(first - second)
    return _joined(left, right, "-", lambda: left - right)


def multiply(left: Any, right: Any) -> Any:
    """Numbers only."""
    _check(left, right, "*")
    first, second = _exact(left, right)
    return normal(first * second)


def divide(left: Any, right: Any) -> Any:
    """As doubles are divided: by zero it is an infinity, and 0 / 0 is no number."""
    _check(left, right, "/")
    if right == 0:
        return left * math.copysign(math.inf, right)
    first, second = _exact(left, right)
    whole = isinstance(first, int) and isinstance(second, int) and first % second == 0
    return normal(first // second if whole else first / second)


def remainder(left: Any, right: Any) -> Number:
    """With the sign of `left`, as in C; whole numbers only."""
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
"""What `cel_rewriting` writes in the place of operators."""


def _exact(left: Number, right: Number) -> tuple[Number, Number]:
    """Two doubles stay doubles; beside a whole number that is none, a double joins in as a whole number if it can."""
    return (left, right) if type(left) is type(right) else (key(left), key(right))


def _are_numbers(left: Any, right: Any) -> bool:
    return type(left) in (int, float) and type(right) in (int, float)


def _check(left: Any, right: Any, operator: str) -> None:
    if not _are_numbers(left, right):
        raise TypeError(f"{left!r} {operator} {right!r}, allowed: numbers")


def _whole(number: Number) -> int:
    if isinstance(number, float) and not number.is_integer():
        raise TypeError(f"{number!r} is an operand of %, allowed: whole numbers")
    return int(number)


def _joined(left: Any, right: Any, operator: str, join: Callable[[], Any]) -> Any:
    if isinstance(left, bool | int | float) or isinstance(right, bool | int | float):
        raise TypeError(f"{left!r} {operator} {right!r}, allowed: two numbers, two texts or two lists")
    return join()
