"""CEL expressions on live streams: the variables that they see, and failures that are reported, not raised."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import cel

from contextpolicy.errors import ExpressionError, UndecidedError
from contextpolicy.policy import cel_cost, cel_numbers
from contextpolicy.policy.cel import FUNCTIONS, Expression
from contextpolicy.policy.cel_rewriting import HEARD, PASSED, REACHED, SINCE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping

    from contextpolicy.planning.timers import Timers
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
    """

    def __init__(self, expression: Expression, scope: Scope, listener: ExpressionListener) -> None:
        self.expression = expression
        self.waiting: Waiting | None = None
        self._scope, self._listener = scope, listener
        self._failing = False

    def truth(self, now: float) -> bool:
        """False when the condition has no value."""
        return self._try(self._truth_despite_nan, now) or False

    def number(self, now: float) -> float:
        """0 when the expression has no number."""
        return self._try(self.expression.number, now) or 0.0

    def probe(self, part: str, now: float) -> Any:
        """The value of a part of the source, for people to read; ExpressionError when it has none."""
        self._scope.now = now
        return _part(part).evaluate(self._scope)

    def adopt(self, old: Guarded) -> None:
        """Continue to wait as the same expression of the policy's previous version does."""
        self.waiting = old.waiting

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

    def _try(self, read: Callable[[Scope], Value], now: float) -> Value | None:
        self._scope.now = now
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
        return value

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


class Scope:
    """The variables that expressions see: what they read of the latest sample of each stream.

    Only that is handed to CEL: converting a whole ROS message costs more than all evaluations on it. A stream without
    a value is no variable: CEL's own rules then decide, so `a.x || b.y` holds when one side does.
    """

    __slots__ = ("_aged", "_asked", "_lacking", "_normal", "_reads", "_since", "_values", "context", "now", "whole")

    def __init__(self) -> None:
        self.now = -math.inf
        self.whole: set[str] = set()
        self._normal = cel_numbers.Normal()
        self._reads: dict[str, dict[str, Any]] = {}
        self._values: dict[str, object] = {}
        self._lacking: dict[str, Collection[str]] = {}
        self._since: dict[str, float] = {}
        self._asked: set[str] = set()
        self._aged: set[str] = set()
        self.context = self._context()

    def compile(self, source: str) -> Expression:
        """An expression to be evaluated in this scope; ValueError says what is wrong with the source."""
        expression = Expression(source)
        for path in expression.reads:
            _grow(self._reads, path)
        self._aged |= {age.stream for age in expression.ages}
        for stream in expression.asked - self._asked:
            self._asked.add(stream)
            self.context.add_variable(HEARD + stream, stream in self._values)
        return expression

    def bind(self, stream: str, value: dict[str, Any], now: float = 0.0, lacking: Collection[str] = ()) -> None:
        """Make `value` the stream's latest sample as of `now`; ExpressionError when CEL can't represent it.

        `lacking` are its features that have no value.
        """
        reads = self._reads.get(stream)
        if reads is None and stream not in self._asked and stream not in self._aged:
            return
        normal = self._normal
        normal.whole = False
        try:
            part = {} if reads is None else normal.value(_prune(value, reads))
            if reads is not None:
                self.context.add_variable(stream, part)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise ExpressionError(f"{stream}: {error}") from error
        if stream in self._asked and stream not in self._values:
            self.context.add_variable(HEARD + stream, True)  # noqa: FBT003 - the library's signature
        if stream in self._aged:
            self._since[stream] = now
            self.context.add_variable(SINCE + stream, now)
        self._values[stream], self._lacking[stream] = part, lacking
        if normal.whole:
            self.whole.add(stream)
        elif self.whole:
            self.whole.discard(stream)

    def unbind(self, stream: str) -> None:
        """The stream has no value any more."""
        if self._values.pop(stream, None) is not None:
            self.whole.discard(stream)
            self.context = self._context()

    def size(self, stream: str) -> int:
        """How many values expressions see of the stream."""
        return cel_cost.size(self._values.get(stream))

    def lacks(self, stream: str, feature: str) -> bool:
        """Whether the stream has this feature, but its window holds no sample."""
        return feature in self._lacking.get(stream, ())

    def next_age(self, ages: Iterable[Age], now: float) -> float | None:
        """When one of these ages is reached or passed next."""
        moments = []
        for age in ages:
            if age.stream in self._since:
                reached = self._since[age.stream] + age.seconds
                # `>` turns true just after the instant that `>=` does.
                moments.append(math.nextafter(reached, math.inf) if age.passed else reached)
        return min((moment for moment in moments if moment > now), default=None)

    def _context(self) -> cel.Context:
        """A new context with all that expressions see: the library can't remove a variable from one."""
        asking = {REACHED: self._reached, PASSED: self._passed}
        variables = dict(self._values)
        variables |= {HEARD + stream: stream in self._values for stream in self._asked}
        variables |= {SINCE + stream: since for stream, since in self._since.items()}
        return cel.Context(variables, FUNCTIONS | cel_numbers.FUNCTIONS | asking)

    def _reached(self, since: float, seconds: float) -> bool:
        return since + seconds <= self.now

    def _passed(self, since: float, seconds: float) -> bool:
        return since + seconds < self.now

    def holds_nan(self, streams: Iterable[str]) -> bool:
        """Whether expressions see a NaN in any of these streams."""
        return any(_holds_nan(self._values.get(stream)) for stream in streams)

    def at_extremes(self, streams: Iterable[str], read: Callable[[Scope], Value]) -> list[Value]:
        """What `read` returns with -inf, then with +inf, in place of each NaN; puts the NaNs back afterwards."""
        values = {stream: self._values[stream] for stream in streams if stream in self._values}
        try:
            return [read(self._with(values, number)) for number in (-math.inf, math.inf)]
        finally:
            for stream, value in values.items():
                self.context.add_variable(stream, value)

    def _with(self, values: Mapping[str, object], number: float) -> Scope:
        for stream, value in values.items():
            self.context.add_variable(stream, _without_nan(value, number))
        return self


def _holds_nan(value: object) -> bool:
    match value:
        case float():
            return math.isnan(value)
        case dict():
            return any(map(_holds_nan, value.values()))
        case list():
            return any(map(_holds_nan, value))
    return False


def _without_nan(value: Any, number: float) -> Any:
    match value:
        case float():
            return number if math.isnan(value) else value
        case dict():
            return {name: _without_nan(inner, number) for name, inner in value.items()}
        case list():
            return [_without_nan(inner, number) for inner in value]
    return value


@lru_cache(maxsize=1024)
def _part(source: str) -> Expression:
    """Cached, so that explanations do not keep samples waiting for the compiler."""
    return Expression(source)


def _grow(reads: dict[str, dict[str, Any]], path: cel_cost.Path) -> None:
    """Add a path to a tree; an empty branch means all below it."""
    whole = False
    for name in path:
        if whole:
            return
        known = name in reads
        reads = reads.setdefault(name, {})
        whole = known and not reads
    reads.clear()


def _prune(value: Any, reads: dict[str, dict[str, Any]]) -> Any:
    """The part of a sample that the tree names; anything but a map is kept, so that CEL can say what is wrong."""
    if not reads or not isinstance(value, dict):
        return value
    return {
        name: _prune(value[name], below) if below else value[name] for name, below in reads.items() if name in value
    }
