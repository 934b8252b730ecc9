"""Warnings about conditions that need what a context suspends as it holds: a stream's task, or their own."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy import cel_cost
from contextpolicy.policy.validation.beginnings import Conditions
from contextpolicy.policy.validation.cases import measured
from contextpolicy.policy.validation.situations import Situations
from contextpolicy.policy.validation.standstill import Standstill
from contextpolicy.policy.validation.unknowns import compiled
from contextpolicy.policy.written import expressions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.activities import Requirement
    from contextpolicy.policy.spec import Policy, Task
    from contextpolicy.policy.validation.standstill import Still


def frozen(policy: Policy) -> Iterator[Finding]:
    """Each pre-condition that a last value meets for ever, and each condition that needs what it stops."""
    own = _Frozen(policy)
    for index, task in enumerate(policy.tasks):
        for number, requirement in enumerate(task.requires):
            if requirement.task is None and not requirement.hold:
                field = f"spec.tasks[{index}].requires[{number}].when"
                yield from own.kept(field, task, requirement)
                yield from own.stopped(field, task, requirement.when)
        for number, activity in enumerate(task.activity):
            if not activity.outlasts:
                yield from own.stopped(f"spec.tasks[{index}].activity[{number}].when", task, activity.when)
    for written in expressions(policy):
        if not written.is_number and not written.field.endswith(".until"):
            yield from own.lost(written.field, written.source)


class _Frozen:
    """All of one policy."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._situations, self._standstill = policy, Situations(policy), Standstill(policy)
        self._contexts = {one.name: one for one in policy.contexts}

    @cached_property
    def _stopping(self) -> dict[str, Still]:
        """What stands still during each context that stops a task."""
        stops = [one for one in self._policy.contexts if any(effect.suspends for effect in one.effects.values())]
        return {one.name: self._standstill.during([one]) for one in stops}

    def kept(self, field: str, task: Task, own: Requirement) -> Iterator[Finding]:
        """The streams of a pre-condition that keep their last value while the task runs without their producers."""
        read = self._last_values(own.when)
        for name, still in self._stopping.items() if read else ():
            frozen = read & still.silence.kept
            if frozen and task.name not in still.tasks:
                message = f"context {name} {still.silenced(frozen)}: without staleAfter {task.name} keeps running on "
                message += "its last sample (hold, or another requires with the task, would end that too)"
                yield Finding(field, own.when, message)
                return

    def _last_values(self, source: str) -> set[str]:
        """The streams of tasks, without `staleAfter`, whose measurements a condition reads, be it through contexts.

        A flag or a name may well be said once, and stay true; a number that has a threshold moves.
        """
        contexts = list(self._situations.read(source))
        further = (one for own in contexts for one in (own.when, own.until) if one)
        paths = {path for one in (source, *further) for node in measured(one) for path in cel_cost.read(node).reads}
        kept = (one for one in self._policy.streams if one.produced_by and one.stale_after is None)
        features = {one.name: {feature.name for feature in one.features} for one in kept}
        return {name for name, *fields in paths if name in features and not features[name].intersection(fields[:1])}

    def lost(self, field: str, source: str) -> Iterator[Finding]:
        """The streams without which a condition does not hold, silenced by contexts that it needs."""
        read = compiled(source)
        needed = self._needed(source)
        if not read.variables or not needed:
            return
        still = self._standstill.during([self._contexts[name] for name in needed])
        conditions = Conditions(source, None)
        silent = read.variables & still.silence.lost
        if silent and not conditions.may(conditions.begin, still.silence.known(source)):
            message = f"needs {' and '.join(needed)}, which {still.silenced(silent)}: holds at most until that is stale"
            yield Finding(field, source, message)

    def stopped(self, field: str, task: Task, source: str) -> Iterator[Finding]:
        """The contexts that a condition of a task needs, although the task can't run while they hold."""
        for name in self._needed(source):
            if self._standstill.prevents(self._contexts[name], task.name):
                yield Finding(field, source, f"needs context {name}, during which {task.name} can't run")
                return

    def _needed(self, source: str) -> list[str]:
        """The contexts without which a condition does not hold."""
        names = sorted(compiled(source).contexts)
        return [name for name in names if self._situations.never(source, f"!contexts['{name}']")]
