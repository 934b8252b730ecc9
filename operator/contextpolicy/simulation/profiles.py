"""What tasks cost, as robotkit measured it: CPU per input as a distribution, from a file with a profile for each task.

`python -m robotkit.profiles` writes such a file on a robot, modules/robotkit/profiles.schema.json describes it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from contextpolicy.errors import Fault, Finding, FindingsError, unreadable
from contextpolicy.policy.fields import Fields
from contextpolicy.policy.key_expressions import selects
from contextpolicy.streams.timeline import TimelineEntry

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.streams.timeline import Timeline

MOST = 256
"""Tasks of a file, and inputs of a task."""
MOST_THREADS = 1024
_GOLDEN = 0.6180339887498949
"""Steps of the golden ratio fill the unit interval more evenly than chance, and are the same each time."""
_UNQUEUED = 0.05
"""Part of the inputs that is taken to have met an empty queue: what they waited for is the task's thread to wake up."""
_TELLS = ("task", "module", "machine", "seconds", "failures", "adaptive")
_COUNTS = ("done", "missed", "dropped", "broken", "shared")
"""What robotkit also reports of a task and of an input, and the model does not need."""


class ProfileError(FindingsError):
    """A file of profiles that can't be used; the message lists everything that is wrong."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What one input costs: `quantiles` of CPU seconds, ascending, in equal steps from the least to the most."""

    key: str
    depth: int
    quantiles: tuple[float, ...]
    rate: float = 0.0
    """How many came in a second while it was measured."""
    transit: float = 0.0
    """Seconds on the bus, and until a task that has nothing else to do takes it up."""

    def work(self, number: int) -> float:
        """CPU seconds of the input with this number: over many inputs they are distributed as measured."""
        place = (0.5 + number * _GOLDEN) % 1.0 * (len(self.quantiles) - 1)
        low = int(place)
        high = min(low + 1, len(self.quantiles) - 1)
        return self.quantiles[low] + (place - low) * (self.quantiles[high] - self.quantiles[low])


@dataclass(frozen=True, slots=True)
class TaskProfile:
    """One task. `background` is the CPU in cores that it uses besides, `threads` how many cores one input can use."""

    deadline: float | None
    background: float
    threads: float
    inputs: tuple[Cost, ...]


@dataclass(frozen=True, slots=True)
class Profiles:
    """All tasks of a robot, by their name in the policy."""

    tasks: Mapping[str, TaskProfile] = field(default_factory=dict)


def load_profiles(path: str) -> Profiles:
    """Read a file; ProfileError carries everything that is wrong with it."""
    try:
        body = json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        problem = unreadable(error)
    except (ValueError, RecursionError) as error:
        problem = f"not valid JSON: {error}"
    else:
        return parse_profiles(body, subject=path)
    raise ProfileError(path, (Finding("", None, problem, Fault.FILE),))


def parse_profiles(body: object, *, subject: str = "profiles") -> Profiles:
    """Turn a decoded document into profiles; ProfileError carries all findings."""
    findings: list[Finding] = []
    fields = Fields(body, "profiles", findings)
    for known in ("$schema", "machine", "measured"):
        fields.raw(known)
    tasks = {name: _task(own) for name, own in fields.mapping("tasks", limit=MOST).items()}
    fields.close()
    if not tasks and not findings:
        fields.refuse("tasks", fields.raw("tasks"), "the profile of at least one task")
    if findings:
        raise ProfileError(subject, tuple(findings))
    return Profiles(tasks)


def _task(fields: Fields) -> TaskProfile:
    for known in _TELLS:
        fields.raw(known)
    rates = fields.number("background") or 0.0
    seconds = fields.number("seconds") or 0.0
    produced = fields.nested("produced")
    done, mean = produced.number("done") or 0.0, produced.nested("cpu").number("mean") or 0.0
    inputs = [_input(own, seconds) for own in fields.mapping("inputs", limit=MOST).values()]
    profile = TaskProfile(
        deadline=fields.number("deadline"),
        background=rates + (done * mean / seconds if seconds else 0.0),
        threads=max((threads for _, threads in inputs), default=1.0),
        inputs=tuple(cost for cost, _ in inputs if cost is not None),
    )
    fields.close()
    return profile


def _input(fields: Fields, seconds: float) -> tuple[Cost | None, float]:
    """An input's cost, None if it was never seen at work; and how many cores it used at once."""
    for known in _COUNTS:
        fields.raw(known)
    came = sum(fields.number(count) or 0.0 for count in ("done", "dropped", "broken"))
    key, depth = fields.key_expression("key"), fields.number("depth")
    if depth is None or depth < 1 or depth % 1:
        fields.refuse("depth", depth, "how many samples wait at most: an integer of 1 or more")
    cpu, service = fields.nested("cpu"), fields.nested("service")
    wait = fields.nested("wait")
    on_the_bus = max(_quantile(fields.nested("latency"), 0.5) - _quantile(wait, 0.5) - _quantile(service, 0.5), 0.0)
    transit = on_the_bus + _quantile(wait, _UNQUEUED)
    fields.close()
    quantiles = cpu.raw("quantiles")
    rising = isinstance(quantiles, list) and all(_is_seconds(value) for value in quantiles)
    if not rising or quantiles != sorted(quantiles):
        cpu.refuse("quantiles", quantiles, "a list of CPU seconds, ascending")
        return None, 1.0
    used, took = cpu.number("mean") or 0.0, service.number("mean") or 0.0
    threads = min(max(1.0, used / took), MOST_THREADS) if took else 1.0
    if not quantiles:
        return None, threads
    rate = came / seconds if seconds else 0.0
    return Cost(key, int(depth or 1), tuple(map(float, quantiles)), rate, transit), threads


def _quantile(times: Fields, part: float) -> float:
    """Of a distribution; 0 where it is not given."""
    quantiles = times.raw("quantiles")
    known = isinstance(quantiles, list) and quantiles and all(map(_is_seconds, quantiles))
    return float(quantiles[round(part * (len(quantiles) - 1))]) if known else 0.0


def with_steady_inputs(timeline: Timeline, profiles: Profiles) -> Timeline:
    """The timeline, with the inputs that were not recorded: they come as steadily as when they were measured.

    A robot's recorder has what policies read, and no policy reads the pictures of a camera.
    """
    costs = {cost.key: cost for task in profiles.tasks.values() for cost in task.inputs if cost.rate > 0}
    unheard = [cost for key, cost in costs.items() if not any(selects(key, entry.key) for entry in timeline.entries)]
    return replace(timeline, entries=(*timeline.entries, *(_steady(cost, timeline.duration) for cost in unheard)))


def _steady(cost: Cost, duration: float) -> TimelineEntry:
    return TimelineEntry(
        start=0.0,
        end=duration,
        key=cost.key,
        encoding="binary",
        rate=None,
        value=None,
        dataset="as measured",
        truth=None,
        dataset_rate=cost.rate,
    )


def _is_seconds(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value < 1e6
