from __future__ import annotations

import json
from typing import TYPE_CHECKING, cast

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.health_watch import LARGEST, MOST_TASKS, HealthWatch, TaskHealth, read_health
from tests.bus.fake_session import FakeSession

if TYPE_CHECKING:
    import zenoh


class Bus:
    """A bus with a watch on it."""

    def __init__(self):
        self.session, self.scheduler = FakeSession(), TestScheduler()
        self.heard: list[tuple[str, str, TaskHealth]] = []
        session = cast("zenoh.Session", self.session)
        self.watch = HealthWatch(session, "robot/*/health", self.scheduler, "lab/robot", self)

    def on_task_health(self, policy, task, health):
        self.heard.append((policy, task, health))

    def publish(self, key, **fields):
        self.session.deliver_bytes("robot/*/health", json.dumps(fields).encode(), key)
        self.scheduler.advance_by(0.1)


@pytest.fixture
def bus():
    return Bus()


def test_health_reports_are_forwarded(bus):
    bus.publish("robot/slam/health", misses=0.25, suspended=False, queue=3)
    assert bus.heard == [("lab/robot", "slam", TaskHealth(0.25, suspended=False))]
    bus.publish("robot/arm/health", misses=0, suspended=True)
    assert bus.heard[1:] == [("lab/robot", "arm", TaskHealth(0.0, suspended=True))]


def test_invalid_health_is_ignored(bus):
    bus.publish("robot/slam/health", rate=3)
    assert bus.heard == []


def test_flood_is_reduced_to_the_newest_per_task(bus):
    for number in range(1001):
        said = json.dumps({"misses": number / 1000}).encode()
        bus.session.deliver_bytes("robot/*/health", said, "robot/slam/health")
    bus.scheduler.advance_by(0.1)
    assert bus.heard == [("lab/robot", "slam", TaskHealth(1.0, suspended=False))]


def test_flood_of_task_names_is_bounded(bus):
    for number in range(MOST_TASKS + 100):
        bus.session.deliver_bytes("robot/*/health", b'{"misses": 0}', f"robot/{number}/health")
    bus.scheduler.advance_by(0.1)
    assert len(bus.heard) == MOST_TASKS


def test_oversized_health_is_ignored(bus):
    bus.publish("robot/slam/health", misses=0, fill="x" * LARGEST)
    assert bus.heard == []


@pytest.mark.parametrize("key", ["**", "robot/*/health", "robot/**"])
def test_health_of_no_task_is_ignored(bus, key):
    bus.publish(key, misses=0.25)
    assert bus.heard == []


def test_closing_removes_the_subscription(bus):
    bus.watch.close()
    assert bus.session.subscribers == []


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"null",
        b"[]",
        b"{}",
        b'{"misses": null}',
        b'{"misses": "a lot"}',
        b'{"misses": 1.5}',
        b'{"misses": NaN}',
        b"\xff",
    ],
)
def test_malformed_health_is_none(payload):
    assert read_health(payload) is None
