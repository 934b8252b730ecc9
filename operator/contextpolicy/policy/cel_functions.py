"""The functions that expressions may call, in one table: checks, costs, rewriting, runtime and manual read it.

To add one, write its row in `OWN` and the Python function that it runs; `make crds` then writes the manual.
"""

from __future__ import annotations

import math
from enum import StrEnum
from typing import TYPE_CHECKING

from contextpolicy.policy.cel_kinds import CallCost, CallForm, Function, ValueKind

if TYPE_CHECKING:
    from collections.abc import Sequence

KEYWORDS = (
    *("true", "false", "null", "in", "as", "break", "const", "continue", "else", "for", "function", "if", "import"),
    *("let", "loop", "package", "namespace", "return", "var", "void", "while"),
)
"""CEL's own words."""


class Macro(StrEnum):
    """CEL's loops over a list or a map, such as `scan.ranges.exists(r, r < 0.5)`."""

    ALL = "all"
    EXISTS = "exists"
    EXISTS_ONE = "exists_one"
    EXISTS_ONE_CAMEL = "existsOne"
    MAP = "map"
    FILTER = "filter"


def norm(vector: Sequence[float] | dict[str, float]) -> float:
    """Euclidean length of a list, or of a map's values (ROS vectors are {x, y, z})."""
    values = vector.values() if isinstance(vector, dict) else vector
    return math.hypot(*values)


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
    meaning="whether it got its last value more than 2.5 s ago, also while it is silent",
    example="age(imu) > 2.5",
)
OWN = (
    Function(
        name="norm",
        takes=((ValueKind.LIST, ValueKind.MAP),),
        returns=ValueKind.DOUBLE,
        meaning="the length of a vector, written as a list or as a map like {x, y, z}",
        example="norm(imu.gyro)",
        run=norm,
    ),
    Function(
        name="abs",
        takes=((ValueKind.NUMBER,),),
        returns=ValueKind.NUMBER,
        meaning="a number without its sign",
        example="abs(imu.speed)",
        run=abs,
    ),
    Function(
        name="min",
        takes=((ValueKind.NUMBER, ValueKind.LIST),),
        variadic=True,
        returns=ValueKind.NUMBER,
        cost=CallCost.COPY,
        meaning="the least of several numbers or of a list",
        example="min(imu.speed, 2.0)",
        run=min,
    ),
    Function(
        name="max",
        takes=((ValueKind.NUMBER, ValueKind.LIST),),
        variadic=True,
        returns=ValueKind.NUMBER,
        cost=CallCost.COPY,
        meaning="the greatest of several numbers or of a list",
        example="max(imu.gyro)",
        run=max,
    ),
    Function(
        name="sqrt",
        takes=((ValueKind.NUMBER,),),
        returns=ValueKind.DOUBLE,
        meaning="the square root",
        example="sqrt(imu.speed)",
        run=math.sqrt,
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
    meaning="how many characters, bytes, items or entries",
    example="imu.gyro.size()",
)
_PRINTED = (ValueKind.NUMBER, ValueKind.TEXT, ValueKind.BYTES, ValueKind.TIME, ValueKind.DURATION)


def _conversion(name: str, returns: ValueKind, meaning: str, *takes: ValueKind, of: str = "imu.speed") -> Function:
    return Function(
        name=name,
        takes=(takes,),
        returns=returns,
        cost=CallCost.COPY if returns in {ValueKind.TEXT, ValueKind.BYTES, ValueKind.ANY} else CallCost.WALK,
        form=CallForm.CALL,
        reserved=False,
        meaning=meaning,
        example=f"{name}({of})",
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
    _on_text("contains", "whether the text has the other in it", "link"),
    _on_text("startsWith", "whether it begins with the other", "imu"),
    _on_text("endsWith", "whether it ends with the other", "link"),
    _on_text("matches", "whether the pattern is found in it", "^imu_", ValueKind.PATTERN),
    _conversion("int", ValueKind.WHOLE, "the number without its fraction", ValueKind.NUMBER, ValueKind.TEXT),
    _conversion("uint", ValueKind.WHOLE, "the same for numbers of 0 and more", ValueKind.NUMBER, ValueKind.TEXT),
    _conversion("double", ValueKind.DOUBLE, "the number that a text spells", ValueKind.NUMBER, ValueKind.TEXT),
    _conversion("string", ValueKind.TEXT, "the value as a text", *_PRINTED),
    _conversion("bytes", ValueKind.BYTES, "the text in UTF-8", ValueKind.TEXT, ValueKind.BYTES, of="imu.frame"),
    _conversion("timestamp", ValueKind.TIME, "the time (RFC 3339)", ValueKind.TEXT, ValueKind.TIME, of="imu.time"),
    _conversion("duration", ValueKind.DURATION, "the duration", ValueKind.TEXT, ValueKind.DURATION, of="'1m30s'"),
    _conversion("type", ValueKind.ANY, "the value's type", ValueKind.ANY),
    _conversion("dyn", ValueKind.ANY, "the value itself", ValueKind.ANY),
    _calendar("getFullYear", "the year, in UTC as all that follow"),
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
RUN = {function.name: function.run for function in OWN if function.run is not None}
"""What the library is to call."""
RESERVED = (
    *KEYWORDS,
    *sorted(one.name for one in FUNCTIONS.values() if one.reserved and one.form is not CallForm.METHOD),
)
"""What no stream may be called: people could not tell them apart."""
