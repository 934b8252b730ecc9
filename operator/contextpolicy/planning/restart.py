"""After a restart of the operator: tasks keep their state until what they depend on is known again.

Decisions do not wait for silent sensors. But a restarted operator has received nothing yet, and missing samples must
not change the shares of a driving robot: a task that depends on a stream not heard so far keeps its last state until
the stream is heard or silent, or for `PATIENCE` where the stream has no `staleAfter`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from contextpolicy.policy.dependencies import TaskTree

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from contextpolicy.planning.conditions.context import ContextState
    from contextpolicy.planning.conditions.initiative import Initiative
    from contextpolicy.planning.conditions.stream import StreamState
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.policy.spec import Policy

PATIENCE = 2.0
"""Seconds in which a stream without `staleAfter` is heard again, or taken for one that speaks rarely."""


class Remembered(NamedTuple):
    """A task's last state before the restart."""

    weight: float
    suspended: bool


class RestartState(NamedTuple):
    """What a planner has at its start."""

    streams: Mapping[str, StreamState]
    contexts: Sequence[ContextState]
    initiatives: Iterable[tuple[Initiative, str]]
    """With the task of each."""
    forced: Collection[ContextState]
    """What tasks do in these is decided at once."""


class RestartListener(Protocol):
    """Receives that tasks' states are decided again."""

    def on_known(self, stream: str) -> None:
        """Tasks need not wait for this stream any more."""


class Restart:
    """The tasks of one policy that keep what they had, and the streams that each of them waits for."""

    def __init__(
        self, policy: Policy, remembered: Mapping[str, Remembered], timers: Timers, listener: RestartListener
    ) -> None:
        """`remembered` is what the tasks had before the restart."""
        self.kept: dict[str, Remembered] = {}
        self.awaited: dict[str, set[str]] = {}
        """The streams that each of these tasks waits for."""
        self._policy, self._remembered = policy, remembered
        self._timers, self._listener = timers, listener
        self._patient: dict[str, float] = {}
        """The awaited streams without `staleAfter`, each with when it is taken for one that speaks rarely."""

    def start(self, former: Restart | None, state: RestartState, now: float) -> None:
        """Keep what the tasks had where it is not yet known what they should have.

        Go on so after an edit: a stream that the edit did not change is waited for no longer than without it.
        """
        remembered = self._remembered if former is None else former.kept
        if not remembered:
            return
        reads = reads_of_tasks(self._policy, state.initiatives, state.contexts)
        at_once = moved_by(self._policy, state.forced)
        self._keep({name: task for name, task in remembered.items() if name not in at_once}, reads, state.streams, now)

    def _keep(
        self,
        remembered: Mapping[str, Remembered],
        reads: Mapping[str, set[str]],
        streams: Mapping[str, StreamState],
        now: float,
    ) -> None:
        """Keep what is remembered of the tasks that read a stream not heard yet."""
        unheard = {name for name, stream in streams.items() if not stream.fresh and not stream.silent}
        patient = {name: _patience(streams[name], now) for name in unheard if streams[name].spec.stale_after is None}
        unheard -= {name for name, until in patient.items() if until <= now}
        awaited = {name: reads.get(name, set()) & unheard for name in remembered}
        self.awaited = {name: missing for name, missing in awaited.items() if missing}
        self.kept = {name: remembered[name] for name in self.awaited}
        streams_awaited = set[str]().union(*self.awaited.values())
        self._patient = {name: until for name, until in patient.items() if name in streams_awaited}
        self._wait()

    def know(self, stream: str) -> None:
        """The stream is heard, or known to be silent."""
        if not any(stream in streams for streams in self.awaited.values()):
            return
        for streams in self.awaited.values():
            streams.discard(stream)
        self.awaited = {name: streams for name, streams in self.awaited.items() if streams}
        self.kept = {name: self.kept[name] for name in self.awaited}
        self._listener.on_known(stream)

    def on_due(self, now: float) -> None:
        """Streams without `staleAfter` may be silent for long."""
        for stream in sorted(name for name, until in self._patient.items() if until <= now):
            del self._patient[stream]
            self.know(stream)
        self._wait()

    def _wait(self) -> None:
        if self._patient:
            self._timers.set(self, min(self._patient.values()))


def _patience(stream: StreamState, now: float) -> float:
    return (now if stream.absent_since is None else stream.absent_since) + PATIENCE


def moved_by(policy: Policy, contexts: Iterable[ContextState]) -> set[str]:
    """The tasks that these contexts change, directly or through the task graph."""
    named = {task for context in contexts for task in context.spec.effects}
    near = _near(policy)
    return {name for name in near if not named.isdisjoint(_reachable(name, near))}


def reads_of_tasks(
    policy: Policy, initiatives: Iterable[tuple[Initiative, str]], contexts: Sequence[ContextState]
) -> dict[str, set[str]]:
    """The streams on which each task's state depends: through conditions, contexts and the task graph."""
    of_context = _reads_of_contexts(policy, contexts)
    own: dict[str, set[str]] = {task.name: set() for task in policy.tasks}
    for initiative, task in initiatives:
        own[task] |= {stream.spec.name for stream in initiative.streams}
        own[task] |= set().union(*(of_context[name] for name in initiative.reads))
    for context in contexts:
        for task in context.spec.effects:
            own[task] |= of_context[context.spec.name]
    near = _near(policy)
    return {name: set().union(*(own[one] for one in _reachable(name, near))) for name in own}


def _near(policy: Policy) -> dict[str, set[str]]:
    """The tasks on which each one's state depends at first hand."""
    tree = TaskTree(policy)
    return {task.name: {*tree.dependencies(task.name), *tree.ancestors(task.name)} for task in policy.tasks}


def _reads_of_contexts(policy: Policy, contexts: Sequence[ContextState]) -> dict[str, set[str]]:
    own = {context.spec.name: {stream.spec.name for stream in context.streams} for context in contexts}
    for stream in policy.streams:
        fallback = stream.fallback or policy.fallback
        if fallback is not None and (stream.stale_after is not None or stream.liveliness is not None):
            own[fallback].add(stream.name)
    near = {context.spec.name: set(context.reads) for context in contexts}
    return {name: set().union(*(own[one] for one in _reachable(name, near))) for name in own}


def _reachable(start: str, near: Mapping[str, set[str]]) -> set[str]:
    """The start and all that can be reached from it."""
    found, new = {start}, [start]
    while new:
        more = near[new.pop()] - found
        found |= more
        new += more
    return found
