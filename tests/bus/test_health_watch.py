from __future__ import annotations

import json
from typing import TYPE_CHECKING, cast

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.health_watch import HealthWatch, TaskHealth, read_health
from tests.bus.fake_session import FakeSession

if TYPE_CHECKING:
    import zenoh


class Bus:
    """A bus with a watch on it."""

    def __init__(self):
        self.session, self.scheduler = FakeSession(), TestScheduler()
        self.heard: list[tuple[str, TaskHealth]] = []
        session = cast("zenoh.Session", self.session)
        self.watch = HealthWatch(session, "robot/*/health", self.scheduler, lambda *told: self.heard.append(told))

    def publish(self, key, **fields):
        self.session.deliver_bytes("robot/*/health", json.dumps(fields).encode(), key)
        self.scheduler.advance_by(0.1)


@pytest.fixture
def bus():
    return Bus()


def test_it_hears_which_task_misses_how_much(bus):
    bus.publish("robot/slam/health", misses=0.25, suspended=False, queue=3)
    assert bus.heard == [("slam", TaskHealth(0.25, suspended=False))]
    bus.publish("robot/arm/health", misses=0, suspended=True)
    assert bus.heard[1:] == [("arm", TaskHealth(0.0, suspended=True))]


def test_what_makes_no_sense_is_not_heard(bus):
    bus.publish("robot/slam/health", rate=3)
    assert bus.heard == []


def test_it_leaves_the_bus(bus):
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
def test_anything_else_is_no_health(payload):
    assert read_health(payload) is None
