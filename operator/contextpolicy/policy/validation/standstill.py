"""Which tasks certainly do nothing because they lack others' output, and which streams are silent for it.

A task that can't run, or that nothing wakes, sends nothing; its silence may leave further tasks without what they need.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.context_reads import Dependencies
from contextpolicy.policy.dependencies import TaskTree
from contextpolicy.policy.spec import SatisfiedBy
from contextpolicy.policy.validation import needs
from contextpolicy.policy.validation.beginnings import Beginnings, Conditions, condition_of
from contextpolicy.policy.validation.endings import Endings
from contextpolicy.policy.validation.running import Running
from contextpolicy.policy.validation.silence import Silence, steered
from contextpolicy.policy.validation.situations import Situations
from contextpolicy.policy.written import reads_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.policy.activities import Requirement
    from contextpolicy.policy.spec import Context, Effect, Policy, Task
    from contextpolicy.policy.stream_spec import Stream


class Still(NamedTuple):
    """Tasks that can't run, tasks at rest that nothing wakes, and the silence that this is."""

    unable: AbstractSet[str]
    resting: AbstractSet[str]
    silence: Silence
    beside: Sequence[str] = ()
    """The contexts that stop some of them too, as they hold whenever those do that are asked about."""
    at_once: AbstractSet[str] = frozenset()
    """Of its streams those of which no sample comes from the very moment at which one context begins."""

    @property
    def tasks(self) -> AbstractSet[str]:
        """All of them."""
        return self.unable | self.resting

    def stopped(self, stream: Stream) -> str:
        """What becomes of a silent stream's producer, in words after those for what stops it."""
        return f"{'suspends' if stream.produced_by in self.unable else 'leaves at rest'} {stream.produced_by}"

    def silenced(self, streams: AbstractSet[str]) -> str:
        """The same of each of these streams that is silent."""
        silent = [one for one in self.silence.policy.streams if one.name in streams & self.silence.streams]
        return ", ".join(f"{self.stopped(one)}, which produces {one.name}" for one in silent)

    def fallbacks(self) -> Iterator[tuple[Stream, str]]:
        """The streams that go stale, each with the fallback that this begins; a producer's liveliness token stays."""
        for stream in self.silence.policy.streams:
            fallback = stream.fallback or self.silence.policy.fallback
            if fallback and stream.stale_after is not None and stream.produced_by in self.tasks:
                yield stream, fallback


