"""What is due in a story: read from its timeline and recordings, and from the simulation of its policy."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams.timeline import load
from timelines.experiments.due import TENTHS, Schedule, windows
from timelines.experiments.tasks import inputs_of, tasks_of
from timelines.replay.player import TimelineInputs
from timelines.scenarios.inputs import WORD_S

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.timeline import Timeline
    from timelines.experiments.stories import Story


def schedule(story: Story, path: Path, datasets: Path, deadlines: Mapping[str, float], cores: int) -> Schedule:
    """What is due in a story on a node with so many cores; DatasetError if a recording is missing."""
    timeline = load(path)
    policy = without_delays(load_policy(str(story.policy_file)))
    plans = simulate(policy, timeline, robot=Robot({NODE: cores * 1000})).plans
    keys = _times(timeline, datasets)
    inputs = {task: {name: key for name, key in inputs_of(task).items() if key in keys} for task in tasks_of(story)}
    found = windows(plans, timeline.duration)
    return Schedule(timeline.duration, keys, inputs, dict(deadlines), found, _stops(timeline))


def without_delays(policy: Policy) -> Policy:
    """What matters when: a delay with which a policy follows that is its means, and none may change what is due."""
    return replace(policy, contexts=tuple(replace(one, enter_after=0.0, exit_after=0.0) for one in policy.contexts))


def fingerprint(story: Story, timeline: Path, deadlines: Mapping[str, float]) -> str:
    """Of all that a story's schedule follows from, but for recordings, which have one of their own."""
    digest = hashlib.sha256(repr(sorted(deadlines.items())).encode())
    for path in (timeline, story.policy_file):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _times(timeline: Timeline, datasets: Path) -> dict[str, list[float]]:
    """When each key's inputs come, in tenths of a millisecond, as they are kept."""
    found: dict[str, list[float]] = defaultdict(list)
    for at, key, _ in TimelineInputs(timeline, datasets).timed(0.0):
        if at < timeline.duration:
            found[key].append(round(at * TENTHS) / TENTHS)
    return dict(found)


def _stops(timeline: Timeline) -> list[tuple[float, float]]:
    words = [word for one in timeline.entries if one.key == "robot/microphone" for word in _list(one.truth)]
    return [(word["at"], round(word["at"] + WORD_S, 6)) for word in words if word["keyword"] == "stop"]


def _list(truth: object) -> list[Any]:
    return truth if isinstance(truth, list) else []
