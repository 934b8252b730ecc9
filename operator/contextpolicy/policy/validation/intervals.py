"""Which numbers functions and windows can be at all."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, TypeGuard

from contextpolicy.policy.cel_functions import Macro
from contextpolicy.policy.cel_syntax import Construct
from contextpolicy.policy.stream_spec import MAX_SAMPLES, FeatureOp

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from contextpolicy.policy.cel_syntax import Node
    from contextpolicy.policy.stream_spec import Feature, Stream


class Interval(NamedTuple):
    """Numbers from `low` to `high`; only whole ones if `whole`."""

    low: float = 0.0
    high: float = math.inf
    whole: bool = False

    def within(self, values: Sequence[float | str | None]) -> Sequence[float | str | None]:
        """Those of some values that it allows, and enough other numbers to stand for all of it."""
        numbers = [one for one in values if _is_number(one)]
        others = [one for one in values if not _is_number(one)]
        inside = {self.low, self.high, *(own for one in numbers for own in self._like(one))} if numbers else ()
        return *sorted(one for one in inside if self.low <= one <= self.high), *others

    def _like(self, number: float) -> Iterator[float]:
        if not self.whole or math.isinf(number):
            yield number
        else:
            yield from (math.floor(number), math.ceil(number))


_SIZE_OF = "size"
_NO_LONGER = frozenset({Macro.FILTER, Macro.MAP})
_NOT_NEGATIVE, _SIZE = Interval(), Interval(whole=True)
_FUNCTIONS = {
    **dict.fromkeys(("abs", "norm", "sqrt", "age"), _NOT_NEGATIVE),
    **dict.fromkeys((_SIZE_OF, "uint"), _SIZE),
    "getMonth": Interval(0, 11, whole=True),
    "getDate": Interval(1, 31, whole=True),
    "getDayOfMonth": Interval(0, 30, whole=True),
    "getDayOfWeek": Interval(0, 6, whole=True),
    "getDayOfYear": Interval(0, 365, whole=True),
}
_OF_A_TIME = {
    "getHours": Interval(0, 23, whole=True),
    "getMinutes": Interval(0, 59, whole=True),
    "getSeconds": Interval(0, 59, whole=True),
    "getMilliseconds": Interval(0, 999, whole=True),
}
"""Of a duration they are all its hours."""


def range_of(node: Node) -> Interval | None:
    """What a call can return; None for what may be any number."""
    if node.kind not in {Construct.CALL, Construct.METHOD}:
        return None
    of_a_time = node.kind is Construct.METHOD and node.parts[0].text == "timestamp"
    return _FUNCTIONS.get(node.text) or (_OF_A_TIME.get(node.text) if of_a_time else None)


def bounded(node: Node) -> tuple[str, ...]:
    """The path of an operand, or, of the size of a list, that of the list and `size`; filtered, it is no longer."""
    if node.text != _SIZE_OF or node.kind not in {Construct.CALL, Construct.METHOD}:
        return node.path() or ()
    over = node.parts[0]
    while over.kind is Construct.METHOD and over.text in _NO_LONGER:
        over = over.parts[0]
    return (*(over.path() or ()), _SIZE_OF)


def windows(stream: Stream, *, least: int = 0) -> Iterator[tuple[tuple[str, ...], Interval]]:
    """What a stream's windows that count samples can be, with at least so many, and the number of its sources."""
    if stream.sources:
        yield (stream.name, "sources", _SIZE_OF), Interval(0, stream.sources, whole=True)
    for feature in stream.features:
        if feature.op in {FeatureOp.COUNT, FeatureOp.RATE}:
            counted = Interval(least, _most(stream, feature), whole=True)
            per_second = Interval(counted.low / feature.over, counted.high / feature.over)
            yield (stream.name, feature.name), counted if feature.op is FeatureOp.COUNT else per_second


def _most(stream: Stream, feature: Feature) -> float:
    """How many samples a window holds at most."""
    apart = max(stream.sample_every, stream.debounce)
    return min(MAX_SAMPLES, feature.over // apart + 1) if apart else MAX_SAMPLES


def _is_number(value: object) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)
