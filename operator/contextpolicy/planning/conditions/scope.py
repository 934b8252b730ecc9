"""What CEL expressions see: the variables, brought up to date with each sample."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.errors import ExpressionError
from contextpolicy.planning.conditions.unknown_numbers import MAX_TRIALS, MAX_TRIED, nans, trials, without_nan
from contextpolicy.policy import cel_cost, cel_numbers, context_reads
from contextpolicy.policy.cel import shared
from contextpolicy.policy.cel_functions import RUN
from contextpolicy.policy.cel_rewriting import HEARD, PASSED, REACHED, SINCE
from contextpolicy.policy.lean_cel import cel

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.policy.cel import Expression
    from contextpolicy.policy.cel_rewriting import Age


class Watcher(Protocol):
    """Something whose value depends on what expressions see."""

    changed: bool
    """Set to true when that has changed."""


class Instant:
    """When expressions are evaluated, and what they ask about it.

    Apart from the scope: the CEL library does not let Python see what its contexts refer to, so a scope to which its
    own context refers would never be freed.
    """

    __slots__ = ("now",)

    def __init__(self) -> None:
        self.now = -math.inf

    def reached(self, since: float, seconds: float) -> bool:
        """Whether something that began at `since` is `seconds` old."""
        return since + seconds <= self.now

    def passed(self, since: float, seconds: float) -> bool:
        """Whether it is older."""
        return since + seconds < self.now


class Scope:
    """The variables that expressions see: what they read of the latest sample of each stream.

    Only that is handed to CEL: converting a whole ROS message costs more than all evaluations on it. A stream without
    a value is not a variable: CEL's own rules then decide, so `a.x || b.y` holds when one side does.
    """

    __slots__ = (
        *("_aged", "_asked", "_lacking", "_normal", "_parts", "_reads", "_since", "_values", "_watchers"),
        *("active", "context", "instant", "turned_by_sample", "whole"),
    )

    def __init__(self) -> None:
        self.instant = Instant()
        self.whole: set[str] = set()
        self._normal = cel_numbers.Normal()
        self._reads: dict[str, dict[str, Any]] = {}
        self._parts: dict[str, object] = {}
        self._values: dict[str, object] = {}
        """The same parts as CEL sees them: with numbers in their one form."""
        self._watchers: dict[str, list[Watcher]] = defaultdict(list)
        self._lacking: dict[str, Collection[str]] = {}
        self._since: dict[str, float] = {}
        """When each stream whose age is asked for got its value; minus infinity before the first."""
        self._asked: set[str] = set()
        self._aged: set[str] = set()
        self.active: dict[str, bool] = {}
        """The contexts that expressions read, each with whether it is active."""
        self.turned_by_sample: set[str] = set()
        """Those of them that a sample made begin or cease to be active the last time that they did."""
        self.context = self._context()

    def compile(self, source: str) -> Expression:
        """An expression to be evaluated in this scope; ValueError says what is wrong with the source."""
        expression = shared(source)
        for path in expression.reads:
            _grow(self._reads, path)
        for stream in {age.stream for age in expression.ages} - self._aged:
            self._aged.add(stream)
            self._since.setdefault(stream, -math.inf)
            self.context.add_variable(SINCE + stream, self._since[stream])
        for stream in expression.asked - self._asked:
            self._asked.add(stream)
            self.context.add_variable(HEARD + stream, stream in self._values)
        for name in expression.contexts - self.active.keys():
            self.show_context(name, active=False)
        return expression

    def watch(self, watcher: Watcher, expression: Expression) -> None:
        """Notify an expression when what it sees of a stream or a context changes."""
        for name in (*expression.variables, *map(context_reads.variable, expression.contexts)):
            self._watchers[name].append(watcher)

    def show_context(self, name: str, *, active: bool, by_sample: bool = False) -> None:
        """Show expressions whether a context is active, and readers whether a sample made it so."""
        self.active[name] = active
        (self.turned_by_sample.add if by_sample else self.turned_by_sample.discard)(name)
        variable = context_reads.variable(name)
        self.context.add_variable(variable, active)
        self._tell(variable)

    def bind(self, stream: str, value: dict[str, Any], now: float = 0.0, lacking: Collection[str] = ()) -> None:
        """Make `value` the stream's latest sample as of `now`; ExpressionError when CEL can't represent it.

        `lacking` are its features that have no value.
        """
        reads = self._reads.get(stream)
        if reads is None and stream not in self._asked and stream not in self._aged:
            return
        part = {} if reads is None else _prune(value, reads)
        # Converting a sample for CEL costs more than all else that is done with it.
        if stream not in self._values or lacking != self._lacking[stream] or not is_same(part, self._parts[stream]):
            self._show(stream, part)
            self._parts[stream], self._lacking[stream] = part, lacking
        if stream in self._aged:
            self._since[stream] = now
            self.context.add_variable(SINCE + stream, now)

    def _show(self, stream: str, part: object) -> None:
        normal = self._normal
        normal.whole = False
        try:
            value = normal.value(part)
            if stream in self._reads:
                self.context.add_variable(stream, value)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            raise ExpressionError(f"{stream}: {error}") from error
        if stream in self._asked and stream not in self._values:
            self.context.add_variable(HEARD + stream, True)  # noqa: FBT003 - the library's signature
        self._values[stream] = value
        if normal.whole:
            self.whole.add(stream)
        elif self.whole:
            self.whole.discard(stream)
        self._tell(stream)

    def unbind(self, stream: str) -> None:
        """The stream has no value any more."""
        if self._values.pop(stream, None) is not None:
            self.whole.discard(stream)
            self.context = self._context()
            self._tell(stream)

    def _tell(self, stream: str) -> None:
        for watcher in self._watchers[stream]:
            watcher.changed = True

    def size(self, stream: str) -> int:
        """How many values expressions see of the stream."""
        return cel_cost.size(self._values.get(stream))

    def copied(self, paths: Mapping[tuple[str, ...], int]) -> int:
        """How many values the library copies if it reads the list or map at each of these paths so many times."""
        return sum(times * self._inside(path) for path, times in paths.items())

    def _inside(self, path: tuple[str, ...]) -> int:
        found = self._values.get(path[0])
        for name in path[1:]:
            found = found.get(name) if isinstance(found, dict) else None
        return cel_cost.size(found) if isinstance(found, dict | list) else 0

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
        asking = {REACHED: self.instant.reached, PASSED: self.instant.passed}
        variables = dict(self._values)
        variables |= {HEARD + stream: stream in self._values for stream in self._asked}
        variables |= {SINCE + stream: since for stream, since in self._since.items()}
        variables |= {context_reads.variable(name): active for name, active in self.active.items()}
        return cel.Context(variables, RUN | cel_numbers.FUNCTIONS | asking)

    def holds_nan(self, streams: Iterable[str]) -> bool:
        """Whether expressions see a NaN in any of these streams."""
        return any(nans(self._values.get(stream)) for stream in streams)

    def holds_for_each(self, numbers: Sequence[float], streams: Iterable[str], holds: Callable[[Scope], bool]) -> bool:
        """Whether it holds whichever of the numbers each NaN is; puts the NaNs back afterwards."""
        values = {stream: self._values[stream] for stream in streams if stream in self._values}
        unknown, size = sum(map(nans, values.values())), sum(map(cel_cost.size, values.values()))
        allowed = 4 * MAX_TRIED // len(numbers)
        if size > allowed:
            raise ExpressionError(
                f"reads a NaN among {size} values: expected at most {allowed}, given the numbers it compares them with"
            )
        most = min(MAX_TRIALS, 1 + MAX_TRIED // size)
        try:
            return all(holds(self._with(values, trial)) for trial in trials(numbers, unknown, most))
        finally:
            for stream, value in values.items():
                self.context.add_variable(stream, value)

    def _with(self, values: Mapping[str, object], trial: Iterator[float]) -> Scope:
        for stream, value in values.items():
            self.context.add_variable(stream, without_nan(value, trial))
        return self


def is_same(value: Any, other: Any) -> bool:
    """Whether expressions can't tell two parts of samples apart: `True` equals 1 in Python, and -0.0 equals 0.0."""
    if value is other:
        return True
    kind = type(value)
    if kind is not type(other) or value != other:
        return False
    if kind is float:
        return value != 0 or math.copysign(1, value) == math.copysign(1, other)
    if kind is list:
        return all(map(is_same, value, other))
    return kind is not dict or all(is_same(inner, other[name]) for name, inner in value.items())


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
