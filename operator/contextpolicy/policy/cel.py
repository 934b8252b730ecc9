"""CEL over streams: compiled once, checked for names and cost, evaluated on samples (about 1 us each). No state."""

from __future__ import annotations

import logging
import math
import re
from typing import TYPE_CHECKING, Any, Protocol
from weakref import WeakValueDictionary

from contextpolicy.errors import ExpressionError, UndecidedError
from contextpolicy.policy import cel_cost, cel_syntax
from contextpolicy.policy.cel_functions import NAMES
from contextpolicy.policy.cel_rewriting import SINCE, rewrite
from contextpolicy.policy.lean_cel import cel

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_LENGTH = 1024
EXACT_COST = 4
"""How much less an expression may read if each step calls our arithmetic: lists are converted for the call."""

# The library logs each failing function besides raising it: one line per bad sample, at the sensor's rate.
logging.getLogger("cel").setLevel(logging.CRITICAL)


_UNDEFINED = re.compile(r"Undefined variable or function: '(\w+)'")
_CALL_FAILED = re.compile(r"Function '(\w+)' error: Python function call failed: \w+: (.*)\. Check function arguments")


def _compile(rewritten: str) -> cel.Program:
    try:
        return cel.compile(rewritten)
    except ValueError as error:  # the source itself compiles: only the depth can be too much
        raise ValueError("nests operands too deeply") from error


def _check_characters(source: str) -> None:
    """What can't be seen would be shown to people in logs and terminals, where it may move the cursor or hide text."""
    for at, character in enumerate(source):
        if not (character.isprintable() or character in "\n\t"):
            raise ValueError(
                f"has the invisible character U+{ord(character):04X} at character {at + 1}; "
                f"in a string, write \\u{ord(character):04x}"
            )


class Bindings(Protocol):
    """The variables that an expression is evaluated on."""

    context: cel.Context
    whole: set[str]
    """The streams that hold an integer that is not a double."""

    def size(self, stream: str) -> int:
        """How many values expressions see of the stream."""

    def copied(self, paths: Mapping[tuple[str, ...], int]) -> int:
        """How many values the library copies if it reads the list or map at each of these paths so many times."""

    def lacks(self, stream: str, feature: str) -> bool:
        """Whether the stream has this feature, but its window holds no sample."""


class Expression:
    """A compiled CEL expression with the variables that it reads and the undefined functions that it calls.

    `reads` are the paths that it reads from samples, `asked` the streams that it tests for a value, and `ages` the ages
    at which its value may change without a sample. `contexts` are the contexts that it reads.
    """

    __slots__ = (
        *("_bound", "_exact", "_fast", "_is_bounded", "_repeated", "_step"),
        *("ages", "asked", "contexts", "presence", "reads", "source", "tree", "unknown_functions", "variables"),
        "__weakref__",
    )

    def __init__(self, source: str) -> None:
        """Compile; ValueError says what is wrong with the source."""
        if len(source) > MAX_LENGTH:
            raise ValueError(f"has {len(source)} characters, expected at most {MAX_LENGTH}")
        _check_characters(source)
        self.source = source
        named = {name for name in cel.compile(source).functions() if name[0].isalpha()}
        self.tree = cel_syntax.parse(source)
        reading, written = cel_cost.read(self.tree), rewrite(self.tree)
        self.reads, self.presence, self.variables = reading.reads, reading.presence, reading.streams
        self.contexts = reading.contexts
        self.ages, self.asked = written.ages, written.asked
        self._bound, self._repeated = reading.bound, reading.repeated
        self._is_bounded = reading.bound.most() is not None
        self._step = EXACT_COST if "__add(" in written.fast else 1
        self._exact = _compile(written.exact)
        self._fast = self._exact if written.fast == written.exact else _compile(written.fast)
        self.unknown_functions = named - NAMES

    def evaluate(self, scope: Bindings) -> Any:
        """The value on the scope's latest samples; ExpressionError when it has none.

        It is an UndecidedError when the reason is a stream without a value, or a feature of one.
        """
        exact = scope.whole and not scope.whole.isdisjoint(self.variables)
        if self._is_bounded:
            self._check_size(scope, self._step * EXACT_COST if exact else self._step)
        try:
            return (self._exact if exact else self._fast).execute(scope.context)
        except KeyError as error:
            name = str(error.args[0]) if error.args else ""
            for stream in self.variables:
                if scope.lacks(stream, name):
                    raise UndecidedError(self.source, stream, f"{stream}.{name} has no sample in its window") from error
            raise ExpressionError(f"{self.source}: the sample has no field {error}") from error
        except (ValueError, TypeError, RuntimeError, ArithmeticError, LookupError) as error:
            raise self._failure(str(error)) from error

    def truth(self, scope: Bindings) -> bool:
        """A condition's value; ExpressionError when it is not a boolean."""
        value = self.evaluate(scope)
        if not isinstance(value, bool):
            raise ExpressionError(f"{self.source}: is {value!r}, expected true or false")
        return value

    def number(self, scope: Bindings) -> float:
        """A finite number; ExpressionError for anything else, infinities and NaN too."""
        value = self.evaluate(scope)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ExpressionError(f"{self.source}: is {value!r}, expected a finite number")
        return float(value)

    def _failure(self, reason: str) -> ExpressionError:
        # The library names a missing variable, or a failing function, nowhere but in its message.
        undefined = _UNDEFINED.match(reason)
        stream = undefined[1].removeprefix(SINCE) if undefined else ""
        if stream in self.variables:
            return UndecidedError(self.source, stream, f"{stream} has no value")
        failed = _CALL_FAILED.match(reason)
        if failed:
            called = "" if failed[1].startswith("__") else f"{failed[1]}: "
            reason = called + failed[2]
        return ExpressionError(f"{self.source}: {reason}")

    def reading(self, scope: Bindings) -> float:
        """Any number, infinities and NaN too, as sensors send them; ExpressionError for anything else."""
        value = self.evaluate(scope)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ExpressionError(f"{self.source}: is {value!r}, expected a number")
        return float(value)

    def _check_size(self, scope: Bindings, step: int) -> None:
        size = sum(scope.size(name) for name in self.variables)
        allowed = (self._bound.most(scope.copied(self._repeated)) or 0) // step
        if size > allowed:
            raise ExpressionError(f"{self.source}: reads {size} values: expected at most {allowed}, given its cost")


_SHARED: WeakValueDictionary[str, Expression] = WeakValueDictionary()


def shared(source: str) -> Expression:
    """The expression of a source: one that is in use already, as it has no state, or else a new one.

    Compiling 1000 characters takes 10 ms. The policy's loader does that on its thread and keeps them, so that the loop
    does not have to. References are weak, so that expressions of policies that are gone are freed.
    """
    found = _SHARED.get(source)
    if found is None:
        found = _SHARED[source] = Expression(source)
    return found
