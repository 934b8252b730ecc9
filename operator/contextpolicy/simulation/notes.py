"""What the plans do not show: unread inputs, unfed streams, samples and expressions that failed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.explain.deciding import waits

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.policy.spec import Policy
    from contextpolicy.simulation.noting_planner import NotingPlanner
    from contextpolicy.simulation.robot import Robot
    from contextpolicy.simulation.run import Simulation

MOST_SHORTFALLS = 20
MOST_REASONS = 3
"""Why samples of one stream could not be decoded."""


def notes(policy: Policy, robot: Robot, run: Simulation) -> list[str]:
    """The notes, one sentence each."""
    return [
        *(f"no stream reads {key}" for key in sorted(run.skipped.unread)),
        *(f"{key} is a data set, without values" for key in sorted(run.skipped.without_value)),
        *_unfed(policy, run),
        *_mistyped(policy, run),
        *_undecodable(run),
        *_drops(run.planner),
        *_failures(run.planner),
        *_waits(run),
        *(f"node {node} can't do realtime and is left alone" for node in robot.left_alone(policy)),
        *(_no_plan(run) if not run.plans else _shortfalls(run)),
    ]


def _unfed(policy: Policy, run: Simulation) -> Iterator[str]:
    for stream in policy.streams:
        if stream.name not in run.skipped.fed:
            yield f"the timeline has no input for stream {stream.name} ({stream.key})"


def _mistyped(policy: Policy, run: Simulation) -> Iterator[str]:
    types = {stream.name: stream.type for stream in policy.streams}
    for stream, recorded in sorted(run.skipped.mistyped):
        yield f"the recording has {recorded}, but stream {stream} expects {types[stream]}: no messages are read"


def _undecodable(run: Simulation) -> Iterator[str]:
    """The most frequent reasons of each stream; those that differ in a number only could be hundreds."""
    by_stream: dict[str, list[tuple[str, int]]] = {}
    for reason, count in run.skipped.undecodable.most_common():
        by_stream.setdefault(reason.partition(":")[0], []).append((reason, count))
    for stream, reasons in by_stream.items():
        yield from (f"{reason}, {_times(count)}" for reason, count in reasons[:MOST_REASONS])
        rest = [count for _, count in reasons[MOST_REASONS:]]
        if rest:
            yield f"{stream}: {sum(rest)} more samples can't be decoded, for {len(rest)} other reasons"


def _drops(planner: NotingPlanner) -> Iterator[str]:
    """Drops by stream and reason, without those that other notes report in full."""
    for (stream, reason), count in planner.drops.items():
        if stream and reason not in ("undecodable", "expression"):
            yield f"stream {stream}: {reason}, {_times(count)}"


def _failures(planner: NotingPlanner) -> Iterator[str]:
    for source, failure in planner.failures.items():
        yield "; ".join(filter(None, (f"{source}: {failure.reason}", failure.values, _times(failure.count))))
    for source, reason in planner.errors.items():
        if source not in planner.failures:
            yield f"{source}: {reason}"


def _waits(run: Simulation) -> Iterator[str]:
    for owner, waiting in waits(run.planner):
        since = round(waiting.since - run.epoch, 6)
        yield f"{owner} waits for stream {waiting.stream} at the end, since {since:g} s: {waiting.reason}"


def _shortfalls(run: Simulation) -> Iterator[str]:
    first: dict[str, float] = {}
    for plan in run.plans:
        for shortfall in plan.shortfalls:
            first.setdefault(f"{shortfall.task} {shortfall.message}".strip(), plan.time)
    for message, time in list(first.items())[:MOST_SHORTFALLS]:
        yield f"not feasible from {time:g} s: {message}"
    if len(first) > MOST_SHORTFALLS:
        yield f"not feasible in {len(first) - MOST_SHORTFALLS} more ways"


def _no_plan(run: Simulation) -> Iterator[str]:
    shortfalls = run.planner.last.shortfalls if run.planner.last else ()
    reasons = [f"{shortfall.task} {shortfall.message}".strip() for shortfall in shortfalls]
    yield f"there is no plan: {'; '.join(reasons) or 'the policy has no container on these nodes'}"


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
