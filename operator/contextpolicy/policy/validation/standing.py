"""Warnings about activities that are no events: what begins once and never ends, or never begins."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.validation.cases import implies, never_hold
from contextpolicy.policy.validation.unknowns import compiled

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.activities import Activity
    from contextpolicy.policy.spec import Policy


def standing(policy: Policy) -> Iterator[Finding]:
    """Each activity that can't come and go, with its fields that have no effect."""
    lasting = {one.name for one in policy.streams if one.stale_after is None and not one.liveliness}
    for index, task in enumerate(policy.tasks):
        for number, own in enumerate(task.activity):
            field, read = f"spec.tasks[{index}].activity[{number}]", compiled(own.when)
            if not own.counts:
                yield Finding(f"{field}.score", 0, "an activity with score 0 never counts")
            elif task.priority and task.idle and not own.exceeds(task.idle):
                message = f"never counts: by its idle {task.name} scores {task.idle:g} anyway"
                yield Finding(f"{field}.score", own.score, message)
            elif not (read.variables or read.contexts or own.until or own.score_from or own.initiative):
                yield from _constant(field, own, lasting)


def _constant(field: str, own: Activity, lasting: set[str]) -> Iterator[Finding]:
    """An activity of which only silence could end what a sample begins."""
    if never_hold(own.when):
        yield Finding(f"{field}.when", own.when, "never holds, so the activity never counts")
    elif not implies("true", own.when):
        return
    elif own.stream is None:
        for name, value in (("hold", own.hold), ("decay", own.decay)):
            if value:
                message = f"{name} has no effect: an activity that reads no stream is always in force"
                yield Finding(f"{field}.{name}", value, message)
    elif not own.hold and own.stream in lasting:
        message = f"once {own.stream} is heard it counts for ever: hold, when, until or staleAfter would end it"
        yield Finding(f"{field}.stream", own.stream, message)
