"""Warnings about what contexts do to tasks: effects that never count, and bounds that break what tasks need."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.dependencies import TaskTree
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Effect
from contextpolicy.policy.validation.in_vain import InVain
from contextpolicy.policy.validation.needs import unmet
from contextpolicy.policy.validation.silence import steered
from contextpolicy.policy.validation.situations import Situations

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Context, Policy, Task


def effects(policy: Policy) -> Iterator[Finding]:
    """Each effect of a context that can't be what its author wants, and each `max` below what its task needs."""
    own = _Effects(policy)
    for index, task in enumerate(policy.tasks):
        if task.max is not None:
            for need, value, why in unmet(task, task.max, policy.enforcement):
                yield Finding(f"spec.tasks[{index}].needs.{need}", value, why)
    for index in range(len(policy.contexts)):
        yield from own.of(index)


class _Effects:
    """All of one policy."""

    def __init__(self, policy: Policy) -> None:
        self._policy, self._situations = policy, Situations(policy)
        self._tree, self._steered = TaskTree(policy), steered(policy)
        self._in_vain = InVain(policy, self._situations)

    def of(self, index: int) -> Iterator[Finding]:
        """The findings about one context's effects."""
        context = self._policy.contexts[index]
        if context.when and context.name not in self._steered and self._situations.never(context.when):
            return  # that is what is wrong with it
        for name in context.effects:
            field, task = f"spec.contexts[{index}].tasks.{name}", self._tree.tasks[name]
            yield from self._protected(field, context, name)
            yield from self._too_little(field, context, task)
            yield from self._in_vain.of(field, context, task)
            for later in self._policy.contexts[index + 1 :]:
                yield from self._beside(field, context, later, name)
                yield from self._apart(field, context, later, name)

    def _too_little(self, field: str, context: Context, task: Task) -> Iterator[Finding]:
        most = context.effects[task.name].max
        if most is None or (task.max is not None and any(unmet(task, task.max, self._policy.enforcement))):
            return
        suspends = task.needs.enforce is Enforce.SUSPEND
        so = f": {task.name} is suspended while {context.name} holds" if suspends else f", while {context.name} holds"
        for _, _, why in unmet(task, most, self._policy.enforcement):
            yield Finding(f"{field}.max", format_cpu(most), f"{why.removesuffix(': never feasible')}{so}")

    def _protected(self, field: str, context: Context, name: str) -> Iterator[Finding]:
        """A suspension of a protected task, directly or of one that it is a part of."""
        if not context.effects[name].suspends:
            return
        for task in self._policy.tasks:
            if task.protected and name in (task.name, *self._tree.ancestors(task.name)):
                part = "" if name == task.name else f", of which {task.name} is a part"
                message = f"context {context.name} suspends {name}{part}: it has no effect on {task.name}, "
                yield Finding(field, task.name, f"{message}which is protected")

    def _beside(self, field: str, context: Context, later: Context, name: str) -> Iterator[Finding]:
        """What a later context undoes that always holds beside this one."""
        effect, other = context.effects[name], _of(name, later)
        undone = list(_undone(effect, other))
        if undone and self._accompanies(later, context):
            message = f"has no effect: {later.name}, which comes later, holds whenever {context.name} does"
            yield from (Finding(f"{field}.{what}", value, f"{what} {message}") for what, value in undone)

    def _apart(self, field: str, context: Context, later: Context, name: str) -> Iterator[Finding]:
        """Bounds of two contexts that no share meets, although both may hold."""
        own, other = context.effects[name], _of(name, later)
        crossing = [("min", own.min, "above", "max", other.max), ("max", own.max, "below", "min", other.min)]
        for what, bound, side, theirs, limit in crossing:
            if bound is None or limit is None or (bound <= limit if what == "min" else bound >= limit):
                continue
            if not self._situations.excludes(context, later):
                message = f"is {side} the {theirs} {format_cpu(limit)} of {later.name}, which may hold beside "
                message += f"{context.name}: {later.name} comes later, so {name} then gets {format_cpu(limit)}"
                yield Finding(f"{field}.{what}", format_cpu(bound), message)

    def _accompanies(self, later: Context, context: Context) -> bool:
        """Whether it surely holds from the first to the last moment of the other."""
        if self._situations.never(f"contexts['{context.name}']", f"!contexts['{later.name}']"):
            return True
        delays = later.enter_after <= context.enter_after and later.exit_after >= context.exit_after
        plain = not context.until and context.name not in self._steered
        return plain and delays and self._situations.follows(later, context)


def _of(name: str, context: Context) -> Effect:
    return context.effects.get(name, Effect())


def _undone(own: Effect, later: Effect) -> Iterator[tuple[str, object]]:
    """The fields of an effect, with their values, that a later one leaves without any."""
    lets_run = later.suspend is False
    for what, factor in (("weight", own.weight), ("scale", own.scale)):
        if factor is not None and (later.weight if factor else lets_run):
            yield what, factor
    if own.suspend is not None and (lets_run if own.suspend else later.suspends):
        yield "suspend", own.suspend
    for what, bound, theirs in (("min", own.min, later.min), ("max", own.max, later.max)):
        if bound is not None and theirs is not None:
            yield what, format_cpu(bound)
