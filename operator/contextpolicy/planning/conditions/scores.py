"""Every task's score and its unmet pre-condition, kept up to date one initiative at a time (paper IV-D)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.activities import Activity

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from contextpolicy.planning.conditions.initiative import Initiative
    from contextpolicy.policy.spec import Policy


class Scores:
    """A score is that of the strongest activity that is held or fresh, and at least the task's idle score.

    A task with neither scores 1.
    """

    def __init__(self, policy: Policy, instantiate: Callable[[Activity], Initiative]) -> None:
        self.initiatives = {task.name: [instantiate(own) for own in task.activity] for task in policy.tasks}
        self.requirements = {
            task.name: [instantiate(Activity(when=own.when, hold=own.hold)) for own in task.preconditions]
            for task in policy.tasks
        }
        self.unmet: dict[str, str] = {}
        self.of: dict[str, float] = {}
        self._idle = {t.name: (0.0 if t.activity else 1.0) if t.idle is None else t.idle for t in policy.tasks}
        self._owners = {
            initiative: task
            for of_tasks in (self.initiatives, self.requirements)
            for task, own in of_tasks.items()
            for initiative in own
        }
        for name in self.initiatives:
            self._update(name)

    def __iter__(self) -> Iterator[Initiative]:
        """All initiatives, the activities first."""
        return iter(self._owners)

    def owned(self) -> Iterable[tuple[Initiative, str]]:
        """All initiatives, each with its task."""
        return self._owners.items()

    def owner(self, initiative: Initiative) -> str:
        """Its task."""
        return self._owners[initiative]

    def update(self, initiative: Initiative) -> bool:
        """Its value changed; returns whether that changes its task: another activity, or `idle`, may count for more."""
        task = self._owners[initiative]
        before = self.of[task], self.unmet.get(task)
        self._update(task)
        return (self.of[task], self.unmet.get(task)) != before

    def part(self, initiative: Initiative) -> tuple[str, bool]:
        """What it makes: its task's score, or whether that has to wait. Of each only the last change is a cause."""
        task = self._owners[initiative]
        return task, initiative in self.requirements[task]

    def cause(self, initiative: Initiative) -> str:
        """Why its task changed, for people to read."""
        task = self._owners[initiative]
        if initiative.is_over:
            return f"{initiative.source}: the hold of {initiative.line} is over"
        cause = f"{initiative.source}: {initiative.line} is {initiative.value:g}"
        outweighed = initiative in self.initiatives[task] and 0 < initiative.value < self.of[task]
        return f"{cause}, but {task} already scores {self.of[task]:g}" if outweighed else cause

    def _update(self, task: str) -> None:
        self.of[task] = max([self._idle[task], *(activity.value for activity in self.initiatives[task])])
        self.unmet.pop(task, None)
        for requirement in self.requirements[task]:
            if requirement.value == 0:
                self.unmet[task] = requirement.line
                return
