"""Which needs of a task its `max`, or a context's, leaves unmet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.bandwidth import throttle_gap
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.spec import Scheduler

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Effect, Enforcement, Task


def unmet(task: Task, most: int, enforcement: Enforcement) -> Iterator[tuple[str, float, str]]:
    """Each need that a task can't have met with a `max`: its name, its value, and why."""
    needs = task.needs
    if needs.cores is not None and needs.cores > most:
        why = f"needs {format_cpu(needs.cores)} cores, but max allows {format_cpu(most)}: never feasible"
        yield "cores", needs.cores, why
    gap = throttle_gap(most, enforcement.period) if enforcement.scheduler is Scheduler.CFS else 0.0
    if needs.deadline is not None and gap > needs.deadline:
        why = f"with max {format_cpu(most)} it may stall for {gap:.3g} s, longer than its deadline"
        yield "deadline", needs.deadline, why


def suspends(task: Task, effect: Effect, enforcement: Enforcement) -> bool:
    """Whether an effect's `max` suspends a task that says so of its needs."""
    if effect.max is None or task.needs.enforce is not Enforce.SUSPEND:
        return False
    return any(unmet(task, effect.max, enforcement))
