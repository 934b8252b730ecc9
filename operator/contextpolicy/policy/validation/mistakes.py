"""Mistakes that the API server cannot detect: refused by `validate` and by the operator alike."""

from __future__ import annotations

from itertools import chain, islice
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding
from contextpolicy.policy.fields import MOST_FINDINGS
from contextpolicy.policy.key_expressions import meet
from contextpolicy.policy.quantities import format_cpu
from contextpolicy.policy.ros_types import type_findings
from contextpolicy.policy.spec import Scheduler
from contextpolicy.policy.validation.ros_keys import ros_key_findings
from contextpolicy.policy.validation.type_check import expression_findings

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy

DECISIONS = ("plan", "applied", "explain")
"""The last chunk of the decision bus's keys."""
CONFIRMATIONS = "contextpolicy/agents/*/confirmed"
"""What agents say of the plans of all namespaces."""
STEP = 10
"""Thousandths of a core: CPU limits move in steps of 10m, the kubelet's smallest quota."""


def mistakes_in(policy: Policy) -> tuple[Finding, ...]:
    """The reasons to refuse a policy that parses."""
    found = chain(
        type_findings(policy),
        ros_key_findings(policy),
        _decisions(policy),
        expression_findings(policy),
        _debounce(policy),
        _steps(policy),
    )
    return tuple(islice(found, MOST_FINDINGS))


def _decisions(policy: Policy) -> Iterator[Finding]:
    """Streams that receive what the operator decides for other namespaces, as one with the key `**` does."""
    own = f"contextpolicy/{policy.namespace}/"
    for index, stream in enumerate(policy.streams):
        others = () if stream.key.startswith(own) else (f"contextpolicy/*/*/{what}" for what in DECISIONS)
        if any(meet(stream.key, key) for key in (*others, CONFIRMATIONS)):
            allowed = "a key that excludes what the operator publishes for other namespaces (contextpolicy/**)"
            yield Finding(f"spec.streams[{index}].key", stream.key, allowed)


def _debounce(policy: Policy) -> Iterator[Finding]:
    for index, stream in enumerate(policy.streams):
        if stream.stale_after is not None and stream.debounce >= stream.stale_after > 0:
            allowed = f"a debounce below staleAfter, {stream.stale_after:g} s, or it is silent before a sample passes"
            yield Finding(f"spec.streams[{index}]", stream.name, allowed)


def _steps(policy: Policy) -> Iterator[Finding]:
    """A max that falls below min when rounded down to a step. Realtime budgets move in finer steps."""
    if policy.enforcement.scheduler is Scheduler.REALTIME:
        return
    for index, task in enumerate(policy.tasks):
        if task.max is not None and task.max // STEP * STEP < task.min <= task.max:
            allowed = f"a max with a multiple of {STEP}m between min, {format_cpu(task.min)}, and max"
            yield Finding(f"spec.tasks[{index}].max", format_cpu(task.max), allowed)
