"""Instantiation functions that users plug in through the Python entry point group `contextpolicy.initiatives`.

A function takes `streams` (name -> observable of samples' fields), `scheduler` and the activity's `with` as keyword
arguments, and returns an observable of scores (paper IV-D).
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from contextpolicy.errors import Finding, PolicyError

if TYPE_CHECKING:
    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.planning.policy import Policy

GROUP = "contextpolicy.initiatives"


def load(policy: Policy) -> dict[str, Instantiate]:
    """The functions that the policy names; PolicyError when one is not installed."""
    installed = {entry.name: entry for entry in entry_points(group=GROUP)}
    wanted = {a.initiative: t.name for t in policy.tasks for a in t.activity if a.initiative is not None}
    missing = tuple(
        Finding(f"spec.tasks[{task}].activity.initiative", name, f"installed: {', '.join(sorted(installed)) or 'none'}")
        for name, task in wanted.items()
        if name not in installed
    )
    if missing:
        raise PolicyError(f"ContextPolicy {policy.reference}", missing)
    return {name: installed[name].load() for name in wanted}
