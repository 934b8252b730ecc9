"""The functions that expressions may call, in one table: checks, costs, rewriting, runtime and manual read it.

To add one, write its row in `OWN` and the Python function that it runs; `make crds` then writes the manual.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Self

from contextpolicy.policy.cel_kinds import CallCost, CallForm, Function, ValueKind
from contextpolicy.policy.context_reads import CONTEXTS

if TYPE_CHECKING:
    from collections.abc import Sequence

KEYWORDS = (
    *("true", "false", "null", "in", "as", "break", "const", "continue", "else", "for", "function", "if", "import"),
    *("let", "loop", "package", "namespace", "return", "var", "void", "while"),
)
"""CEL's own words."""


class Macro(StrEnum):
    """CEL's loops over a list or a map, such as `scan.ranges.exists(r, r < 0.5)`."""

    meaning: str

    def __new__(cls, name: str, meaning: str) -> Self:
        """A loop's name, with what it returns."""
        macro = str.__new__(cls, name)
        macro._value_, macro.meaning = name, meaning
        return macro

    ALL = "all", "whether the condition holds for each item, or for each key of a map"
    EXISTS = "exists", "whether it holds for any"
    EXISTS_ONE = "exists_one", "whether it holds for exactly one"
    EXISTS_ONE_CAMEL = "existsOne", "the same as exists_one"
    MAP = "map", "a list of what the expression gives for each"
    FILTER = "filter", "a list of those for which the condition holds"

    @property
    def example(self) -> str:
        """A call over a list of a sample."""
        return f"imu.gyro.{self}(g, g > 0.5)"


def norm(vector: Sequence[float] | dict[str, float]) -> float:
    """Euclidean length of a list, or of a map's values (ROS vectors are {x, y, z})."""
    values = vector.values() if isinstance(vector, dict) else vector
    try:
        return math.hypot(*values)
    except TypeError as error:
        raise TypeError(f"of {vector!r}; expected a list or a map of numbers") from error


def least(*values: Any) -> Any:
    """The least of several numbers or of a list; NaN if one is, whatever the order."""
    numbers = _numbers(values)
    found = min(numbers)
    return found if all(map(_is_known, numbers)) else math.nan


def greatest(*values: Any) -> Any:
    """The greatest of several numbers or of a list; NaN if one is, whatever the order."""
    numbers = _numbers(values)
    found = max(numbers)
    return found if all(map(_is_known, numbers)) else math.nan


def _numbers(values: Sequence[Any]) -> Sequence[Any]:
    numbers = values[0] if len(values) == 1 else values
    if isinstance(numbers, list | tuple) and numbers:
        return numbers
    raise ValueError(f"of {numbers!r}; expected at least one number")


def _is_known(number: object) -> bool:
    return number == number  # noqa: PLR0124 - only NaN differs from itself


def root(number: float) -> float:
    """The square root of a number of 0 or more; NaN has NaN."""
    if number < 0:
        raise ValueError(f"of {number!r}; expected a number of 0 or more")
    return math.sqrt(number)


def size(value: str | bytes | Sequence[object] | dict[str, object]) -> int:
    """Code points of a string, as CEL counts them, where the library counts bytes; else bytes, items or entries."""
    try:
        return len(value)
    except TypeError as error:
        raise TypeError(f"size of {value!r}; expected a string, bytes, a list or a map") from error


HEARD = Function(
    name="heard",
    takes=((ValueKind.STREAM,),),
    returns=ValueKind.BOOL,
    cost=CallCost.ASK,
    form=CallForm.CALL,
    meaning="whether the stream has a value",
    example="heard(imu)",
)
AGE = Function(
    name="age",
    takes=((ValueKind.STREAM,),),
    returns=ValueKind.DOUBLE,
    cost=CallCost.ASK,
    form=CallForm.CALL,
    meaning="whether its last value came more than 2.5 s ago, or it never had one",
    example="age(imu) > 2.5",
)
OWN = (
    Function(
        name="norm",
        takes=((ValueKind.LIST, ValueKind.MAP),),
        returns=ValueKind.DOUBLE,
        meaning="the length of a vector, given as a list or as a map such as {x, y, z}",
        example="norm(imu.gyro)",
        run=norm,
    ),
    Function(
        name="abs",
        takes=((ValueKind.NUMBER,),),
        returns=ValueKind.NUMBER,
        meaning="the absolute value",
        example="abs(imu.speed)",
        run=abs,
    ),
    Function(
        name="min",
        takes=((ValueKind.NUMBER, ValueKind.LIST),),
        variadic=True,
        returns=ValueKind.NUMBER,
        cost=CallCost.COPY,
        meaning="the smallest of several numbers or of a list",
        example="min(imu.speed, 2.0)",
        run=least,
    ),
    Function(
        name="max",
        takes=((ValueKind.NUMBER, ValueKind.LIST),),
        variadic=True,
        returns=ValueKind.NUMBER,
        cost=CallCost.COPY,
        meaning="the largest of several numbers or of a list",
        example="max(imu.gyro)",
        run=greatest,
    ),
    Function(
        name="sqrt",
        takes=((ValueKind.NUMBER,),),
        returns=ValueKind.DOUBLE,
        meaning="the square root",
        example="sqrt(imu.speed)",
        run=root,
    ),
    HEARD,
    AGE,
)
"""What CEL does not have."""

