"""How many Python calls a change of context takes, from Zenoh's callback until the API server is asked for resizes.

    python -m tests.bench.calls [--output table|json] [--changes N]

The time they take differs between machines and days, their number does not: what a change of the code costs shows here
first. A running operator governs the delivery robot, which starts and stops; its contexts begin and end without delay.
Zenoh, the API server and the kubelet are stand-ins. Medians, after a warm-up, of the calls from the callback's entry

    first   until the first resize is handed over
    last    until the last one is
    idle    until all threads wait, for the API server's answers or for the next sample

What `sys.setprofile` reports as a call counts, on all threads: each call of a Python function, the start of each
generator and each time it goes on, and until Python 3.12 each comprehension. C functions (json, msgspec, Zenoh) do not
count, nor do the stand-ins and what they call.

Python runs one thread at a time. The workers that send resizes run as soon as the loop lets go of the interpreter: when
it publishes the plan, else when it waits. Elsewhere it never has to, here; on a busy machine they may miss the first of
these moments, and `first` is nearly `idle`.
"""

# ruff: noqa: T201 - a command prints

from __future__ import annotations

import argparse
import json
import logging
import sys
import time
from io import StringIO
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import yaml

from tests.bench.call_counter import QUIET, CallCounter, by_file, own, shown, until_quiet
from tests.bench.live_operator import TASKS, LiveOperator, StandInCluster
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import a_pod
from tests.policies.builders import a_policy, resources

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.bench.call_counter import Call

POLICY = Path(__file__).parents[2] / "config/policies/delivery-robot.yaml"
FIGURES = ("first", "last", "idle")
GOAL = 450
"""Calls until the first resize."""
WARM_UP = 3
FILES = 10
"""How many the table shows."""
SENDING = QUIET / 2
"""Seconds that a message takes, in which the workers get as far as the API server."""
ANSWER = 5 * QUIET
"""Seconds that the API server takes: by then the operator has done all else."""
REST = 1.0
"""Seconds between an answer and the next change: by then the status is written."""
PATIENCE = 10.0
"""Seconds within which a change leads to resizes, however busy the machine is."""
LONG = "60s"
"""No sample of ours comes so late, however busy the machine is."""
WHOLE_TURN = 10.0
"""Seconds after which a thread has to let go of the interpreter."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", choices=("table", "json"), default="table")
    parser.add_argument("--changes", type=int, default=10)
    options = parser.parse_args()
    result = measure(options.changes)
    print(json.dumps(result, indent=2) if options.output == "json" else _table(result))
    return 0


def measure(changes: int) -> dict[str, Any]:
    """Each figure's median, the files of the first one's, and the first of each change."""
    sys.setswitchinterval(WHOLE_TURN)
    logging.basicConfig(level="INFO", stream=StringIO())
    robot = _Robot()
    made = [robot.change() for _ in range(WARM_UP + changes)][WARM_UP:]
    medians = {figure: _median([change[figure] for change in made]) for figure in FIGURES}
    return {
        **{figure: _summary(calls) for figure, calls in medians.items()},
        "by_file": {shown(file): count for file, count in by_file(medians["first"]).most_common()},
        "changes": [len(change["first"]) for change in made],
    }


class _Session(FakeSession):
    """Lets the other threads work while it publishes, as Zenoh does."""

    def _publish(self, key: str, content: Any, **more: Any) -> None:
        time.sleep(SENDING)
        super()._publish(key, content, **more)


class _Cluster(StandInCluster):
    """Notes how many calls led to each resize."""

    def __init__(self, counter: CallCounter) -> None:
        super().__init__([a_pod(name, {name: resources()}) for name in TASKS])
        self._counter = counter
        self._asked: list[int] = []
        self._may_answer = Event()
        self._may_answer.set()

    def resize(self, namespace: str, name: str, patch: Mapping[str, Any]) -> int:
        self._asked.append(self._counter.so_far())
        self._may_answer.wait()
        return super().resize(namespace, name, patch)

    def hold_answers(self) -> None:
        """To the resizes that come from now on."""
        self._may_answer.clear()
        self._asked.clear()

    def answer(self) -> tuple[int, int]:
        """Once each task has its resize, since what one gets another has lost; the calls until the first and last."""
        end = time.monotonic() + PATIENCE
        while len(self._asked) < len(TASKS):
            assert time.monotonic() < end, "the change of context led to no resize"
            time.sleep(SENDING)
        time.sleep(ANSWER)
        self._may_answer.set()
        return self._asked[0], self._asked[-1]


class _Robot:
    """It starts and stops, under a running operator."""

    def __init__(self) -> None:
        self._counter, self._session = CallCounter(), _Session()
        self._cluster = _Cluster(self._counter)
        self._speed = 0.0
        LiveOperator(self._session, _policy(), self._cluster)  # type: ignore[arg-type]
        self._rest()

    def change(self) -> dict[str, Sequence[Call]]:
        """The calls of each figure."""
        self._speed = 0.3 - self._speed
        self._cluster.hold_answers()
        self._counter.start()
        self._sample()
        first, last = self._cluster.answer()
        calls = self._counter.stop()
        self._rest()
        return {"first": calls[:first], "last": calls[:last], "idle": calls[: until_quiet(calls, last)]}

    def _rest(self) -> None:
        """Samples come that change nothing."""
        end = time.monotonic() + REST
        while time.monotonic() < end:
            self._sample()
            self._session.deliver("robot/microphone/level", level=0.0)
            time.sleep(0.1)

    def _sample(self) -> None:
        value = {"gyro": [0.0, 0.0, 0.1], "accel": [0.0, 0.0, 9.81], "speed": self._speed}
        self._session.deliver("robot/imu", stamp=time.time_ns(), **value)


def _policy() -> dict[str, Any]:
    """The delivery robot's, without delays, and so patient that nothing but a sample changes a plan."""
    spec = yaml.safe_load(POLICY.read_text(encoding="utf-8"))["spec"]
    for context in spec["contexts"]:
        context |= {"enterAfter": "0s", "exitAfter": "0s"}
    for stream in spec["streams"]:
        stream["staleAfter"] = LONG
    for task in spec["tasks"]:
        for activity in task["activity"]:
            activity["hold"] = LONG
    policy: dict[str, Any] = a_policy(**spec)
    return policy


def _median(made: Sequence[Sequence[Call]]) -> Sequence[Call]:
    return sorted(made, key=len)[(len(made) - 1) // 2]


def _summary(calls: Sequence[Call]) -> dict[str, int]:
    ours = own(calls)
    return {"calls": len(calls), "files": len(by_file(calls)), "own": len(ours), "own_files": len(by_file(ours))}


def _table(result: dict[str, Any]) -> str:
    lines = ["       calls  in files  operator's own  in files"]
    for figure in FIGURES:
        row = result[figure]
        lines.append(f"{figure:5}{row['calls']:7}{row['files']:10}{row['own']:16}{row['own_files']:10}")
    lines += [f"goal: first <= {GOAL}", "", "first, by file:"]
    lines += [f"{count:7}  {file}" for file, count in list(result["by_file"].items())[:FILES]]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
