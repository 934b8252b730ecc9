"""Warnings about tasks that wait for samples that only they can cause, and about fallbacks that their rest begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.beginnings import events
from contextpolicy.policy.validation.producers import without_health
from contextpolicy.policy.validation.silence import streams_behind
from contextpolicy.policy.validation.standstill import Standstill

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy, Task


def sleepers(policy: Policy) -> Iterator[Finding]:
    """Each task that waits for ever for a task that waits, and each whose own stream falls silent as it waits."""
    yield from _Sleepers(without_health(policy)).findings()


class _Sleepers:
    """All of one policy."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._standstill = policy, Standstill(policy)
        self._asleep = self._standstill.from_the_start(stream.name for stream in policy.streams if stream.produced_by)
        self._at_first = self._standstill.from_the_start(stream.name for stream in policy.streams)

    def findings(self) -> Iterator[Finding]:
        for index, task in enumerate(self._policy.tasks):
            field = f"spec.tasks[{index}]"
            if task.priority and task.idle == 0 and not task.activity and task.name in self._asleep.resting:
                yield Finding(f"{field}.idle", 0, f"nothing wakes {task.name}: it has idle 0 and no activity")
            else:
                yield from self._asleep_for_ever(field, task)
            if task.name not in self._asleep.tasks:
                yield from self._falling_back(field, task)

    def _asleep_for_ever(self, field: str, task: Task) -> Iterator[Finding]:
        awaited = self._waking(task) & self._asleep.silence.lost
        if awaited and task.name in self._asleep.resting:
            yield _at_rest(field, task, f"nothing wakes {task.name} without {self._sent(task, awaited)}")
        for number, own in enumerate(task.requires):
            awaited = set(streams_behind(self._policy, own.when)) & self._asleep.silence.lost
            if awaited and own in self._standstill.unmet(task, self._asleep.silence):
                message = f"nothing lets {task.name} run without {self._sent(task, awaited)}"
                yield Finding(f"{field}.requires[{number}].when", own.when, message)

    def _waking(self, task: Task) -> set[str]:
        """The streams that make it active, or a context that weights it."""
        weighting = (one for one in self._policy.contexts if task.name in one.effects and one.effects[task.name].weight)
        waking = set(streams_behind(self._policy, *(one.when for one in weighting if one.when)))
        activities = task.activity if task.priority else ()
        return waking.union(*(events(own, self._policy) for own in activities))

    def _sent(self, task: Task, streams: set[str]) -> str:
        parts = []
        for stream in self._policy.streams:
            if stream.name in streams:
                itself = f"{task.name} itself" if stream.produced_by == task.name else stream.produced_by
                parts.append(f"{stream.name}, which {itself} produces")
        return " and ".join(parts)

    def _falling_back(self, field: str, task: Task) -> Iterator[Finding]:
        if task.name in self._at_first.resting:
            for stream, fallback in self._at_first.fallbacks():
                if stream.produced_by == task.name:
                    message = (
                        f"its stream {stream.name} is silent, which begins the fallback {fallback}, from the start"
                    )
                    yield _at_rest(field, task, f"until something wakes {task.name}, {message}")
        if task.preconditions:
            waiting = self._standstill.without(task)
            for stream, fallback in waiting.fallbacks():
                message = f"an unmet pre-condition of {task.name} {waiting.stopped(stream)}: "
                message += f"its stream {stream.name} is silent then, which begins the fallback {fallback}"
                yield Finding(f"{field}.requires", task.name, message)


def _at_rest(field: str, task: Task, message: str) -> Finding:
    """A finding at what lets the task rest."""
    what, value = ("idle", task.idle or 0) if task.priority else ("priority", 0)
    return Finding(f"{field}.{what}", value, message)