HAS = Function(
    name="has",
    takes=((ValueKind.ANY,),),
    returns=ValueKind.BOOL,
    form=CallForm.CALL,
    meaning="whether the sample has the field",
    example="has(imu.speed)",
)
_SIZE = Function(
    name="size",
    takes=((ValueKind.TEXT, ValueKind.BYTES, ValueKind.LIST, ValueKind.MAP),),
    returns=ValueKind.WHOLE,
    meaning="how many characters (code points), bytes, items or entries",
    example="imu.gyro.size()",
    run=size,
)
_PRINTED = (ValueKind.NUMBER, ValueKind.TEXT, ValueKind.BYTES, ValueKind.TIME, ValueKind.DURATION)


def _conversion(
    name: str, returns: ValueKind, meaning: str, *takes: ValueKind, of: str = "imu.speed", text: str = ""
) -> Function:
    return Function(
        name=name,
        takes=(takes,),
        returns=returns,
        cost=CallCost.COPY if returns in {ValueKind.TEXT, ValueKind.BYTES, ValueKind.ANY} else CallCost.WALK,
        form=CallForm.CALL,
        reserved=False,
        meaning=meaning,
        example=f"{name}({of})",
        constant=f"{name}('{text}')" if text else "",
    )


def _on_text(name: str, meaning: str, text: str, argument: ValueKind = ValueKind.TEXT) -> Function:
    return Function(
        name=name,
        takes=((ValueKind.TEXT,), (argument,)),
        returns=ValueKind.BOOL,
        form=CallForm.METHOD,
        meaning=meaning,
        example=f"imu.frame.{name}('{text}')",
    )


def _calendar(name: str, meaning: str, *also: ValueKind) -> Function:
    return Function(
        name=name,
        takes=((ValueKind.TIME, *also),),
        returns=ValueKind.WHOLE,
        form=CallForm.METHOD,
        meaning=meaning,
        example=f"timestamp(imu.time).{name}()",
    )


LIBRARY = (
    HAS,
    _SIZE,
    _on_text("contains", "whether the string contains the other; for a list, write x in list", "link"),
    _on_text("startsWith", "whether it starts with the other", "imu"),
    _on_text("endsWith", "whether it ends with the other", "link"),
    _on_text("matches", "whether the pattern matches anywhere in it", "^imu_", ValueKind.PATTERN),
    _conversion("int", ValueKind.WHOLE, "the number, truncated", ValueKind.NUMBER, ValueKind.TEXT, text="12"),
    _conversion("uint", ValueKind.WHOLE, "the same for numbers from 0 up", ValueKind.NUMBER, ValueKind.TEXT, text="12"),
    _conversion(
        "double",
        ValueKind.DOUBLE,
        "the number, or the one that a string spells",
        ValueKind.NUMBER,
        ValueKind.TEXT,
        text="1.5",
    ),
    _conversion("string", ValueKind.TEXT, "the value as a string", *_PRINTED),
    _conversion("bytes", ValueKind.BYTES, "the string in UTF-8", ValueKind.TEXT, ValueKind.BYTES, of="imu.frame"),
    _conversion(
        "timestamp",
        ValueKind.TIME,
        "the time (RFC 3339)",
        ValueKind.TEXT,
        ValueKind.TIME,
        of="imu.time",
        text="2026-11-21T12:00:00Z",
    ),
    _conversion(
        "duration", ValueKind.DURATION, "the duration", ValueKind.TEXT, ValueKind.DURATION, of="'1m30s'", text="1m30s"
    ),
    _conversion("type", ValueKind.ANY, "the value's type", ValueKind.ANY),
    _conversion("dyn", ValueKind.ANY, "the value itself", ValueKind.ANY),
    _calendar("getFullYear", "the year, in UTC like all that follow"),
    _calendar("getMonth", "the month, from 0"),
    _calendar("getDate", "the day of the month, from 1"),
    _calendar("getDayOfMonth", "the day of the month, from 0"),
    _calendar("getDayOfWeek", "the day of the week, from 0 for Sunday"),
    _calendar("getDayOfYear", "the day of the year, from 0"),
    _calendar("getHours", "the hour, or all hours of a duration", ValueKind.DURATION),
    _calendar("getMinutes", "the minute, or all minutes of a duration", ValueKind.DURATION),
    _calendar("getSeconds", "the second, or all seconds of a duration", ValueKind.DURATION),
    _calendar("getMilliseconds", "the millisecond, or all milliseconds of a duration", ValueKind.DURATION),
)
"""What the CEL library computes itself."""

FUNCTIONS = {function.name: function for function in (*LIBRARY, *OWN)}
MACROS = frozenset(Macro)
NAMES = FUNCTIONS.keys() | MACROS
"""All that can be called."""
INSTEAD = {function.name: f"__{function.name}" for function in LIBRARY if function.run is not None}
"""What the library computes otherwise than CEL: expressions call ours, by a name that it doesn't know."""
RUN = {INSTEAD.get(one.name, one.name): one.run for one in FUNCTIONS.values() if one.run is not None}
"""What the library is to call."""
RESERVED = (
    *KEYWORDS,
    CONTEXTS,
    *sorted(one.name for one in FUNCTIONS.values() if one.reserved and one.form is not CallForm.METHOD),
)
"""What no stream may be called: people could not distinguish them."""
