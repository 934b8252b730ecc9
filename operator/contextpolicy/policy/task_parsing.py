"""A task of a ContextPolicy, with its needs, activities and requirements, as read from `spec.tasks`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy import activities
from contextpolicy.policy import spec as policy
from contextpolicy.policy.field_types import value_of
from contextpolicy.policy.fields import TASK_NAME, TASK_NAME_ALLOWED
from contextpolicy.policy.selectors import read_selector

if TYPE_CHECKING:
    from contextpolicy.policy.fields import Fields

LEAST = 10
"""Thousandths of a core: no container can have less."""


def parse_task(fields: Fields) -> policy.Task:
    """Read an entry of `spec.tasks`; the fields hold what is wrong with it."""
    name = fields.text("name", pattern=TASK_NAME, allowed=TASK_NAME_ALLOWED)
    result = value_of(
        policy.Task,
        fields,
        name=name,
        selector=read_selector(fields.nested("selector")) if "selector" in fields else fields.raw("selector"),
        container=fields.text("container", name),
        min=max(LEAST, fields.cpu("min") or 0),
        suspended_cpu=max(LEAST, fields.cpu("suspendedCpu") or 0),
        needs=_needs(fields.nested("needs")),
        activity=tuple(_activity(item) for item in fields.nested_list("activity", limit=16)),
        requires=tuple(_requirement(item) for item in fields.nested_list("requires", limit=16)),
        subtasks=fields.texts("subtasks", limit=16),
    )
    _check_kind(fields, result)
    _check_bounds(fields, result)
    _check_protection(fields, result)
    fields.close()
    return result


def _check_kind(fields: Fields, task: policy.Task) -> None:
    """A task runs in a container, or is a group of others."""
    if (task.selector is None) == (not task.subtasks):
        allowed = "either a selector (a task in containers) or subtasks (a group of tasks)"
        fields.refuse("selector", fields.raw("selector"), allowed)
    if task.subtasks:
        for group_less in ("min", "max", "suspendedCpu", "needs", "container", "restartOnResize", "required"):
            if group_less in fields:
                allowed = "only on a task with a selector: a task with subtasks has no container"
                fields.refuse(group_less, fields.raw(group_less), allowed)


def _check_bounds(fields: Fields, task: policy.Task) -> None:
    if task.max is None:
        return
    if task.max < LEAST:
        fields.refuse("max", fields.raw("max"), f"at least {LEAST}m, the least that Linux can give to a container")
    elif task.max < task.min:
        fields.refuse("max", fields.raw("max"), f"at least min, {fields.raw('min')}")
    elif task.max < task.suspended_cpu:
        fields.refuse("suspendedCpu", fields.raw("suspendedCpu"), "at most max")


def _check_protection(fields: Fields, task: policy.Task) -> None:
    if task.protected and task.subtasks:
        allowed = "true only on a task with a selector: protect the subtasks that need it"
        fields.refuse("protected", fields.raw("protected"), allowed)
    if task.protected and task.needs.enforce is activities.Enforce.SUSPEND:
        fields.refuse("needs.enforce", task.needs.enforce.value, "Report: a protected task is never suspended")


def _needs(fields: Fields) -> activities.Needs:
    result = value_of(activities.Needs, fields)
    fields.close()
    return result


def _activity(fields: Fields) -> activities.Activity:
    result = value_of(activities.Activity, fields, arguments=fields.string_map("with"))
    if "scoreFrom" in fields and "score" in fields:
        fields.refuse("score", fields.raw("score"), "either score or scoreFrom, not both")
    if result.until is not None and result.initiative is not None:
        fields.refuse("until", result.until, "only without initiative: the function decides when its score ends")
    fields.close()
    return result


def _requirement(fields: Fields) -> activities.Requirement:
    if ("when" in fields) == ("task" in fields):
        fields.refuse("when", fields.raw("when"), "either when, a CEL condition, or task, the name of another task")
    result = value_of(activities.Requirement, fields)
    if result.task is not None and "hold" in fields:
        fields.refuse("hold", fields.raw("hold"), "only with when: a task either can run or can't")
    fields.close()
    return result
