"""CEL expressions on live streams: evaluated when what they read has changed; failures are reported, not raised."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

from contextpolicy.errors import ExpressionError, UndecidedError
from contextpolicy.policy.cel import Expression

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from contextpolicy.planning.conditions.scope import Scope
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.cel_rewriting import Age

Value = TypeVar("Value")


class ExpressionListener(Protocol):
    """Hears which expressions fail and recover."""

    def on_expression_error(self, source: str, reason: str) -> None:
        """The expression failed on this sample."""

    def on_expression_recovery(self, source: str) -> None:
        """The expression evaluates again after a failure."""


class Reader(Protocol):
    """Something that evaluates expressions."""

    def on_value(self, now: float) -> None:
        """Evaluate again: what they read may have changed."""


@dataclass(frozen=True, slots=True)
class Waiting:
    """An expression can't be decided: `stream` has no value, or lacks a feature; `since` is when that began."""

    stream: str
    reason: str
    since: float


class Guarded:
    """An expression that reports failures to its listener instead of raising them: bad samples happen.

    A stream without a value is no failure: CEL decides without it where it can, and where it can't, `waiting` says so.
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
        scope.watch(self, expression.variables)

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
        """Whether the condition holds whatever number stands for each NaN; tried with -inf and +inf.

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
        return all(scope.at_extremes(streams, self.expression.truth))

    def _reason(self, error: ExpressionError) -> str:
        return str(error).removeprefix(f"{self.expression.source}: ")


class Ageing:
    """Wakes a reader when a stream reaches an age that its expressions compare with, so that nothing polls."""

    def __init__(self, ages: Collection[Age], scope: Scope, timers: Timers, reader: Reader) -> None:
        self._ages, self._scope, self._timers, self._reader = ages, scope, timers, reader

    def arm(self, now: float) -> None:
        """Wait for the next such moment after `now`."""
        due = self._scope.next_age(self._ages, now)
        if due is None:
            self._timers.clear(self)
        else:
            self._timers.set(self, due)

    def on_due(self, now: float) -> None:
        """The age is reached."""
        self._reader.on_value(now)


@lru_cache(maxsize=1024)
def _part(source: str) -> Expression:
    """Cached, so that explanations do not keep samples waiting for the compiler."""
    return Expression(source)
