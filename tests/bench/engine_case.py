"""Policies of a given size, and the payloads that their streams receive."""

from __future__ import annotations

import json
import random
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from contextpolicy.policy import parsing
from contextpolicy.policy.spec import Context, Effect
from tests.planning.builders import on_node

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.planning.allocation.placement import Placement
    from contextpolicy.policy.spec import Policy

RATE = 200.0
"""Samples per second of each stream."""
EVERY_FIFTH = 5


@dataclass(frozen=True, slots=True)
class Case:
    """A size of policy; what reads a stream is spread evenly over the streams."""

    streams: int
    tasks: int
    contexts: int

    def __str__(self) -> str:
        return f"{self.streams} streams, {self.tasks} tasks, {self.contexts} contexts"

    def policy(self) -> Policy:
        """Priorities differ; each stream is watched; each context scales one task."""
        spec = {
            "streams": [{"name": f"s{n}", "key": f"robot/s{n}", "staleAfter": "1s"} for n in range(self.streams)],
            "tasks": [self._task(n) for n in range(self.tasks)],
        }
        policy = parsing.parse({"metadata": {"name": "bench", "namespace": "bench"}, "spec": spec})
        # Made without parsing: the API stops at 64 contexts, the engine does not.
        return replace(policy, contexts=tuple(self._context(n) for n in range(self.contexts)))

    def placement(self) -> Placement:
        """All tasks on one node of four cores."""
        return on_node(*(f"t{n}" for n in range(self.tasks)), cores=4)

    def payloads(self, count: int) -> Iterator[tuple[float, str, bytes]]:
        """(seconds, stream, JSON) of IMU-like samples, the streams in turn; the same ones at each run."""
        chance = random.Random(1)  # noqa: S311 - the same noise at each run
        for number in range(count):
            gyro = [round(chance.gauss(0, 0.3), 6) for _ in range(3)]
            accel = [round(chance.gauss(0, 1), 6) for _ in range(3)]
            at = number / (RATE * self.streams)
            value = {"stamp": int(at * 1e9), "gyro": gyro, "accel": accel, "speed": round(chance.random(), 6)}
            yield at, f"s{number % self.streams}", json.dumps(value).encode()

    def _task(self, number: int) -> dict[str, Any]:
        stream = f"s{number % self.streams}"
        if number % EVERY_FIFTH == 0 and number < self.streams:
            activity = {"stream": stream, "scoreFrom": f"1.0 + {stream}.speed"}
        else:
            activity = {"stream": stream, "when": f"norm({stream}.gyro) > 0.02", "hold": "1s"}
        return {
            "name": f"t{number}",
            "selector": {"matchLabels": {"app": f"t{number}"}},
            "priority": 1 + number % 7,
            "idle": 0.1,
            "activity": [activity],
        }

    def _context(self, number: int) -> Context:
        stream = f"s{number % self.streams}"
        when = f"{stream}.speed > {0.999 - number / 1000:g}"
        return Context(
            f"c{number}", when, enter_after=0.1, exit_after=1.0, effects={f"t{number % self.tasks}": Effect(scale=2.0)}
        )


NAMED = Case(10, 20, 10)
CASES = tuple(Case(s, t, c) for t in (1, 10, 100) for c in (1, 10, 100) for s in (1, 10, 50))
