"""What can still end a context in a silence: other streams, time, or the silence itself."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum, auto
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy import cel_cost
from contextpolicy.policy.cel_syntax import Construct, Node
from contextpolicy.policy.validation.beginnings import Conditions
from contextpolicy.policy.validation.cases import Cases, every
from contextpolicy.policy.validation.silence import lasting, steered, streams_behind
from contextpolicy.policy.validation.unknowns import compiled

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.policy.spec import Context, Policy
    from contextpolicy.policy.validation.cases import Case
    from contextpolicy.policy.validation.silence import Silence
    from contextpolicy.policy.validation.unknowns import Unknown, Value


class End(Enum):
    """What only the silence does to a context that holds as it falls."""

    NEVER = auto()
    BY_SILENCE = auto()
    OTHERWISE = auto()


class Course(NamedTuple):
    """A state of what the silence stops: all cases of the conditions as it falls, and from then on."""

    state: Case
    now: Sequence[Case]
    later: Iterator[Case]


class Endings:
    """How contexts go on in a silence; streams of `at_once` send nothing from the moment at which a context begins."""

    def __init__(self, policy: Policy, silence: Silence, at_once: AbstractSet[str] = frozenset()) -> None:
        self._policy, self._silence, self._steered = policy, silence, steered(policy)
        self._at_once, self._lasting = at_once, lasting(policy)
        self._contexts = {context.name: context for context in policy.contexts}
        self._turned: dict[str, frozenset[bool] | None] = {}

    def end(self, own: Context) -> End:
        """What becomes of it; OTHERWISE if that is not certain."""
        source = own.until or own.when
        if own.when is None or source is None or not streams_behind(self._policy, source) & self._silence.streams:
            return End.OTHERWISE
        cases = Cases(source, given=self._silence.given)
        conditions = Conditions(own.when, own.until, self._silence.given)
        if not cases.known or not any(map(conditions.end, cases)):
            return End.OTHERWISE
        if own.until is not None:
            return End.NEVER if any(map(self._keeps(own.until), alternatives(own.when))) else End.OTHERWISE
        courses = [(one.now, any(map(conditions.end, one.later))) for one in self._go(source)]
        standing = [ends for now, ends in courses if not any(map(conditions.end, now))]
        return End.NEVER if not all(standing) else End.BY_SILENCE if standing else End.OTHERWISE

    def begun(self, own: Context, end: End) -> str:
        """The alternative of `when` that is enough for this end; all of it if each is."""
        when = own.when or ""
        enough = [one for one in alternatives(when) if self.end(replace(own, when=one)) is end]
        return when if own.until and len(enough) == len(alternatives(when)) else next(iter(enough), when)

    def may_turn_on(self, own: Context) -> bool:
        """Whether a context that is not active may become so in the silence."""
        turned = self._turns(own.name)
        return turned is None or True in turned

    def _keeps(self, until: str) -> Callable[[str], bool]:
        """Whether what began by a condition never ends, whatever the last samples of the silent streams."""

        def keeps(when: str) -> bool:
            conditions = Conditions(when, until, self._silence.given)
            both = Cases(*conditions.sources, given=conditions.given).known
            begun, courses = set(), []
            for one in self._go(*conditions.sources) if both else self._go(until):
                state = frozenset((own, value) for own, value in one.state.items() if both and self._is_at_once(own))
                if not both or any(map(conditions.begin, one.now)):
                    begun.add(state)
                if not all(map(conditions.end, one.now)):
                    courses.append((state, any(map(conditions.end, one.later))))
            ends = [ends for state, ends in courses if state in begun]
            return bool(ends) and not any(ends)

        return keeps

    def _is_at_once(self, unknown: Unknown) -> bool:
        """Whether an operand stands from the moment at which a context begins."""
        kind, what = unknown
        if self._silence.streams <= self._at_once:
            return True
        streams = cel_cost.read(what).streams if isinstance(what, Node) else {what}
        return kind != "context" and streams <= self._at_once

    def _go(self, *sources: str) -> Iterator[Course]:
        """Each state of what the silence stops."""
        cases = Cases(*sources, given=self._silence.given)
        values = {one: self._now(one, known) for one, known in cases.values.items()}
        standing = {one: known for one, known in values.items() if self._stands(one)}
        free = {one: known for one, known in values.items() if one not in standing}
        others = list(every(free))
        others_later = list(every({one: self._silence.settled(one, known) for one, known in free.items()}))
        after = {one: {value: self._after(one, value, known) for value in known} for one, known in standing.items()}
        for state in every(standing):
            now = [case for one in others if cases.possible(case := {**state, **one})]
            later = ({**own, **one} for own in every(_of(after, state)) for one in others_later)
            if now:
                yield Course(state, now, filter(cases.possible, later))

    def _now(self, unknown: Unknown, values: Sequence[Value]) -> Sequence[Value]:
        return self._silence.settled(unknown, values) if unknown[0] == "context" else values

    def _stands(self, unknown: Unknown) -> bool:
        kind, name = unknown
        if kind != "context":
            return (kind == "heard" and name in self._lasting) or self._silence.stands(unknown)
        return name not in self._silence.contexts and self._turns(str(name)) is not None

    def _after(self, unknown: Unknown, now: Value, values: Sequence[Value]) -> Sequence[Value]:
        kind, name = unknown
        if kind == "heard" and name in self._lasting - self._silence.streams:
            return (True,) if now else (True, False)
        if kind != "context":
            return self._silence.after(unknown, now, values)
        turned = self._turns(str(name)) or ()
        return (now, not now) if (not now) in turned else (now,)

    def _turns(self, name: str) -> frozenset[bool] | None:
        """To which values the silence may turn a context; None where something else may turn it."""
        if name not in self._turned:
            self._turned[name] = self._find_turns(self._contexts[name])
        return self._turned[name]

    def _find_turns(self, own: Context) -> frozenset[bool] | None:
        if own.name in self._steered:
            return None
        conditions = Conditions(own.when or "false", own.until, self._silence.given)
        if not Cases(*conditions.sources, given=conditions.given).known:
            return None
        turned = set()
        for to, way in ((True, conditions.begin), (False, conditions.end)):
            for one in self._go(*conditions.sources):
                goes = set(map(way, one.now))
                if len(goes) > 1:
                    return None
                if True not in goes and any(map(way, one.later)):
                    turned.add(to)
        return frozenset(turned)


def _of(after: Mapping[Unknown, Mapping[Value, Sequence[Value]]], state: Case) -> Mapping[Unknown, Sequence[Value]]:
    return {one: known[state[one]] for one, known in after.items()}


def alternatives(source: str) -> Sequence[str]:
    """The conditions each of which alone lets the whole one hold."""
    tree = compiled(source).tree
    if tree.kind is not Construct.BINARY or tree.text != "||":
        return [source]
    return [source[slice(*part.span)] for part in tree.parts]
