from __future__ import annotations

import json

import pytest
from reactivex.testing import TestScheduler

from contextpolicy.bus.health_watch import HealthWatch, TaskHealth, read_health
from tests.bus.fake_session import FakeSession


@pytest.fixture
def heard():
    session, scheduler, heard = FakeSession(), TestScheduler(), []
    heard.append(HealthWatch(session, "robot/*/health", scheduler, lambda *told: heard.append(told)))

    def tell(key, **fields):
        session.deliver_bytes("robot/*/health", json.dumps(fields).encode(), key)
        scheduler.advance_by(0.1)
        return heard[1:]

    heard[0].tell, heard[0].session = tell, session
    return heard[0]


def test_it_hears_which_task_misses_how_much(heard):
    assert heard.tell("robot/slam/health", misses=0.25, suspended=False, queue=3) == [
        ("slam", TaskHealth(0.25, suspended=False))
    ]
    assert heard.tell("robot/arm/health", misses=0, suspended=True)[1:] == [("arm", TaskHealth(0.0, suspended=True))]


def test_what_makes_no_sense_is_not_heard(heard):
    assert heard.tell("robot/slam/health", rate=3) == []


def test_it_leaves_the_bus(heard):
    heard.close()
    assert heard.session.subscribers == []


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