class Standstill:
    """What stands still of a policy's tasks."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._tree = policy, TaskTree(policy)
        self._situations = Situations(policy)

    def during(self, contexts: Collection[Context]) -> Still:
        """What does once these contexts hold."""
        suspended = set[str]().union(*map(self._suspended_by, contexts))
        at_once = self._at_once(suspended) if len(contexts) == 1 else frozenset()
        beside = [one for one in self._policy.contexts if self._suspended_by(one) - suspended]
        beside = [one for one in beside if any(self._situations.follows(one, first) for first in contexts)]
        suspended = suspended.union(*map(self._suspended_by, beside))
        holding = dict.fromkeys((context.name for context in (*contexts, *beside)), True)
        still = self._spread(Silence(self._policy, contexts=holding), suspended)
        return still._replace(beside=[context.name for context in beside], at_once=at_once)

    def without(self, task: Task) -> Still:
        """What does while a task can't run."""
        return self._spread(Silence(self._policy), {task.name})

    def from_the_start(self, streams: Iterable[str]) -> Still:
        """What does, and for ever, as long as none of these streams is heard but from a task that does not."""
        lost = frozenset(streams)
        while True:
            silence = self._never_heard(lost)
            still = self._still(silence, set(), begun=False)
            heard = {stream.name for stream in self._policy.streams if self._is_sent(stream.produced_by, still)}
            if not lost & heard:
                return still
            lost -= heard

    def prevents(self, context: Context, task: str) -> bool:
        """Whether a task can't run while a context holds, for what that suspends."""
        return task in self._stopped_with(self._suspended_by(context))

    def causes(self, context: Context, task: str) -> list[str]:
        """The others that a context suspends without which a task can't run then; none if it can."""
        suspended = self._suspended_by(context)
        if task in suspended or task not in self._stopped_with(suspended):
            return []
        return [one for one in sorted(suspended) if task in self._stopped_with({one})] or sorted(suspended)

    def unmet(self, task: Task, silence: Silence) -> list[Requirement]:
        """The pre-conditions that can't be met in a silence."""
        return _unmet(task, Beginnings(self._policy, silence))

    def _is_sent(self, producer: str | None, still: Still) -> bool:
        return producer in self._tree.tasks and producer not in still.tasks

    def _spread(self, silence: Silence, suspended: set[str]) -> Still:
        awake: AbstractSet[str] = frozenset()
        before = self._still(silence, suspended, awake)
        while True:
            silent = [stream for stream in self._policy.streams if stream.produced_by in before.tasks]
            lost = frozenset(stream.name for stream in silent if stream.stale_after is not None)
            kept = frozenset(stream.name for stream in silent) - lost
            still = self._still(replace(silence, lost=lost, kept=kept), suspended, awake)
            if still == before:
                return still
            # What a longer silence wakes does not stand still for good.
            awake |= before.tasks - still.tasks
            before = still

    def _never_heard(self, lost: frozenset[str]) -> Silence:
        """What is known of contexts while these streams were never heard."""
        silence = Silence(self._policy, lost=lost)
        contexts = {one.name: one for one in self._policy.contexts}
        ranks = Dependencies(reads_of(self._policy.contexts)).ranks()
        for name in sorted(contexts.keys() - steered(self._policy), key=lambda name: (ranks[name], name)):
            own = Conditions(contexts[name].when or "false", contexts[name].until, silence.given)
            if not own.may(own.begin, silence.known(*own.sources)):
                silence = replace(silence, contexts={**silence.contexts, name: False})
        return silence

    def _still(
        self, silence: Silence, suspended: set[str], awake: AbstractSet[str] = frozenset(), *, begun: bool = True
    ) -> Still:
        possible = Beginnings(self._policy, silence, begun=begun)
        asked = [task for task in self._policy.tasks if task.name not in awake]
        unable = self._stopped_with(suspended | {task.name for task in asked if _unmet(task, possible)})
        resting = {task.name for task in asked if self._rests(task, possible, silence)}
        while more := {task.name for task in self._policy.tasks if self._rests_with(task, resting, unable)} - resting:
            resting |= more
        return Still(unable, resting - unable if resting and self._busy(silence) else frozenset(), silence)

    def _busy(self, silence: Silence) -> bool:
        """Whether something is active at each moment: where nothing is, even tasks at rest share the node."""
        contexts = self._policy.contexts
        hold = [one for one in contexts if silence.contexts.get(one.name)]
        others = [one for one in contexts if one.name not in silence.contexts]
        return Running(self._tree, hold, others, Endings(self._policy, silence).may_turn_on).any()

    def _at_once(self, suspended: set[str]) -> AbstractSet[str]:
        """The streams that a context stops as it begins: minDwell or a context that ends late may let them go on."""
        if self._policy.enforcement.min_dwell or suspended & _released(self._policy.contexts):
            return frozenset()
        stopped = self._stopped_with(suspended)
        return {one.name for one in self._policy.streams if one.produced_by in stopped}

    def _stopped_with(self, unable: set[str]) -> set[str]:
        """These and all that can't run without them."""
        while more := {
            task.name for task in self._policy.tasks if task.name not in unable and self._stops(task, unable)
        }:
            unable = unable | more
        return unable

    def _suspended_by(self, context: Context) -> set[str]:
        """Those that it surely suspends: a later one may let a task run again."""
        later = self._policy.contexts[self._policy.contexts.index(context) + 1 :]
        suspended = {name for name, effect in context.effects.items() if effect.suspends}
        suspended = {name for name in suspended if not self._tree.tasks[name].protected}
        starved = {name for name, effect in context.effects.items() if self._starves(name, effect)}
        further = [one for one in later if suspended & _released([one]) or starved & _bounded(one)]
        beside = [one for one in further if not self._situations.excludes(context, one)]
        return (suspended - _released(beside)) | starved.difference(*map(_bounded, beside))

    def _starves(self, name: str, effect: Effect) -> bool:
        """Whether it leaves a task less than it needs to run at all."""
        return needs.suspends(self._tree.tasks[name], effect, self._policy.enforcement)

    def _stops(self, task: Task, unable: set[str]) -> bool:
        """Whether a task can't run because of others: what it requires, its parts, or what it is a part of."""
        if unable.intersection(task.required_tasks):
            return True
        missing = unable.intersection(task.subtasks)
        if missing and (task.satisfied_by is SatisfiedBy.ALL or len(missing) == len(task.subtasks)):
            return True
        return not task.protected and self._tree.parents.get(task.name) in unable

    def _rests(self, task: Task, possible: Beginnings, silence: Silence) -> bool:
        """Whether it weighs 0 until a context weights it or it scores, and none can: it never does with priority 0."""
        weights = (one for one in self._policy.contexts if silence.contexts.get(one.name, True))
        weighted = any(one.effects[task.name].weight for one in weights if task.name in one.effects)
        return not (task.protected or weighted or (task.priority and _scores(task, possible)))

    def _rests_with(self, task: Task, resting: set[str], unable: set[str]) -> bool:
        """Whether a task has no weight because of others: its parts, or what it is a part of."""
        idle = task.subtasks and all(name in resting or name in unable for name in task.subtasks)
        return bool(idle) or (not task.protected and self._tree.parents.get(task.name) in resting)


def _scores(task: Task, possible: Beginnings) -> bool:
    """Whether it may: it does not by default if it lists activities, until one of them begins."""
    idle = task.idle != 0 and (task.idle is not None or not task.activity)
    return idle or any(own.counts and possible.begins(own) for own in task.activity)


def _released(contexts: Iterable[Context]) -> set[str]:
    return {name for one in contexts for name, effect in one.effects.items() if effect.suspend is False}


def _bounded(context: Context) -> set[str]:
    return {name for name, effect in context.effects.items() if effect.bounds}


def _unmet(task: Task, possible: Beginnings) -> list[Requirement]:
    return [own for own in task.preconditions if not possible.begins(condition_of(own))]
