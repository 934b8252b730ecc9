"""Every expression of a policy that may read all of its streams, with its place."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.cel import shared

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from contextpolicy.policy.spec import Context, Policy


class Written(NamedTuple):
    """One expression: the path of its field, its source, and whether it is a number instead of a condition."""

    field: str
    source: str
    is_number: bool = False


def expressions(policy: Policy) -> Iterator[Written]:
    """The expressions of tasks and contexts; those of a stream read its own samples only."""
    for index, task in enumerate(policy.tasks):
        for number, activity in enumerate(task.activity):
            field = f"spec.tasks[{index}].activity[{number}]"
            yield Written(f"{field}.when", activity.when)
            if activity.until is not None:
                yield Written(f"{field}.until", activity.until)
            if activity.score_from is not None:
                yield Written(f"{field}.scoreFrom", activity.score_from, is_number=True)
        for number, requirement in enumerate(task.requires):
            if requirement.task is None:
                yield Written(f"spec.tasks[{index}].requires[{number}].when", requirement.when)
    for index, context in enumerate(policy.contexts):
        for name, source in (("when", context.when), ("until", context.until)):
            if source is not None:
                yield Written(f"spec.contexts[{index}].{name}", source)


def reads_of(contexts: Iterable[Context]) -> dict[str, list[str]]:
    """For each context the contexts that its conditions read, in alphabetical order."""
    return {context.name: sorted(_read(context)) for context in contexts}


def _read(context: Context) -> frozenset[str]:
    sources = filter(None, (context.when, context.until))
    return frozenset[str]().union(*(shared(source).contexts for source in sources))
