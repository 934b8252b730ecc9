"""What conditions may be together: every case that their comparisons with constants tell apart.

A case gives each operand a value: a number or a string below, at, between or above the constants that it is compared
with, or none, as a stream may have. Operands are taken for independent. So what holds in no case never holds, and
what holds in each case surely does; the opposite is not certain.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import groupby, pairwise, product
from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.policy.cel_syntax import Construct, Node
from contextpolicy.policy.validation.intervals import Interval, bounded, range_of
from contextpolicy.policy.validation.unknowns import (
    COMPARISONS,
    asks_for_field,
    comparison_of,
    compiled,
    is_logic,
    lacks,
    unknown_of,
    unknowns_in,
    unknowns_of,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.policy.validation.unknowns import Comparison, Constant, Unknown, Value

MOST = 5_000
"""Cases that are looked at; of conditions with more nothing is known."""

Truth: TypeAlias = bool | None
"""None is an unknown one: of a stream without a value."""
Case: TypeAlias = "Mapping[Unknown, Value]"

_UNLIKE = {"==": False, "!=": True}
_NOT_MORE: Sequence[Value] = (True, False, None)


def of_sample(stream: str) -> dict[Unknown, Sequence[Value]]:
    """What a sample that has just come says of its stream: it has a value, and that is new."""
    return {("heard", stream): (True,), ("age", stream): (0.0,)}


class Cases:
    """All cases of some conditions; `known` says what the values of some unknowns can only be.

    `ranges` has those of numbers by what is bounded. `given` are conditions without which no sample counts: they hold
    of whatever they read, unless that has no value.
    """

    def __init__(
        self,
        *sources: str,
        known: Mapping[Unknown, Sequence[Value]] | None = None,
        ranges: Mapping[tuple[str, ...], Interval] | None = None,
        given: Sequence[str] = (),
    ) -> None:
        known, read = known or {}, unknowns_of(*sources).keys()
        self._given = [one for one in given if not read.isdisjoint(unknowns_of(one))]
        values = _values_in(*sources, *self._given)
        self.values = {one: known.get(one) or _ranged(one, own, ranges or {}) for one, own in values.items()}
        """All that matter of each unknown."""
        self._needing = {one: needing for one in values if (needing := _needing(one, values))}

    @property
    def known(self) -> bool:
        """Whether they are few enough to look at."""
        return math.prod(map(len, self.values.values())) <= MOST

    def __iter__(self) -> Iterator[Case]:
        return (case for case in every(self.values) if self.possible(case))

    def possible(self, case: Case) -> bool:
        """Whether what is given allows it, and nothing has a value that reads what is missing."""
        if any(not _absent(own, case[own]) for own in self._missing(case)):
            return False
        return all(holds(one, case) or all(_absent(own, case[own]) for own in unknowns_of(one)) for one in self._given)

    def complete(self, case: Case) -> bool:
        """Whether all values are there but for those that read what is missing."""
        missing = set(self._missing(case))
        return all(value is not None or own in missing for own, value in case.items())

    def _missing(self, case: Case) -> Iterator[Unknown]:
        """The operands without a value, as the case says of what they read that it is not there."""
        return (own for asked, needing in self._needing.items() if case[asked] is False for own in needing)


def every(values: Mapping[Unknown, Sequence[Value]]) -> Iterator[Case]:
    """Each combination of the values."""
    for one in product(*values.values()):
        yield dict(zip(values, one, strict=True))


def holds(source: str, case: Case) -> bool:
    """Whether a condition surely holds in a case of it."""
    return _condition(source)(case) is True


def possible_truths(node: Node, narrow: Callable[[Unknown, Sequence[Value]], Sequence[Value]]) -> set[Truth]:
    """What a condition may come to, where `narrow` says what of the values of each unknown is possible."""
    values = {own: narrow(own, _values(own, found)) for own, found in unknowns_in(node).items()}
    truth, few = _truth(node), math.prod(map(len, values.values())) <= MOST
    return {truth(case) for case in every(values)} if few else {True, False, None}


def measured(source: str) -> Iterator[Node]:
    """The operands that a condition holds against a number by less or more."""
    for (_, operand), compared in unknowns_of(source).items():
        limits = [limit for sign, limit in compared if sign not in _UNLIKE]
        if isinstance(operand, Node) and any(not isinstance(limit, str) for limit in limits):
            yield operand


def never_hold(*sources: str, given: Sequence[str] = ()) -> bool:
    """Whether conditions certainly never hold at once."""
    cases = Cases(*sources, given=given)
    return cases.known and not any(all(holds(source, case) for source in sources) for case in cases)


def implies(first: str, second: str, given: Sequence[str] = ()) -> bool:
    """Whether the second certainly holds whenever the first does."""
    cases = Cases(first, second, given=given)
    return cases.known and all(holds(second, case) for case in cases if holds(first, case))


def _needing(asked: Unknown, unknowns: Iterable[Unknown]) -> Sequence[Unknown]:
    """Those that have no value where the stream or the field is missing that is asked for."""
    path = _asked_for(asked)
    return [one for one in unknowns if one != asked and _reads(one, path)] if path else ()


def _asked_for(unknown: Unknown) -> tuple[str, ...] | None:
    kind, what = unknown
    if kind == "heard":
        return (str(what),)
    return what.parts[0].path() if isinstance(what, Node) and asks_for_field(what) else None


def _reads(unknown: Unknown, path: tuple[str, ...]) -> bool:
    what = unknown[1]
    if not isinstance(what, Node):
        return False
    return any(lacks(part, {path}) for part in (what.parts if asks_for_field(what) else (what,)))


def _absent(unknown: Unknown, value: Value) -> bool:
    """Whether an operand may have this value while its stream has none."""
    asks = isinstance(unknown[1], Node) and asks_for_field(unknown[1])
    return value is None or (asks and value is False)


def _ranged(unknown: Unknown, values: Sequence[Value], ranges: Mapping[tuple[str, ...], Interval]) -> Sequence[Value]:
    own = ranges.get(bounded(unknown[1])) if ranges and isinstance(unknown[1], Node) else None
    return own.within(values) if own else values


@lru_cache(maxsize=4096)
def _values_in(*sources: str) -> Mapping[Unknown, Sequence[Value]]:
    return {own: _allowed(own, _values(own, found)) for own, found in unknowns_of(*sources).items()}


def _allowed(unknown: Unknown, values: Sequence[Value]) -> Sequence[Value]:
    """Those that an age, or what a function returns, may have."""
    own = Interval() if unknown[0] == "age" else range_of(unknown[1]) if isinstance(unknown[1], Node) else None
    return own.within(values) if own else values


def _values(unknown: Unknown, comparisons: Iterable[Comparison]) -> Sequence[Value]:
    """All that matter of one unknown: any comparison has the same outcome for those left out."""
    match unknown[0]:
        case "context" | "heard":
            return True, False
        case "truth":
            return _NOT_MORE
    constants = {constant for _, constant in comparisons}
    numbers = sorted(one for one in constants if not isinstance(one, str))
    between = [low + (high - low) / 2 for low, high in pairwise(numbers)]
    around = [-math.inf, math.inf] if numbers else []
    texts = {text for one in constants if isinstance(one, str) for text in ("", one, _next(one))}

    def outcome(value: Value) -> Sequence[Truth]:
        return [_comparison(value, sign, constant) for sign, constant in comparisons]

    alike = [list(own) for _, own in groupby(sorted({*numbers, *between, *around}), key=outcome)]
    distinct = {tuple(outcome(text)): text for text in sorted(texts, reverse=True)}
    absent = () if unknown[0] == "age" else (None,)
    return *(next(filter(math.isfinite, own), own[0]) for own in alike), *distinct.values(), *absent


def _next(text: str) -> str:
    """The least of all texts above this one: it is below any other that is."""
    return text + "\0"


@lru_cache(maxsize=1024)
def _condition(source: str) -> Callable[[Case], Truth]:
    return _truth(compiled(source).tree)


def _truth(node: Node) -> Callable[[Case], Truth]:
    """What a condition comes to in a case: found once, as cases are many."""
    compared = comparison_of(node)
    if compared is not None:
        unknown, sign, constant = compared
        return lambda case: _comparison(case[unknown], sign, constant)
    if node.kind is Construct.CONSTANT:
        always = {"true": True, "false": False}.get(node.text)
        return lambda _: always
    if not is_logic(node):
        asked = unknown_of(node)
        return lambda case: value if isinstance(value := case[asked], bool) else None
    parts = [_truth(part) for part in node.parts]
    return _not(parts[0]) if node.text == "!" else _row(parts, decides=node.text == "||")


def _not(part: Callable[[Case], Truth]) -> Callable[[Case], Truth]:
    return lambda case: None if (truth := part(case)) is None else not truth


def _row(parts: Sequence[Callable[[Case], Truth]], *, decides: bool) -> Callable[[Case], Truth]:
    def truth(case: Case) -> Truth:
        last: Truth = not decides
        for part in parts:
            own = part(case)
            if own is decides:
                return decides
            last = None if own is None else last
        return last

    return truth


def _comparison(value: Value, sign: str, constant: Constant) -> Truth:
    """A number and a string are unequal, and neither is less: CEL fails to order them."""
    if value is None:
        return None
    if isinstance(value, str) is not isinstance(constant, str):
        return _UNLIKE.get(sign)
    return COMPARISONS[sign](value, constant)
