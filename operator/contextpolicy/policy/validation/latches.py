"""Warnings about contexts that silence what ends them, and about fallbacks that suspension begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.endings import End, Endings
from contextpolicy.policy.validation.producers import without_health
from contextpolicy.policy.validation.silence import streams_behind
from contextpolicy.policy.validation.situations import Situations
from contextpolicy.policy.validation.standstill import Standstill

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.policy.spec import Context, Policy
    from contextpolicy.policy.validation.standstill import Still


def latches(policy: Policy) -> Iterator[Finding]:
    """Each context that only a stream ends whose producer it stops, alone or together with others."""
    yield from _Latches(without_health(policy)).findings()


class _Latches:
    """All of one policy."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._standstill = policy, Standstill(policy)
        self._ends: dict[object, End] = {}
        self._situations = Situations(policy)
        self._alone = {context.name: self._standstill.during([context]) for context in policy.contexts}
        self._asleep = self._standstill.from_the_start(stream.name for stream in policy.streams if stream.produced_by)

    def findings(self) -> Iterator[Finding]:
        reasons = {one.name: [*self._latching(one), *self._falling_back(one)] for one in self._policy.contexts}
        for index, context in enumerate(self._policy.contexts):
            # Where only contexts that hold beside it stop the producer, the warning is theirs.
            stops = any(effect.suspends for effect in context.effects.values())
            if stops or not any(reasons[name] for name in self._alone[context.name].beside):
                yield from (Finding(f"spec.contexts[{index}]", context.name, one) for one in reasons[context.name])
        yield from self._rings()

    def _latching(self, context: Context) -> Iterator[str]:
        still = self._alone[context.name]
        end = self._end(context, still)
        if end is End.OTHERWISE:
            return
        begun = Endings(self._policy, still.silence, still.at_once).begun(context, end)
        behind = streams_behind(self._policy, context.until or begun) - self._asleep.silence.lost
        if not behind & still.silence.streams:
            return  # none of them was ever heard
        message = f"{_named(context, still)} {still.silenced(behind)}: "
        if end is End.BY_SILENCE:
            yield message + "its silence ends the context, the task resumes, and the cycle repeats"
        else:
            once = "begun" if begun == context.when else begun
            yield message + f"nothing else ends it, so once {once} it holds for ever"

    def _falling_back(self, context: Context) -> Iterator[str]:
        still = self._alone[context.name]
        for stream, fallback in still.fallbacks():
            if stream.produced_by not in self._asleep.tasks:
                lasts = "which then holds for ever" if context.name == fallback else f"beside {context.name}"
                message = f"its stream {stream.name} is silent then, which begins the fallback {fallback}, {lasts}"
                yield f"{_named(context, still)} {still.stopped(stream)}: {message}"

    def _rings(self) -> Iterator[Finding]:
        """Contexts that only together silence what ends each of them."""
        pool = [one for one in self._policy.contexts if not self._lasts(one, self._alone[one.name])]
        pool = self._lasting(pool)
        for ring in circles({one.name: self._keepers(one, pool) for one in pool}):
            contexts = [one for one in pool if one.name in ring]
            if self._lasting(contexts) == contexts and not self._situations.excludes(*contexts):
                index = self._policy.contexts.index(contexts[0])
                yield Finding(f"spec.contexts[{index}]", contexts[0].name, self._ring(contexts))

    def _lasting(self, pool: list[Context]) -> list[Context]:
        """Those of which none ends any more if all of them hold."""
        while pool:
            still = self._standstill.during(pool)
            left = [one for one in pool if self._lasts(one, still)]
            if left == pool:
                break
            pool = left
        return pool

    def _keepers(self, context: Context, pool: list[Context]) -> set[str]:
        """Those that silence what ends it; all, where only several do so together."""
        behind = set(self._waited_for(context))
        alone = {one.name for one in pool if self._alone[one.name].silence.streams & behind}
        return alone or {one.name for one in pool}

    def _lasts(self, context: Context, still: Still) -> bool:
        if any(fallback == context.name for _, fallback in still.fallbacks()):
            return True
        return self._end(context, still) is End.NEVER

    def _end(self, context: Context, still: Still) -> End:
        """Found once for all that a context sees of a silence: most of what further contexts silence is none of it."""
        silence = still.silence.behind(*filter(None, (context.when, context.until)))
        at_once = still.at_once & silence.streams
        seen = context.name, silence.lost, silence.kept, frozenset(silence.contexts.items()), frozenset(at_once)
        if seen not in self._ends:
            self._ends[seen] = Endings(self._policy, silence, at_once).end(context)
        return self._ends[seen]

    def _ring(self, ring: Sequence[Context]) -> str:
        behind = {stream for one in ring for stream in self._waited_for(one)}
        alone = [(one.name, self._alone[one.name]) for one in ring]
        message = [f"{name} {own.silenced(behind)}" for name, own in alone if own.silence.streams & behind]
        what = "; ".join(message) or f"together each {self._standstill.during(ring).silenced(behind)}"
        names = " and ".join(one.name for one in ring)
        lasts = "nothing else ends them, so once all hold they hold for ever"
        return f"contexts {names} keep each other active: {what}; {lasts}"

    def _waited_for(self, context: Context) -> Iterator[str]:
        """The streams whose samples would end it."""
        yield from streams_behind(self._policy, *filter(None, [context.until or context.when]))
        for stream in self._policy.streams:
            if (stream.fallback or self._policy.fallback) == context.name:
                yield stream.name


def _named(context: Context, still: Still) -> str:
    beside = f", beside which {' and '.join(still.beside)} holds," if still.beside else ""
    return f"context {context.name}{beside}"


def circles(following: Mapping[str, set[str]]) -> Iterator[set[str]]:
    """The strongly connected sets of more than one name."""
    reached = {name: set(after) for name, after in following.items()}
    for between in following:
        for name, after in reached.items():
            if between in after:
                reached[name] = after | reached[between]
    seen: set[str] = set()
    for name, after in reached.items():
        circle = {other for other in after if name in reached[other]} - seen
        seen |= circle
        if len(circle) > 1:
            yield circle
