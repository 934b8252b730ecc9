"""A policy as it is now, for people: one JSON document for the live page, `top` and `status`. Pure.

==========  ==========================================================================================================
field       meaning
==========  ==========================================================================================================
policy      `namespace/name`
uid         the object's: a policy that is made again under the same name is another one
now         Unix seconds
conditions  as in the status
plan        the message of the decision bus (see `planning.plan_json`) for the plan in force; null before the first
streams     by name: `key`, `age` (s; null before the first sample), `silent`, `staleAfter`, `samples` (how many came)
contexts    by name: `active`, `color`, and `why`, a sentence
why         by task: sentences
colors      by task that has a share of its own: `#rrggbb` (see `explain.palette`)
containers  each claimed one: `task`, `node`, `pod`, `container`, `cores` (planned), `limit` (in force; null unknown),
            `use` (cores) and `throttled` (part of its periods), null where no agent measures them
health      by task, what its module says once a second, where the policy reads it: `misses` (part of its inputs),
            `queue` (inputs that wait) and `latency` (s); null where the message lacks it. Stale health is left out
reactions   `count`, `median`, `worst` and `last` of the latest reactions to samples, in seconds; null without any
==========  ==========================================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from statistics import median
from typing import TYPE_CHECKING, Any

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.palette import context_colors, task_colors
from contextpolicy.explain.sentences import context_sentences, sentences

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.bus.usage_watch import Usage
    from contextpolicy.planning.planner import Planner


HEALTH_OLD = 5.0
"""Seconds after which a module's report is no longer shown: modules report once a second."""


@dataclass(frozen=True, slots=True)
class Alive:
    """One policy at one instant: `plan` is its message for the bus, `usage` what agents measured, by container ID.

    `now` is planning time, which is `ahead` seconds of the wall clock.
    """

    policy: str
    uid: str
    now: float
    ahead: float
    conditions: Sequence[Mapping[str, Any]]
    planner: Planner | None
    plan: Mapping[str, Any] | None
    reactions: Sequence[float]
    usage: Mapping[str, Usage]


def board(alive: Alive) -> dict[str, Any]:
    """The document."""
    explanation = explain(alive.planner, alive.now, alive.ahead) if alive.planner else None
    return {
        "policy": alive.policy,
        "uid": alive.uid,
        "now": alive.now - alive.ahead,
        "conditions": [dict(condition) for condition in alive.conditions],
        "plan": alive.plan,
        "streams": _streams(alive.planner, explanation) if alive.planner and explanation else {},
        "contexts": _contexts(explanation) if explanation else {},
        "why": {task: sentences(explanation, task) for task in explanation["tasks"]} if explanation else {},
        "colors": task_colors(leaf.name for leaf in alive.planner.policy.leaves) if alive.planner else {},
        "containers": list(_containers(alive)),
        "health": _health(explanation) if explanation else {},
        "reactions": _reactions(alive.reactions),
    }


def _streams(planner: Planner, explanation: Mapping[str, Any]) -> dict[str, Any]:
    shown = ("key", "age", "silent", "staleAfter")
    return {
        name: {field: stream[field] for field in shown} | {"samples": planner.streams[name].seen}
        for name, stream in explanation["streams"].items()
    }


def _contexts(explanation: Mapping[str, Any]) -> dict[str, Any]:
    found: Mapping[str, Any] = explanation["contexts"]
    colors = context_colors(found)
    return {
        name: {"active": context["active"], "color": colors[name], "why": why}
        for (name, context), why in zip(found.items(), context_sentences(explanation), strict=True)
    }


def _health(explanation: Mapping[str, Any]) -> dict[str, Any]:
    """A module publishes to a key that ends in its task's name and `health` (see `robotkit.health`)."""
    found = {}
    for stream in explanation["streams"].values():
        key: str = stream["key"]
        *_, task, kind = ["", *key.split("/")]
        said = stream["value"]
        heard = stream["age"] is not None and stream["age"] < HEALTH_OLD and not stream["silent"]
        if heard and kind == "health" and task in explanation["tasks"] and isinstance(said, dict):
            found[task] = {name: _number(said.get(name)) for name in ("misses", "queue", "latency")}
    return found


def _number(value: object) -> float | None:
    return value if isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value) else None


def _containers(alive: Alive) -> Iterator[dict[str, Any]]:
    for target in alive.plan["targets"] if alive.plan else ():
        usage = alive.usage.get(target["containerId"])
        yield {
            **{field: target[field] for field in ("task", "node", "pod", "container", "cores", "limit")},
            "use": usage.cores if usage else None,
            "throttled": usage.throttled if usage else None,
        }


def _reactions(seconds: Sequence[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    return {"count": len(seconds), "median": median(seconds), "worst": max(seconds), "last": seconds[-1]}
