"""The documented meaning of a policy, as plainly as it can be written: slow, exact, and with no code of `planning`.

Streams are computed afresh at each moment from all that was said on them. Contexts and events go from moment to moment,
since a delay or a second threshold is about what was before.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from tests.oracle.division import Shares, divide
from tests.oracle.hearing import Heard, hear
from tests.oracle.language import Value, contexts_in, evaluate, streams_in
from tests.oracle.restarting import as_before, at_rest_as_before, reads_of, tasks_moved_by
from tests.oracle.story import Moment, moments
from tests.oracle.units import SECOND, duration
from tests.oracle.weighing import Weights, weigh

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tests.oracle.story import Story

STEPS = 10
"""In which a score decays."""
PATIENCE = 2 * SECOND
"""For which a task waits after a restart for a stream that never gets stale."""


class Holding(NamedTuple):
    """A context: whether its condition holds, since when that is to change, and whether a sample made it do so."""

    holds: bool = False
    since: int | None = None
    sampled: bool = False


class Event(NamedTuple):
    """A score that counts until `ends`; None while its condition goes on."""

    score: Fraction
    ends: int | None


@dataclass(frozen=True)
class State:
    """All that is remembered from one moment to the next."""

    version: int
    begun: Mapping[str, tuple[int, int]]
    """For each stream, when it was first listened to as it is now, and how much had happened by then."""
    heard: Mapping[str, Heard] = field(default_factory=dict)
    holdings: Mapping[str, Holding] = field(default_factory=dict)
    active: frozenset[str] = frozenset()
    fallbacks: frozenset[str] = frozenset()
    events: Mapping[str, Sequence[tuple[Mapping[str, Any], tuple[Event, ...]]]] = field(default_factory=dict)
    """For each task its activities, then its pre-conditions, each with its events."""
    waiting: Mapping[str, frozenset[str]] = field(default_factory=dict)
    """The tasks that keep what they had before a restart, each with the streams that it waits for."""


class Seen(NamedTuple):
    """What the model says at a moment; `weights` and `scores` by task, `shares` in thousandths of a core."""

    at: int
    contexts: tuple[str, ...]
    scores: Mapping[str, Fraction]
    weights: Mapping[str, Fraction]
    suspended: frozenset[str]
    shares: Mapping[str, int]


def seen(story: Story) -> Iterator[Seen]:
    """What is true at the end of each instant, and just after it."""
    state: State | None = None
    deciding = _Deciding(story)
    last: tuple[Moment, State] | None = None
    for moment in moments(story):
        if last is not None and last[0].at != moment.at:
            yield deciding.decide(*last)
        state = _Step(story, moment, state).state()
        last = moment, state
    if last is not None:
        yield deciding.decide(*last)


class _Deciding:
    """From states to shares; what was decided for the same scores and contexts stands."""

    def __init__(self, story: Story) -> None:
        self._story = story
        self._known: dict[object, tuple[Weights, Shares]] = {}

    def decide(self, moment: Moment, state: State) -> Seen:
        spec = self._story.versions[moment.version].spec
        scores, unmet = _scores(spec, moment, state)
        active = [context for context in spec.get("contexts", ()) if context["name"] in state.active]
        names = tuple(context["name"] for context in active)
        kept = {name: own for name, own in self._story.remembered.items() if name in state.waiting}
        situation = moment.version, tuple(scores.items()), frozenset(unmet), names, frozenset(kept)
        if situation not in self._known:
            weights = as_before(weigh(spec, scores, unmet, active), kept)
            at_rest = at_rest_as_before(spec, weigh(spec, dict.fromkeys(scores, Fraction(1)), unmet, active), kept)
            self._known[situation] = weights, divide(spec, weights, at_rest, active, self._story.cores)
        weights, shares = self._known[situation]
        return Seen(moment.at, names, scores, weights.value, shares.suspended, shares.of)


def _scores(spec: Mapping[str, Any], moment: Moment, state: State) -> tuple[dict[str, Fraction], set[str]]:
    """Each task's score, and the tasks with a pre-condition that is not met."""
    scores, unmet = {}, set()
    for task in spec["tasks"]:
        name, own = task["name"], state.events[task["name"]]
        worth = [_worth(what, events, moment) for what, events in own]
        activities = len(task.get("activity", ()))
        idle = Fraction(str(task["idle"])) if "idle" in task else Fraction(0 if activities else 1)
        scores[name] = max([idle, *worth[:activities]])
        if not all(worth[activities:]):
            unmet.add(name)
    return scores, unmet


