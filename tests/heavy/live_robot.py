"""A robot whose live page a browser opens: an operator in virtual time behind a real server, and ways to disturb it."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.policies import plan_publisher, policy_runner, queries
from contextpolicy.streams import subscription
from contextpolicy.telemetry import resize_watch
from tests.cluster.builders import a_pod
from tests.planning.builders import a_context, a_stream, a_task
from tests.policies.builders import a_policy, resources
from tests.virtual_operator import VirtualOperator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    import pytest

    Story = Iterable[tuple[dict[str, dict[str, float]], float]]

CLOCKED = (plan_publisher, policy_runner, queries, subscription, resize_watch, pod_patch)
TASKS = ("slam", "speech", "signs")
STORY: Story = (
    ({"robot/imu": {"speed": 0.0}, "robot/mic": {"level": 0.0}, "robot/camera": {"signs": 0}}, 12.0),
    ({"robot/mic": {"level": 0.6}}, 15.0),
    ({"robot/camera": {"signs": 2}}, 12.0),
    ({"robot/imu": {"speed": 0.4}}, 20.0),
    ({"robot/mic": {"level": 0.0}}, 10.0),
    ({"robot/camera": {"signs": 0}}, 8.0),
    ({"robot/imu": {"speed": 0.0}}, 9.0),
    ({"robot/mic": {"level": 0.5}}, 6.0),
)
"""The paper's exp1 in short: what is heard, and for how long."""


def a_robot() -> dict[str, Any]:
    """A policy in the manner of the paper's experiments."""
    body: dict[str, Any] = a_policy(
        streams=[a_stream(name, staleAfter="300s") for name in ("imu", "mic", "camera")],
        tasks=[
            _active("slam", "imu", "imu.speed > 0.1", 10),
            _active("speech", "mic", "mic.level > 0.1", 10),
            _active("signs", "camera", "camera.signs > 0", 5),
        ],
        contexts=[
            a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}, "slam": {"scale": 2}}),
            a_context("dialogue", "mic.level > 0.1 && imu.speed <= 0.1", {"speech": {"scale": 2}}),
        ],
    )
    return body


def many(count: int) -> tuple[dict[str, Any], Story]:
    """A policy of `count` tasks, and a minute of which task matters when."""
    names = [f"task-{number:02}" for number in range(count)]
    tasks = [_active(name, "turn", f"turn.task == {number}", 10) for number, name in enumerate(names)]
    contexts = [a_context("crowded", "turn.task >= 3", {names[0]: {"suspend": count > 1}})]
    body = a_policy(streams=[a_stream("turn", staleAfter="300s")], tasks=tasks, contexts=contexts)
    return body, [({"robot/turn": {"task": number}}, 60.0 / count) for number in range(count)]


def _active(name: str, stream: str, when: str, priority: int) -> dict[str, Any]:
    task: dict[str, Any] = a_task(
        name, priority=priority, activity=[{"stream": stream, "when": when, "score": 1}], idle=0.1
    )
    return task


def run(patch: pytest.MonkeyPatch, body: dict[str, Any], story: Story) -> VirtualOperator:
    """The operator that carries out the policy, at the end of the story."""
    names = [task["name"] for task in body["spec"]["tasks"]]
    operator = VirtualOperator(*(a_pod(name, {name: resources()}) for name in names))
    clock = SimpleNamespace(monotonic=lambda: operator.loop.to_seconds(operator.loop.now), time=time.time)
    for module in CLOCKED:
        patch.setattr(module, "time", clock)
    operator.list_all("4")
    operator.connect()
    operator.apply(body)
    for news, lasts in story:
        publish(operator, news, lasts)
    operator.loop.inline = True
    return operator


def publish(operator: VirtualOperator, news: dict[str, dict[str, float]], lasts: float) -> None:
    """Samples arrive, and some virtual seconds pass."""
    for key, value in news.items():
        operator.sample(key, **value)
    operator.settle()
    operator.turn(lasts)


class Disturbed:
    """What the operator answers, until a test disturbs it."""

    def __init__(self, operator: VirtualOperator) -> None:
        self._operator, self._quiet = operator, threading.Lock()
        self.answered, self._generation = 0, 1
        self.hangs = threading.Event()
        self.alter_boards: Callable[[list[dict[str, Any]]], list[dict[str, Any]]] = lambda boards: boards
        self.alter_plans: Callable[[list[dict[str, Any]]], list[dict[str, Any]]] = lambda plans: plans

    def happen(self, news: dict[str, dict[str, float]], lasts: float) -> None:
        """Go on with the story."""
        with self._quiet:
            self._operator.loop.inline = False
            publish(self._operator, news, lasts)
            self._operator.loop.inline = True

    def edit(self, news: dict[str, dict[str, float]], **spec: Any) -> None:
        """Somebody changes the policy, and 10 s pass."""
        with self._quiet:
            self._operator.loop.inline = False
            self._generation += 1
            body = a_robot()
            body["spec"].update(spec)
            body["metadata"]["generation"] = self._generation
            self._operator.apply(body)
            publish(self._operator, news, 10.0)
            self._operator.loop.inline = True

    def recreate(self) -> None:
        """Somebody deletes the policy and makes it again, between two questions of the page."""
        with self._quiet:
            self._operator.loop.inline = False
            body = a_robot()
            self._operator.delete(body)
            self._operator.settle()
            body["metadata"]["uid"] = "uid-again"
            self._operator.apply(body)
            publish(self._operator, {}, 10.0)
            self._operator.loop.inline = True

    def boards(self) -> list[dict[str, Any]]:
        while self.hangs.is_set():
            time.sleep(0.05)
        with self._quiet:
            self.answered += 1
            return self.alter_boards(self._operator.operator.queries.boards())

    def plans(self, policy: str, since: float) -> list[dict[str, Any]]:
        with self._quiet:
            return self.alter_plans(self._operator.operator.queries.plans(policy, since))

    def explanation(self, policy: str) -> dict[str, Any] | None:
        return self._operator.operator.queries.explanation(policy)

    def recording(self, policy: str, last: float) -> dict[str, Any] | None:
        return self._operator.operator.queries.recording(policy, last)
