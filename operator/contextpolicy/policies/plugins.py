"""Instantiation functions that users plug in through the Python entry point group `contextpolicy.initiatives`.

A function takes `streams` (name -> observable of samples' fields), `scheduler` and the activity's `with` as keyword
arguments, and returns an observable of scores (paper IV-D). A failure is reported in the status like that of an
expression, and the function is called again.
"""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import TYPE_CHECKING

from contextpolicy.errors import Fault, Finding, PolicyError

if TYPE_CHECKING:
    from collections.abc import Mapping
    from importlib.metadata import EntryPoint

    from contextpolicy.planning.observable import Instantiate
    from contextpolicy.policy.spec import Policy

GROUP = "contextpolicy.initiatives"


def load(policy: Policy) -> dict[str, Instantiate]:
    """The functions that the policy names; PolicyError when one is not installed or can't be imported."""
    installed = {entry.name: entry for entry in entry_points(group=GROUP)}
    wanted = {a.initiative: t.name for t in policy.tasks for a in t.activity if a.initiative is not None}
    loaded: dict[str, Instantiate] = {}
    findings = []
    for name, task in wanted.items():
        problem = _load(name, installed, loaded)
        if problem:
            findings.append(Finding(f"spec.tasks[{task}].activity.initiative", name, problem, Fault.RULE))
    if findings:
        raise PolicyError(f"ContextPolicy {policy.reference}", tuple(findings))
    return loaded


def _load(name: str, installed: Mapping[str, EntryPoint], loaded: dict[str, Instantiate]) -> str:
    """Load one function into `loaded`; returns what is wrong, or an empty string."""
    if name not in installed:
        return f"expected an installed function: {', '.join(sorted(installed)) or 'there is none'}"
    try:
        loaded[name] = installed[name].load()
    except Exception as error:  # noqa: BLE001 - importing foreign code may raise anything
        return f"expected a function that can be imported; {type(error).__name__}: {error}"
    return ""
