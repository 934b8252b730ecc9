"""CEL expressions on live streams: evaluated when what they read has changed; failures are reported, not raised."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from contextpolicy.errors import ExpressionError, UndecidedError
from contextpolicy.policy.cel import Expression

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.cel_rewriting import Age

Value = TypeVar("Value")

_NUMERAL = re.compile(r"(?<![\w.])[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?")
MAX_NUMERALS = 16
"""Numerals of an expression that are tried in place of NaN: each costs evaluations."""


class ExpressionListener(Protocol):
    """Receives failures and recoveries of expressions, and readers that must evaluate again as time has passed."""

    def on_expression_error(self, source: str, reason: str) -> None:
        """The expression failed on this sample."""

    def on_expression_recovery(self, source: str) -> None:
        """The expression evaluates again after a failure."""

    def on_elapsed(self, reader: Reader) -> None:
        """A time that the reader waited for is over."""


class Reader(Protocol):
    """Something that evaluates expressions."""

    def on_value(self, now: float, *, sampled: bool = False) -> None:
        """Evaluate again: what they read may have changed."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """An expression can't be decided: `stream` has no value, or lacks a feature; `since` is when that began."""

    stream: str
    reason: str
    since: float


class Guarded:
    """An expression that reports failures to its listener instead of raising them: bad samples happen.

    A stream without a value is not a failure: CEL decides without it where it can, else `waiting` says so.
    It is evaluated again only once something that it reads has changed; a failure is tried again with each sample.
    """

    def __init__(self, expression: Expression, scope: Scope, listener: ExpressionListener) -> None:
        self.expression = expression
        self.waiting: Waiting | None = None
        self.changed = True
        """Whether what it reads may have changed since it was last evaluated."""
        self._scope, self._listener = scope, listener
        self._known: Any = None
        self._failing = False
        scope.watch(self, expression)

    def truth(self, now: float) -> bool:
        """False when the condition has no value."""
        return self._value(self._truth_despite_nan, now) or False

    def number(self, now: float) -> float:
        """0 when the expression has no number."""
        return self._value(self.expression.number, now) or 0.0

    def probe(self, part: str, now: float) -> Any:
        """The value of a part of the source, for people to read; ExpressionError when it has none."""
        self._scope.instant.now = now
        return _part(part).evaluate(self._scope)

    def adopt(self, old: Guarded) -> None:
        """Continue to wait as the same expression of the policy's previous version does."""
        self.waiting = old.waiting

    def _value(self, read: Callable[[Scope], Value], now: float) -> Value | None:
        if not self.changed:
            return self._known  # type: ignore[no-any-return]
        self._scope.instant.now = now
        try:
            value = read(self._scope)
        except UndecidedError as error:
            value = None
            if self.waiting is None or self.waiting.stream != error.stream:
                self.waiting = Waiting(error.stream, self._reason(error), now)
        except ExpressionError as error:
            self._failing, self.waiting = True, None
            self._listener.on_expression_error(self.expression.source, self._reason(error))
            return None
        else:
            self.waiting = None
        if self._failing:
            self._failing = False
            self._listener.on_expression_recovery(self.expression.source)
        self._known, self.changed = value, bool(self.expression.ages)
        return value

    def _truth_despite_nan(self, scope: Scope) -> bool:
        """Whether the condition holds whatever number stands for each NaN: a comparison with NaN can't be decided.

        The CEL library can't compare NaN, so one missing beam of a laser scanner would fail every condition on it.
        """
        streams = self.expression.variables
        try:
            return self.expression.truth(scope)
        except UndecidedError:
            raise
        except ExpressionError:
            if not scope.holds_nan(streams):
                raise
        return scope.holds_for_each(_stand_ins(self.expression.source), streams, self.expression.truth)

    def _reason(self, error: ExpressionError) -> str:
        return str(error).removeprefix(f"{self.expression.source}: ")


class Ageing:
    """Wakes a reader when a stream reaches an age that its expressions compare with, so that nothing polls."""

    def __init__(
        self, ages: Collection[Age], scope: Scope, timers: Timers, reader: Reader, listener: ExpressionListener
    ) -> None:
        self._ages, self._scope, self._timers = ages, scope, timers
        self._reader, self._listener = reader, listener

    def arm(self, now: float) -> None:
        """Wait for the next such moment after `now`."""
        due = self._scope.next_age(self._ages, now)
        if due is None:
            self._timers.clear(self)
        else:
            self._timers.set(self, due)

    def on_due(self, now: float) -> None:  # noqa: ARG002 - the timer's signature
        """The age is reached."""
        self._listener.on_elapsed(self._reader)


@lru_cache(maxsize=1024)
def _stand_ins(source: str) -> tuple[float, ...]:
    """Numbers between which a threshold of the source lies: both infinities, its numerals, and halfway between them."""
    numerals = [float(text) for text in _NUMERAL.findall(source)[:MAX_NUMERALS]]
    finite = sorted({0.0}.union(*({-number, number} for number in numerals if math.isfinite(number))))
    between = [low + (high - low) / 2 for low, high in pairwise(finite)]
    return math.inf, *sorted((*finite, *between), reverse=True), -math.inf


@lru_cache(maxsize=1024)
def _part(source: str) -> Expression:
    """Cached, so that explanations do not keep samples waiting for the compiler."""
    return Expression(source)
