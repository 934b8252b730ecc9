"""What a row of the table in `cel_functions` says: the kinds of values, what a call costs, how it is written."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, StrEnum, auto
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


class ValueKind(StrEnum):
    """What a value is, in the words of error messages."""

    ANY = "anything"
    BOOL = "true or false"
    NUMBER = "a number"
    WHOLE = "an integer"
    """A result that the library keeps apart from doubles and does not add to them."""
    DOUBLE = "a double"
    TEXT = "a string"
    PATTERN = "a regular expression"
    """A string that stands in the expression itself."""
    BYTES = "bytes"
    NULL = "null"
    TIME = "a time"
    DURATION = "a duration"
    LIST = "a list"
    MAP = "a map"
    STREAM = "a stream"
    """Its name alone: the function asks about the stream and reads nothing of its samples."""


class CallCost(Enum):
    """What a call does with arguments of n values."""

    ASK = auto()
    """Nothing."""
    WALK = auto()
    """It looks at all of them, for a result of one value."""
    COPY = auto()
    """It looks at all of them, for a result that may be as large."""


class CallForm(Enum):
    """How a call is written: `double(x)`, `x.contains(y)`, or either way."""

    CALL = auto()
    METHOD = auto()
    EITHER = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Function:
    """One row of the table."""

    name: str
    takes: tuple[tuple[ValueKind, ...], ...]
    """The kinds that each argument may be of, a method's receiver first."""
    variadic: bool = False
    """Whether more arguments like the last may follow."""
    returns: ValueKind
    """NUMBER, unlike WHOLE and DOUBLE, is whichever of the two its arguments are."""
    cost: CallCost = CallCost.WALK
    form: CallForm = CallForm.EITHER
    reserved: bool = True
    """Whether no stream may have its name."""
    meaning: str
    """What it returns, as the manual says after the example."""
    example: str
    constant: str = ""
    """A call on a string that has a value, for one that has none; empty where each text has one."""
    run: Callable[..., Any] | None = None
    """What computes it, in the library's place; None for what the library or `cel_rewriting` does."""

    def kinds(self, count: int) -> tuple[tuple[ValueKind, ...], ...] | None:
        """The kinds that each of `count` arguments may be of; None where it takes more or fewer."""
        more = count - len(self.takes)
        return None if more < 0 or (more and not self.variadic) else self.takes + self.takes[-1:] * more
