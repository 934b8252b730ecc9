"""What can begin, by samples or at all; warnings about holds that nothing begins.

Only a sample is an event, neither silence, nor time, nor a hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.activities import Activity
from contextpolicy.policy.cel_syntax import Node
from contextpolicy.policy.validation.cases import Cases, holds, of_sample
from contextpolicy.policy.validation.intervals import bounded, windows
from contextpolicy.policy.validation.silence import Silence, fallbacks, streams_behind
from contextpolicy.policy.validation.unknowns import compiled, constant, context

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.policy.activities import Requirement
    from contextpolicy.policy.spec import Context, Policy
    from contextpolicy.policy.validation.cases import Case
    from contextpolicy.policy.validation.unknowns import Unknown, Value


def beginnings(policy: Policy) -> Iterator[Finding]:
    """Each `hold` of an activity or a pre-condition that no sample can begin."""
    possible = Beginnings(policy, Silence(policy))
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            yield from _hold(f"spec.tasks[{index}].activity[{number}].hold", activity, possible)
        for number, own in enumerate(task.requires):
            if own.task is None:
                yield from _hold(f"spec.tasks[{index}].requires[{number}].hold", condition_of(own), possible)


def _hold(field: str, activity: Activity, possible: Beginnings) -> Iterator[Finding]:
    if activity.hold and not (possible.scores_nothing(activity) or possible.begins(activity)):
        streams, contexts = _events(activity)
        message = "with hold only a sample begins it, and none can: "
        turned = " or ".join(sorted(contexts))
        message += f"no sample makes {activity.when} true" if streams else f"none turns {turned} so"
        yield Finding(field, activity.hold, message)


def condition_of(own: Requirement) -> Activity:
    """A pre-condition as the activity that it is like."""
    return Activity(when=own.when, hold=own.hold)


def events(activity: Activity, policy: Policy) -> frozenset[str]:
    """The streams that change an activity, directly or through contexts."""
    own = {activity.stream} if activity.stream else frozenset[str]()
    return streams_behind(policy, *_sources(activity)) | own


def _sources(activity: Activity) -> list[str]:
    return [own for own in (activity.when, activity.until, activity.score_from) if own]


def _events(activity: Activity) -> tuple[set[str], set[str]]:
    """The streams that an activity reads itself, and the contexts."""
    read = [compiled(own) for own in _sources(activity)]
    streams = {name for one in read for name in one.variables} | ({activity.stream} if activity.stream else set())
    return streams, {name for one in read for name in one.contexts}


class Beginnings:
    """What can begin in a silence, or, where that is of no stream, at all; with `begun` it may have before."""

    def __init__(self, policy: Policy, silence: Silence, *, begun: bool = False) -> None:
        self._silence, self._fallbacks, self._begun = silence, fallbacks(policy), begun
        self._contexts = {one.name: one for one in policy.contexts}
        self._turned: dict[str, frozenset[bool]] = {}
        self._windows = {stream.name: dict(windows(stream, least=1)) for stream in policy.streams}

    def begins(self, activity: Activity) -> bool:
        """Whether it may, with a `hold` by a sample."""
        if activity.initiative is not None:
            return True  # nobody knows what a plug-in makes of its samples
        if self.scores_nothing(activity):
            return False
        if self._begun and self._goes_on(activity):
            return True
        if activity.stream in self._silence.lost:
            return False
        own = Conditions(activity.when, activity.until, self._silence.given)
        streams, contexts = _events(activity)
        if not activity.hold or not (streams or contexts):
            return own.may(own.begin, self._silence.known(*own.sources))
        read = {} if streams else {name: self._turns(name) for name in contexts}
        return self._by_sample(own, own.begin, streams, read)

    def scores_nothing(self, activity: Activity) -> bool:
        """Whether its `scoreFrom` has no value, or is 0."""
        score = compiled(activity.score_from).tree if activity.score_from else None
        return score is not None and (self._silence.lacks(score) or constant(self._silence.chosen(score)) == 0)

    def _goes_on(self, activity: Activity) -> bool:
        """Whether it is one that only `until` ends, and that may not."""
        if activity.until is None or activity.hold:
            return False
        over = Conditions("true", activity.until, self._silence.given)
        return over.may(lambda case: not over.end(case), self._silence.known(activity.until))

    def _turns(self, name: str) -> frozenset[bool]:
        """To which values a sample may turn a context: silence begins a fallback, and only a sample ends it."""
        if name not in self._turned:
            self._turned[name] = frozenset(self._turned_to(self._contexts[name]))
        return self._turned[name]

    def _turned_to(self, own: Context) -> Iterator[bool]:
        if own.name in self._silence.contexts:
            return
        if own.name in self._fallbacks:
            yield False
        if own.when is None:
            return
        conditions = Conditions(own.when, own.until, self._silence.given)
        for to, way in ((True, conditions.begin), (False, conditions.end)):
            read = {name: conditions.turning(way, name, self._turns(name)) for name in conditions.contexts}
            if self._by_sample(conditions, way, conditions.streams, read):
                yield to

    def _by_sample(
        self,
        own: Conditions,
        way: Callable[[Case], bool],
        streams: set[str],
        turned: Mapping[str, frozenset[bool]],
    ) -> bool:
        """Whether it may go that way at a sample of one of the streams, or as one of the contexts turns."""
        events = [self._sample(own, stream) for stream in streams - self._silence.streams]
        events += [{context(name): (value,)} for name, values in turned.items() for value in values]
        known = self._silence.known(*own.sources) if events else {}
        return any(own.may(way, {**known, **event}) for event in events)

    def _sample(self, own: Conditions, stream: str) -> dict[Unknown, Sequence[Value]]:
        """What conditions read as a sample has come of a stream: it is in each of its windows."""
        ranges = self._windows.get(stream, {})
        values = Cases(*own.sources, ranges=ranges).values if ranges else {}
        counted = {
            one: known for one, known in values.items() if isinstance(one[1], Node) and bounded(one[1]) in ranges
        }
        return {**of_sample(stream), **counted}


@dataclass(frozen=True)
class Conditions:
    """`when` and `until` of a context or an activity."""

    when: str
    until: str | None
    given: Sequence[str] = ()
    """What holds of the samples that count."""

    @property
    def sources(self) -> Sequence[str]:
        """All that there are."""
        return (self.when,) if self.until is None else (self.when, self.until)

    @property
    def streams(self) -> set[str]:
        """Those that they read."""
        return {name for source in self.sources for name in compiled(source).variables}

    @property
    def contexts(self) -> set[str]:
        """Those that they read."""
        return {name for source in self.sources for name in compiled(source).contexts}

    def begin(self, case: Case) -> bool:
        """Whether it does in this case."""
        return holds(self.when, case) and not (self.until and holds(self.until, case))

    def end(self, case: Case) -> bool:
        """Whether it does in this case."""
        return holds(self.until, case) if self.until else not holds(self.when, case)

    def turning(self, way: Callable[[Case], bool], name: str, values: Iterable[bool]) -> frozenset[bool]:
        """Those values of a context before which it need not have gone that way already."""
        other = {value: Cases(*self.sources, known={context(name): (not value,)}, given=self.given) for value in values}
        return frozenset(one for one, cases in other.items() if not cases.known or not all(map(way, cases)))

    def may(self, way: Callable[[Case], bool], known: Mapping[Unknown, Sequence[Value]]) -> bool:
        """Whether it may go that way with what is known."""
        cases = Cases(*self.sources, known=known, given=self.given)
        return not cases.known or any(map(way, cases))
