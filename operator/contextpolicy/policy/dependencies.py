"""Which tasks can't run without which others: the task graph's edges, depth and cycles (paper III, Figs. 2, 4)."""

from __future__ import annotations

from graphlib import CycleError, TopologicalSorter
from typing import TYPE_CHECKING

from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.cel import shared
from contextpolicy.policy.spec import SatisfiedBy

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from contextpolicy.policy.spec import Policy, Task

LEVELS = 8
"""How deep a task graph may be: more than any that we know of, and few enough for a person to follow."""
MOST_CYCLES = 16


class TaskTree:
    """The tasks by name, with their parents.

    `references` uses it to check policies, so unknown names and cycles must do no harm; only `order` fails on cycles.
    """

    def __init__(self, policy: Policy) -> None:
        self.tasks = {task.name: task for task in policy.tasks}
        self.parents = {name: task.name for task in policy.tasks for name in task.subtasks}
        self._producers = {stream.name: stream.produced_by for stream in policy.streams}

    def ancestors(self, name: str) -> list[str]:
        """The tasks that this one is a part of, from its parent up."""
        above: list[str] = []
        while (parent := self.parents.get(name)) is not None and parent not in above:
            above.append(parent)
            name = parent
        return above

    def dependencies(self, name: str) -> dict[str, str]:
        """The tasks that must be able to run before this one is, each with the reason in a few words."""
        task = self.tasks[name]
        found = dict.fromkeys(task.subtasks, "its subtask")
        for required in task.required_tasks:
            for one in (required, *self.outside(name, required)):
                found.setdefault(one, f"it requires task {required}")
        for stream, producer in self._produced(task):
            for one in (producer, *self._bosses(name, producer)):
                found.setdefault(one, f"it requires stream {stream} of {producer}")
        return {one: why for one, why in found.items() if one in self.tasks}

    def outside(self, name: str, required: str) -> list[str]:
        """The ancestors of `required` that are not also those of `name`: suspending one suspends `required`."""
        own = self.ancestors(name)
        return [one for one in self.ancestors(required) if one not in own and one != name]

    def order(self) -> list[str]:
        """All tasks, each after those that it depends on; CycleError if they wait for each other."""
        return list(TopologicalSorter(self._graph()).static_order())

    def cycles(self) -> Iterator[list[str]]:
        """Tasks that wait for each other, each followed by the one that it waits for, the first repeated at the end.

        Not every cycle: one edge of each that is found is removed before the next search.
        """
        graph = self._graph()
        places = {name: place for place, name in enumerate(self.tasks)}
        for _ in range(MOST_CYCLES):
            try:
                TopologicalSorter(graph).prepare()
            except CycleError as error:
                cycle = list(reversed(error.args[1][1:]))
                first = min(range(len(cycle)), key=lambda at: places[cycle[at]])
                cycle = [*cycle[first:], *cycle[:first]]
                graph[cycle[0]].remove(cycle[1 % len(cycle)])
                yield [*cycle, cycle[0]]
            else:
                return

    def _graph(self) -> Mapping[str, set[str]]:
        return {name: set(self.dependencies(name)) for name in self.tasks}

    def _produced(self, task: Task) -> Iterator[tuple[str, str]]:
        """The streams that a task's pre-conditions read, with the tasks that produce them."""
        for requirement in task.preconditions:
            for stream in sorted(shared(requirement.when).variables):
                producer = self._producers.get(stream)
                if producer is not None:
                    yield stream, producer

    def _bosses(self, name: str, producer: str) -> Iterator[str]:
        """The ancestors of a producer that must be able to run before `name` is.

        A complex task that contains both is not one of them: it can run with the producer alone.
        """
        own = self.ancestors(name)
        for one in self.ancestors(producer):
            if one not in own or self.tasks[one].satisfied_by is SatisfiedBy.ALL:
                yield one


def suspendable(policy: Policy, task: Task) -> bool:
    """Whether anything can suspend the task: what it waits for, a context, or a task that it is a part of."""
    if task.requires or task.protected:
        return bool(task.requires)
    effects = [context.effects[task.name] for context in policy.contexts if task.name in context.effects]
    own = task.activity or not task.priority or task.needs.enforce is Enforce.SUSPEND
    return bool(own or TaskTree(policy).ancestors(task.name) or any(effect.suspends for effect in effects))
