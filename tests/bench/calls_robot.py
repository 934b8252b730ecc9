"""The delivery robot, under a running operator whose Python calls are counted."""

from __future__ import annotations

import time
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Any

import yaml

from tests.bench.calls_counter import QUIET, CallCounter
from tests.bench.live_operator import TASKS, LiveOperator, StandInCluster
from tests.bus.fake_session import FakeSession
from tests.cluster.builders import a_pod
from tests.policies.builders import a_policy, resources

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tests.bench.calls_counter import Call

POLICY = Path(__file__).parents[2] / "config/policies/delivery-robot.yaml"
SENDING = QUIET / 4
"""Seconds that a message takes, in which the workers get as far as the API server."""
ANSWER = 3 * QUIET
"""Seconds that the API server takes: by then the operator has done all else."""
REST = 1.0
"""Seconds between an answer and the next change: by then the status is written."""
PATIENCE = 10.0
"""Seconds within which a change leads to resizes, however busy the machine is."""
LONG = "60s"
"""No sample of ours comes so late, however busy the machine is."""


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

    def resize(self, namespace: str, name: str, patch: Mapping[str, Any], manager: str) -> int:
        self._asked.append(self._counter.so_far())
        self._may_answer.wait()
        return super().resize(namespace, name, patch, manager)

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


class Robot:
    """It starts and stops, under a running operator."""

    def __init__(self) -> None:
        self._counter, self._session = CallCounter(), _Session()
        self._cluster = _Cluster(self._counter)
        self._speed = 0.0
        LiveOperator(self._session, _policy(), self._cluster)  # type: ignore[arg-type]
        self._rest()

    def change(self) -> tuple[Sequence[Call], int, int]:
        """The calls of a change, and how many of them led to the first resize and to the last."""
        self._speed = 0.3 - self._speed
        self._cluster.hold_answers()
        self._counter.start()
        self._sample()
        first, last = self._cluster.answer()
        calls = self._counter.stop()
        self._rest()
        return calls, first, last

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