def _worth(what: Mapping[str, Any], events: Sequence[Event], moment: Moment) -> Fraction:
    """The strongest event: each in full until it ends, then falling in steps."""
    decay = duration(what.get("decay", "0s"))
    return max([_left(event, decay, moment) for event in events], default=Fraction(0))


def _left(event: Event, decay: int, moment: Moment) -> Fraction:
    if event.ends is None:
        return event.score
    if not decay:
        return Fraction(0) if moment.is_due(event.ends) else event.score
    steps = sum(moment.is_due(event.ends + step * decay // STEPS) for step in range(1, STEPS + 1))
    return event.score * (STEPS - steps) / STEPS


class _Step:
    """From one moment's state to the next one's."""

    def __init__(self, story: Story, moment: Moment, before: State | None) -> None:
        self.spec = story.versions[moment.version].spec
        self._story, self._moment, self._before = story, moment, before
        self._contexts = {context["name"]: context for context in self.spec.get("contexts", ())}
        self._edited = before is None or before.version != moment.version
        self._old = None if before is None else story.versions[before.version].spec
        self._begun = self._listening()
        self._heard = {stream["name"]: self._hear(stream) for stream in self.spec["streams"]}
        self._fallen_back = frozenset(self._fallbacks())
        self._insisted = self._fallen_back | set(self._forced())
        self._holdings: dict[str, Holding] = {}

    def state(self) -> State:
        for name in self._contexts:
            self.is_active(name)
        active = frozenset(name for name in self._contexts if self.is_active(name))
        events = {task["name"]: self._events(task) for task in self.spec["tasks"]}
        return State(
            self._moment.version,
            self._begun,
            self._heard,
            self._holdings,
            active,
            self._fallen_back,
            events,
            self._waiting(),
        )

    # What expressions see.

    def fields(self, stream: str) -> Mapping[str, Value] | None:
        return self._heard[stream].value

    def is_older(self, stream: str, age: int, *, strictly: bool) -> bool:
        since = self._heard[stream].since
        if since is None:
            return True
        return since + age < self._moment.at if strictly else since + age <= self._moment.at

    def is_active(self, context: str) -> bool:
        if context not in self._holdings:
            self._holdings[context] = self._hold(self._contexts[context])
        return self._holdings[context].holds or context in self._insisted

    # Streams.

    def _listening(self) -> dict[str, tuple[int, int]]:
        now = self._moment.at, self._moment.seen
        if self._before is None:
            return {stream["name"]: now for stream in self.spec["streams"]}
        return {
            stream["name"]: self._before.begun[stream["name"]] if self._is_same_stream(stream["name"]) else now
            for stream in self.spec["streams"]
        }

    def _is_same_stream(self, name: str) -> bool:
        """Its fallback matters to others only."""
        old, new = (
            [{**one, "fallback": None} for one in spec["streams"] if one["name"] == name]
            for spec in (self._old or {"streams": ()}, self.spec)
        )
        return bool(old) and old == new

    def _hear(self, stream: Mapping[str, Any]) -> Heard:
        since, skipped = self._begun[stream["name"]]
        happenings = self._story.happenings
        log = [
            (one, number == 0 or happenings[number - 1].at != one.at)
            for number, one in enumerate(happenings[: self._moment.seen])
            if number >= skipped and one.stream == stream["name"]
        ]
        return hear(stream, log, since, self._moment)

    def _sampled(self, stream: str) -> bool:
        """Whether a sample of it counts at this very moment."""
        if self._before is None or self._edited:
            return False
        return self._heard[stream].samples > self._before.heard[stream].samples

    # After a restart.

    def _waiting(self) -> dict[str, frozenset[str]]:
        """Who keeps what it had, and for what it waits: an edit may change that, and never lets a task wait again."""
        if not self._story.remembered:
            return {}
        unknown = {stream["name"] for stream in self.spec["streams"] if self._is_unknown(stream)}
        if self._before is not None and not self._edited:
            waiting = {name: streams & unknown for name, streams in self._before.waiting.items()}
        else:
            names = self._story.remembered if self._before is None else self._before.waiting
            moved = tasks_moved_by(self.spec, set(self._forced()))
            reads = reads_of(self.spec)
            waiting = {name: reads[name] & unknown for name in names if name in reads and name not in moved}
        return {name: streams for name, streams in waiting.items() if streams}

    def _is_unknown(self, stream: Mapping[str, Any]) -> bool:
        heard, since = self._heard[stream["name"]], self._begun[stream["name"]][0]
        patient = "staleAfter" in stream or not self._moment.is_due(since + PATIENCE)
        return heard.value is None and not heard.silent and patient

    # Contexts.

    def _fallbacks(self) -> Iterator[str]:
        for stream in self.spec["streams"]:
            fallback = stream.get("fallback", self.spec.get("fallback"))
            if fallback is not None and self._heard[stream["name"]].silent:
                yield fallback

    def _forced(self) -> Iterator[str]:
        force = self.spec.get("force")
        if force is not None and not self._moment.is_due(force["until"]):
            yield force["context"]

    def _hold(self, context: Mapping[str, Any]) -> Holding:
        before = self._holding_before(context)
        if "when" not in context:
            return before
        begins, ends = evaluate(context["when"], self) is True, self._is_over(context)
        wanted = begins if "until" not in context else not ends and (begins or before.holds)
        if wanted is before.holds:
            return before._replace(since=None)
        since, sampled = before.since, before.sampled
        if since is None:
            since, sampled = self._moment.at, self._moved_by_sample(_expressions(context))
        delay = duration(context.get("enterAfter" if wanted else "exitAfter", "0s"))
        if not delay or self._moment.is_due(since + delay):
            return Holding(wanted, sampled=sampled)
        return Holding(before.holds, since, sampled)

    def _moved_by_sample(self, sources: Sequence[str]) -> bool:
        """Whether a sample of what they read counts now, or made a context that they read turn."""
        streams = frozenset[str]().union(*(streams_in(source) for source in sources))
        contexts = frozenset[str]().union(*(contexts_in(source) for source in sources))
        return any(map(self._sampled, streams)) or any(map(self._turned_by_sample, contexts))

    def _turned_by_sample(self, context: str) -> bool:
        """Time, silence and hands make contexts turn too; only a sample ends a silence."""
        if self._before is None or self._edited or self.is_active(context) is (context in self._before.active):
            return False
        if self._holdings[context].holds is not self._before.holdings[context].holds:
            return self._holdings[context].sampled
        return context in self._before.fallbacks and context not in self._fallen_back

    def _is_over(self, what: Mapping[str, Any]) -> bool:
        return "until" in what and evaluate(what["until"], self) is True

    def _holding_before(self, context: Mapping[str, Any]) -> Holding:
        """An edit keeps it if neither its conditions nor what they read changed; changed delays start over."""
        if self._before is None or (self._edited and not self._is_same_context(context["name"])):
            return Holding()
        holding = self._before.holdings[context["name"]]
        old = self._old_context(context["name"])
        same = all(old.get(delay, "0s") == context.get(delay, "0s") for delay in ("enterAfter", "exitAfter"))
        return holding if same else holding._replace(since=None) if self._edited else holding

    def _old_context(self, name: str) -> Mapping[str, Any]:
        return next((one for one in (self._old or {}).get("contexts", ()) if one["name"] == name), {})

    def _is_same_context(self, name: str) -> bool:
        old, new = self._old_context(name), self._contexts.get(name, {})
        if not old or not new or any(old.get(part) != new.get(part) for part in ("when", "until")):
            return False
        return self._reads_the_same(_expressions(new))

    def _reads_the_same(self, sources: Sequence[str], *streams: str) -> bool:
        read = {*streams}.union(*(streams_in(source) for source in sources))
        contexts = frozenset[str]().union(*(contexts_in(source) for source in sources))
        return all(map(self._is_same_stream, read)) and all(map(self._is_same_context, contexts))

    # Activities and pre-conditions.

    def _events(self, task: Mapping[str, Any]) -> list[tuple[Mapping[str, Any], tuple[Event, ...]]]:
        required = [one for one in task.get("requires", ()) if "when" in one]
        before = list(self._before.events.get(task["name"], ())) if self._before else []
        return [(what, self._go_on(what, self._taken(what, before))) for what in (*task.get("activity", ()), *required)]

    def _taken(
        self, what: Mapping[str, Any], before: list[tuple[Mapping[str, Any], tuple[Event, ...]]]
    ) -> tuple[Event, ...] | None:
        """Its events so far; None if it is new. Of several equal ones, each passes its events on once."""
        sources = _expressions(what)
        for place, (old, events) in enumerate(before):
            if old == what and (not self._edited or self._reads_the_same(sources, *_carrier(what))):
                del before[place]
                return events
        return None

    def _go_on(self, what: Mapping[str, Any], before: tuple[Event, ...] | None) -> tuple[Event, ...]:
        events = before or ()
        begins, over = self._begins(what), self._is_over(what)
        now = self._moment.at
        if "hold" in what and _reads(what):
            if over:
                events = tuple(event._replace(ends=now) if self._is_in_force(event) else event for event in events)
                return _without_ended(what, events, now)
            score = self._score(what) if begins and self._is_event(what) else Fraction(0)
            return (*events, Event(score, now + duration(what["hold"]))) if score > 0 else events
        past, current = [one for one in events if one.ends is not None], [one for one in events if one.ends is None]
        goes_on = not over and (begins or ("until" in what and bool(current)))
        score = self._score(what) if goes_on else Fraction(0)
        if score > 0:
            # A score that falls is over once another event is as strong.
            decay = duration(what.get("decay", "0s"))
            stronger = [event for event in past if _left(event, decay, self._moment) > score]
            return (*stronger, Event(score, None))
        return _without_ended(what, (*past, *(event._replace(ends=now) for event in current)), now)

    def _is_in_force(self, event: Event) -> bool:
        return event.ends is None or event.ends > self._moment.at

    def _begins(self, what: Mapping[str, Any]) -> bool:
        carried = all(self.fields(stream) is not None for stream in _carrier(what))
        return carried and evaluate(what.get("when", "true"), self) is True

    def _score(self, what: Mapping[str, Any]) -> Fraction:
        if "scoreFrom" in what:
            return Fraction(evaluate(what["scoreFrom"], self) or 0)
        return Fraction(str(what.get("score", 1)))

    def _is_event(self, what: Mapping[str, Any]) -> bool:
        """Only a sample is one; where no stream is read, that of a context which it makes turn."""
        streams = frozenset(_carrier(what)).union(*(streams_in(source) for source in _expressions(what)))
        return any(map(self._sampled, streams)) if streams else self._moved_by_sample(_expressions(what))


def _without_ended(what: Mapping[str, Any], events: tuple[Event, ...], now: int) -> tuple[Event, ...]:
    """Without a decay nothing is left of what has ended, not even at this very moment."""
    return events if "decay" in what else tuple(event for event in events if event.ends is None or event.ends > now)


def _reads(what: Mapping[str, Any]) -> bool:
    return bool(_carrier(what)) or any(streams_in(source) | contexts_in(source) for source in _expressions(what))


def _expressions(what: Mapping[str, Any]) -> list[str]:
    return [what[name] for name in ("when", "until", "scoreFrom") if name in what]


def _carrier(what: Mapping[str, Any]) -> list[str]:
    return [what["stream"]] if "stream" in what else []
