"""A policy as it is now, for people: one JSON document for the live page, `top` and `status`. Pure.

==========  ==========================================================================================================
field       meaning
==========  ==========================================================================================================
policy      `namespace/name`
now         Unix seconds, by the operator's clock
conditions  as in the status
plan        the message of the decision bus (see `planning.plan_json`) for the plan in force; null before the first
streams     by name: `key`, `age` (s; null before the first sample), `silent`, `staleAfter`, `samples` (how many came)
contexts    by name: `active`, and `why`, a sentence
why         by task: sentences
containers  each claimed one: `task`, `node`, `pod`, `container`, `cores` (planned), `limit` (in force; null unknown),
            `use` (cores) and `throttled` (part of its periods), null where no agent measures them
reactions   `count`, `median`, `worst` and `last` of the latest reactions to samples, in seconds; null without any
==========  ==========================================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any

from contextpolicy.explain.explanation import explain
from contextpolicy.explain.sentences import context_sentences, sentences

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from contextpolicy.bus.usage_watch import Usage
    from contextpolicy.planning.planner import Planner


@dataclass(frozen=True, slots=True)
class Alive:
    """One policy at one instant: `plan` is its message for the bus, `usage` what agents measured, by container ID."""

    policy: str
    now: float
    conditions: Sequence[Mapping[str, Any]]
    planner: Planner | None
    plan: Mapping[str, Any] | None
    reactions: Sequence[float]
    usage: Mapping[str, Usage]


def board(alive: Alive) -> dict[str, Any]:
    """The document."""
    explanation = explain(alive.planner, alive.now) if alive.planner else None
    return {
        "policy": alive.policy,
        "now": alive.now,
        "conditions": [dict(condition) for condition in alive.conditions],
        "plan": alive.plan,
        "streams": _streams(alive.planner, explanation) if alive.planner and explanation else {},
        "contexts": _contexts(explanation) if explanation else {},
        "why": {task: sentences(explanation, task) for task in explanation["tasks"]} if explanation else {},
        "containers": list(_containers(alive)),
        "reactions": _reactions(alive.reactions),
    }


def _streams(planner: Planner, explanation: Mapping[str, Any]) -> dict[str, Any]:
    shown = ("key", "age", "silent", "staleAfter")
    return {
        name: {field: stream[field] for field in shown} | {"samples": planner.streams[name].seen}
        for name, stream in explanation["streams"].items()
    }


def _contexts(explanation: Mapping[str, Any]) -> dict[str, Any]:
    told = zip(explanation["contexts"].items(), context_sentences(explanation), strict=True)
    return {name: {"active": context["active"], "why": why} for (name, context), why in told}


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
