"""What expressions see of streams of which no sample comes any more, or none ever came."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeGuard

from contextpolicy.policy import cel_cost
from contextpolicy.policy.cel_syntax import Construct, Node
from contextpolicy.policy.stream_spec import FeatureOp
from contextpolicy.policy.validation.cases import Cases, possible_truths
from contextpolicy.policy.validation.unknowns import asks_for_field, compiled, constant, lacks

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.policy.spec import Context, Policy
    from contextpolicy.policy.stream_spec import Stream
    from contextpolicy.policy.validation.unknowns import Unknown, Value

_COUNTING = {FeatureOp.COUNT, FeatureOp.RATE}


def fallbacks(policy: Policy) -> set[str | None]:
    """The contexts that some stream's silence begins."""
    return {one.fallback or policy.fallback for one in policy.streams if one.stale_after or one.liveliness}


def steered(policy: Policy) -> set[str | None]:
    """The contexts that hold by more than their own condition."""
    return fallbacks(policy) | ({policy.force.context} if policy.force else set())


def contexts_behind(policy: Policy, *sources: str) -> frozenset[str]:
    """The contexts that conditions read, themselves or through others."""
    contexts = {context.name: context for context in policy.contexts}
    found, further = set[str](), set[str]().union(*(compiled(source).contexts for source in sources))
    while further:
        found |= further
        read = [source for name in further for source in _conditions(contexts[name])]
        further = set[str]().union(*(compiled(source).contexts for source in read)) - found
    return frozenset(found)


def streams_behind(policy: Policy, *sources: str) -> frozenset[str]:
    """The streams that conditions read, themselves or through contexts."""
    behind = contexts_behind(policy, *sources)
    further = [source for one in policy.contexts if one.name in behind for source in _conditions(one)]
    return frozenset[str]().union(*(compiled(source).variables for source in (*sources, *further)))


def _conditions(context: Context) -> Sequence[str]:
    return [source for source in (context.when, context.until) if source]


def filters(policy: Policy) -> tuple[str, ...]:
    """What surely holds of each sample that counts, in terms that conditions use: a feature hides a field."""
    return tuple(one.filter for one in policy.streams if one.filter and not _hidden(one, one.filter))


def _hidden(stream: Stream, source: str) -> bool:
    added = {feature.name for feature in stream.features}
    return bool(added or stream.sources) and any(len(path) == 1 or path[1] in added for path in compiled(source).reads)


def lasting(policy: Policy) -> frozenset[str]:
    """The streams that, once heard, always have a value."""
    return frozenset(one.name for one in policy.streams if one.stale_after is None and not one.liveliness)


@dataclass(frozen=True)
class Silence:
    """Streams of which no sample comes, and what is known of contexts meanwhile.

    `lost` streams have no value: they were never heard, or are stale. `kept` ones keep their last one.
    """

    policy: Policy
    lost: frozenset[str] = frozenset()
    kept: frozenset[str] = frozenset()
    contexts: Mapping[str, bool] = field(default_factory=dict)

    @property
    def streams(self) -> frozenset[str]:
        """All of them."""
        return self.lost | self.kept

    @cached_property
    def given(self) -> Sequence[str]:
        """What holds of the samples that count."""
        return filters(self.policy)

    def behind(self, *sources: str) -> Silence:
        """What of it conditions see."""
        streams, contexts = streams_behind(self.policy, *sources), contexts_behind(self.policy, *sources)
        known = {name: holds for name, holds in self.contexts.items() if name in contexts}
        return replace(self, lost=self.lost & streams, kept=self.kept & streams, contexts=known)

    def known(self, *sources: str) -> dict[Unknown, Sequence[Value]]:
        """What the operands of conditions are in the long run."""
        values = Cases(*sources, given=self.given).values
        return {one: self.settled(one, own) for one, own in values.items()}

    def settled(self, unknown: Unknown, values: Sequence[Value]) -> Sequence[Value]:
        """What an operand is in the long run: an age is infinite, a window empty."""
        kind, what = unknown
        if not isinstance(what, Node):
            return self._settled(kind, str(what), values)
        if asks_for_field(what):
            return (False,) if any(map(self.lacks, what.parts)) else values
        what = self.chosen(what)
        plain = constant(what)
        if plain is not None:
            return (plain,)
        if self.lacks(what):
            return (None,)
        op = self._feature(what)
        return values if op is None else (0.0,) if op in _COUNTING else (None,)

    def stands(self, unknown: Unknown) -> bool:
        """Whether only the silence itself can change an operand."""
        kind, what = unknown
        if not isinstance(what, Node):
            return kind != "context" and what in self.streams
        read = cel_cost.read(what)
        moves = read.presence or read.contexts or (self._reads_feature(read) and self._feature(what) is None)
        return bool(read.streams) and read.streams <= self.streams and not moves

    def after(self, unknown: Unknown, now: Value, values: Sequence[Value]) -> Sequence[Value]:
        """What an operand that stands may be from now on."""
        settled = self.settled(unknown, values)
        if unknown[0] == "age":
            return [one for one in values if _is_number(one) and _is_number(now) and one >= now]
        op = self._feature(unknown[1]) if isinstance(unknown[1], Node) else None
        if op is not None:
            return self._emptying(op, now, (*values, *settled))
        # What needs no value of a lost stream may still depend on whether it has one.
        return settled if settled != values or self._reads_lost(unknown[1]) else (now,)

    def _reads_lost(self, what: object) -> bool:
        return isinstance(what, Node) and not self.lost.isdisjoint(cel_cost.read(what).streams)

    def _emptying(self, op: FeatureOp, now: Value, values: Sequence[Value]) -> Sequence[Value]:
        """What a feature may be from now on: of an emptying window the least only rises, the greatest only falls."""
        if not _is_number(now):
            return (now,)
        numbers = [one for one in values if _is_number(one)]
        match op:
            case FeatureOp.COUNT | FeatureOp.RATE:
                return [one for one in numbers if 0 <= one <= now]
            case FeatureOp.MIN:
                return [*(one for one in numbers if one >= now), None]
            case FeatureOp.MAX:
                return [*(one for one in numbers if one <= now), None]
            case _:
                return [*numbers, None]

    def lacks(self, node: Node) -> bool:
        """Whether the value of a lost stream is needed for that of the node."""
        return lacks(node, {(name,) for name in self.lost}, self.chosen)

    def chosen(self, node: Node) -> Node:
        """What a choice comes to where its condition is known; any other node as it is."""
        if node.kind is not Construct.CHOICE:
            return node
        condition, yes, no = node.parts
        truths = possible_truths(condition, self.settled)
        return self.chosen(yes) if truths == {True} else self.chosen(no) if truths == {False} else node

    def _settled(self, kind: str, name: str, values: Sequence[Value]) -> Sequence[Value]:
        match kind:
            case "context":
                return (self.contexts[name],) if name in self.contexts else values
            case "heard":
                return (False,) if name in self.lost else values
            case _:
                return (math.inf,) if name in self.streams else values

    def _feature(self, node: Node) -> FeatureOp | None:
        """What a silent stream's feature computes; None for any other node."""
        return dict(self._features()).get(node.path() or ())

    def _reads_feature(self, read: cel_cost.Reading) -> bool:
        return any(path[:2] == feature for path in read.reads for feature, _ in self._features())

    def _features(self) -> Iterator[tuple[tuple[str, ...], FeatureOp]]:
        for stream in self.policy.streams:
            if stream.name in self.streams:
                yield from (((stream.name, one.name), one.op) for one in stream.features)


def _is_number(value: Value) -> TypeGuard[int | float]:
    return isinstance(value, int | float)
