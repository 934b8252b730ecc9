"""Where the plans of a policy and of its shadow differ, over a stretch of time. Pure.

Plans are messages of the decision bus, each with when it was `published` (Unix seconds), oldest first.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    Message = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class TaskDifference:
    """One task under policy and shadow: its mean share in cores, and the part of the time for which it is suspended.

    A task that one of them does not have has nothing there.
    """

    share: tuple[float, float]
    suspended: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time in which shares differ: those of the policy and of its shadow in cores, by task, and both's contexts."""

    start: float
    end: float
    contexts: tuple[tuple[str, ...], tuple[str, ...]]
    shares: Mapping[str, tuple[float, float]]


@dataclass(frozen=True, slots=True)
class ShadowDifference:
    """From `start` to `end` in Unix seconds; `part` of that time, without pauses, the shares differ."""

    start: float
    end: float
    part: float
    tasks: Mapping[str, TaskDifference]
    stretches: Sequence[Stretch]


def difference(
    policy: Sequence[Message], shadow: Sequence[Message], since: float, now: float
) -> ShadowDifference | None:
    """Compare from `since` on, or from when both had a plan; None when they have not been side by side."""
    if not (policy and shadow):
        return None
    start = max(since, policy[0]["published"], shadow[0]["published"])
    if start >= now:
        return None
    pairs = list(_pairs(policy, shadow, start, now))
    seconds = sum(end - begin for _, _, begin, end in pairs)
    if not seconds:
        return None
    names = sorted({name for one, other, _, _ in pairs for name in (*one["tasks"], *other["tasks"])})
    stretches = list(_stretches(pairs))
    part = sum(own.end - own.start for own in stretches) / seconds
    return ShadowDifference(start, now, part, {name: _task(pairs, name, seconds) for name in names}, stretches)


def _pairs(
    policy: Sequence[Message], shadow: Sequence[Message], start: float, now: float
) -> Iterator[tuple[Message, Message, float, float]]:
    """The plans that were in force together, from when to when; in a pause there is none."""
    changes = {
        plan[field] for plan in (*policy, *shadow) for field in ("published", "until") if plan[field] is not None
    }
    for begin, end in pairwise([start, *sorted(moment for moment in changes if start < moment < now), now]):
        one, other = _at(policy, begin), _at(shadow, begin)
        if one is not None and other is not None:
            yield one, other, begin, end


def _at(plans: Sequence[Message], moment: float) -> Message | None:
    plan = next(plan for plan in reversed(plans) if plan["published"] <= moment)
    return plan if plan["until"] is None or moment < plan["until"] else None


def _stretches(pairs: Sequence[tuple[Message, Message, float, float]]) -> Iterator[Stretch]:
    """Times in a row in which nothing changes are one."""
    last: Stretch | None = None
    for one, other, begin, end in pairs:
        contexts = tuple(one["contexts"]), tuple(other["contexts"])
        shares = {
            name: (_share(one, name), _share(other, name))
            for name in sorted({*one["tasks"], *other["tasks"]})
            if _share(one, name) != _share(other, name)
        }
        if last is not None and (last.end, last.contexts, last.shares) == (begin, contexts, shares):
            last = Stretch(last.start, end, contexts, shares)
            continue
        if last is not None and last.shares:
            yield last
        last = Stretch(begin, end, contexts, shares)
    if last is not None and last.shares:
        yield last


def _task(pairs: Sequence[tuple[Message, Message, float, float]], name: str, seconds: float) -> TaskDifference:
    shares, suspended = [0.0, 0.0], [0.0, 0.0]
    for *plans, begin, end in pairs:
        for index, plan in enumerate(plans):
            shares[index] += _share(plan, name) * (end - begin) / seconds
            suspended[index] += bool(plan["tasks"].get(name, {}).get("suspended")) * (end - begin) / seconds
    return TaskDifference((shares[0], shares[1]), (suspended[0], suspended[1]))


def _share(plan: Message, task: str) -> float:
    share: float = plan["tasks"].get(task, {}).get("share", 0.0)
    return share
