"""What `contextpolicy simulate --profiles` says of a run, from the policy, timeline and profiles that it kept."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.forecast import ALL, forecast
from contextpolicy.simulation.profiles import load_profiles
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams.timeline import load
from timelines.experiments import measures
from timelines.experiments.run import PROFILES, TIMELINE

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from contextpolicy.simulation.forecast import Forecast
    from timelines.experiments.raw_data import RunData

POLICY = "policy.yaml"
TAIL = 4
"""Times the inputs' length, until which queues are followed."""


class Compared(NamedTuple):
    """A task's median response time (seconds) and missed deadlines (part of what was due), predicted and measured."""

    task: str
    p50: tuple[float, float]
    misses: tuple[float, float]


def compare(run: RunData, folder: Path) -> Iterator[Compared]:
    """Each task of a run that was decided; nothing where no policy was in force or nothing was kept."""
    if not (folder / POLICY).is_file() or not (folder / PROFILES).is_file():
        return
    predicted = predict(folder, run.pace, run.about["machine"]["cores"])
    for task, contexts in predicted.tasks.items():
        measured = measures.response(run, task)
        own = contexts.get(ALL)
        if own is not None and own.p50 is not None and measured.p50 is not None:
            yield Compared(task, (own.p50, measured.p50), (own.misses, measured.misses))


def predict(folder: Path, pace: float, cores: int) -> Forecast:
    """The forecast for a run's folder."""
    policy, story = load_policy(str(folder / POLICY)), load(folder / TIMELINE).at_rate(pace)
    robot, until = Robot({NODE: cores * 1000}), TAIL * story.duration
    plans = simulate(policy, story, robot=robot, until=until).plans
    profiles = load_profiles(str(folder / PROFILES))
    return forecast(policy, story, plans, profiles, until=until)
