"""What conditions may be at once in their policy: contexts that they read, and windows, can't be what they like."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.validation.beginnings import Conditions
from contextpolicy.policy.validation.cases import Cases, holds
from contextpolicy.policy.validation.intervals import windows
from contextpolicy.policy.validation.silence import Silence, filters, steered
from contextpolicy.policy.validation.unknowns import compiled, context

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Sequence

    from contextpolicy.policy.spec import Context, Policy
    from contextpolicy.policy.validation.cases import Case


class Situations:
    """The conditions of one policy."""

    def __init__(self, policy: Policy) -> None:
        self._contexts = {one.name: one for one in policy.contexts}
        self._steered = steered(policy)
        self._following: dict[tuple[str, str], bool] = {}
        self._ranges = {path: own for stream in policy.streams for path, own in windows(stream)}
        self._given = filters(policy)
        self._silences = {name: silence for name in self._contexts if (silence := _silence_behind(policy, name))}

    def never(self, *sources: str) -> bool:
        """Whether they certainly never hold at once."""
        return not self._may(sources, lambda case: all(holds(source, case) for source in sources))

    def always(self, source: str) -> bool:
        """Whether it certainly holds as long as all values are there that it reads."""
        cases = self._cases([source])
        if self._may([source], lambda case: cases.complete(case) and not holds(source, case)):
            return False
        return self._may([source], lambda case: holds(source, case))

    def excludes(self, *contexts: Context) -> bool:
        """Whether they certainly don't all hold at once for longer than their delays."""
        standing = [source for own in contexts for source in self._standing(own)]
        return self.never(*standing) or self._part(contexts)

    def _part(self, contexts: Collection[Context]) -> bool:
        """Whether whichever begins ends another at once."""
        firm = [one for one in contexts if one.when and not one.exit_after and one.name not in self._steered]
        own = [Conditions(one.when or "", one.until) for one in firm]
        if len(firm) < len(contexts):
            return False
        lasting = [(last, [one for one in own if one is not last]) for last in own]

        def begins(case: Case) -> bool:
            return any(last.begin(case) and not any(one.end(case) for one in rest) for last, rest in lasting)

        return not self._may([source for one in own for source in one.sources], begins)

    def follows(self, later: Context, first: Context) -> bool:
        """Whether the one holds, be it after a delay, as long as the other does, which began by its condition."""
        names = later.name, first.name
        if names not in self._following:
            self._following[names] = self._follows(later, first)
        return self._following[names]

    def _follows(self, later: Context, first: Context) -> bool:
        own = Conditions(later.when or "false", later.until)
        # A delayed context may be inactive in a case although its conditions hold: by following `first` it is not.
        delayed = [one for one in self.read(*own.sources) if one.enter_after and one is not first]
        holding = [f"contexts['{one.name}']" for one in delayed if self.follows(one, first)]
        standing = [*self._standing(first), *holding]
        return bool(self._names(standing) & self._names(own.sources)) and not self._may(
            [*standing, *own.sources],
            lambda case: all(holds(one, case) for one in standing) and not own.begin(case),
        )

    def _standing(self, own: Context) -> list[str]:
        """What holds while a context does, but for its delays."""
        active = f"contexts['{own.name}']"
        return [active] if own.until or own.name in self._steered or not own.when else [active, own.when]

    def _may(self, sources: Sequence[str], wanted: Callable[[Case], bool]) -> bool:
        """Whether conditions may be as wanted; True if their cases are too many to look at."""
        cases, read = self._cases(sources), list(self.read(*sources))
        return not cases.known or any(wanted(case) and all(self._may_be(own, case) for own in read) for case in cases)

    def _cases(self, sources: Sequence[str]) -> Cases:
        """Those of conditions and of the contexts that they read."""
        contexts = self.read(*sources)
        further = [source for own in contexts if own.when for source in Conditions(own.when, own.until).sources]
        return Cases(*sources, *further, ranges=self._ranges, given=self._given)

    def read(self, *sources: str) -> Iterator[Context]:
        """The contexts that conditions read, themselves or through others."""
        pending, found = list(sources), set[str]()
        while pending:
            for name in compiled(pending.pop()).contexts - found:
                found.add(name)
                own = self._contexts[name]
                pending += [source for source in (own.when, own.until) if source]
                yield own

    def _names(self, sources: Iterable[str]) -> set[str]:
        """The streams and contexts that conditions read, themselves or through contexts."""
        contexts = list(self.read(*sources))
        further = [source for own in contexts for source in (own.when, own.until) if source]
        streams = set[str]().union(*(compiled(source).variables for source in (*sources, *further)))
        return streams | {f"contexts.{own.name}" for own in contexts}

    def _may_be(self, own: Context, case: Case) -> bool:
        """Whether a context may be as a case has it: without a delay, it is active as its conditions say."""
        conditions, active = Conditions(own.when or "false", own.until), case[context(own.name)]
        if not active:
            return bool(own.enter_after) or not conditions.begin(case)
        if own.name not in self._steered:
            return bool(own.exit_after and own.when) or not conditions.end(case)
        silence = self._silences.get(own.name)
        known = {one: value for one, value in case.items() if one[0] != "age"}
        return silence is None or all(value in silence.settled(one, (value,)) for one, value in known.items())


def _silence_behind(policy: Policy, name: str) -> Silence | None:
    """What holds while a context does that nothing but one stream's silence begins."""
    watched = (one for one in policy.streams if one.stale_after or one.liveliness)
    begins = [one.name for one in watched if (one.fallback or policy.fallback) == name]
    forced = policy.force is not None and policy.force.context == name
    own = next(one for one in policy.contexts if one.name == name)
    return Silence(policy, lost=frozenset(begins)) if len(begins) == 1 and not (forced or own.when) else None
