"""A producer that is paused, resumed and closed by different threads."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest

from robotkit import producer as producer_module
from robotkit.producer import Producer
from robotkit.profile import Profile
from tests.modules.robotkit.world import SENSOR, Sensor
from tests.waiting import PATIENCE


class Published:
    def __init__(self):
        self.first = threading.Event()

    def publish(self, _):
        self.first.set()


@pytest.fixture
def published():
    return Published()


@pytest.fixture
def task():
    return Sensor()


@pytest.fixture
def producer(task, published):
    return Producer(task, published, Profile(SENSOR), lambda work: work)


@pytest.mark.parametrize("end", ["pause", "close"])
def test_it_can_be_ended_while_a_plan_resumes_it(producer, task, end, monkeypatch):
    starting, start = threading.Event(), threading.Event()

    class Slow(threading.Thread):
        def start(self):
            starting.set()
            start.wait(PATIENCE)
            super().start()

    monkeypatch.setattr(producer_module, "threading", SimpleNamespace(Thread=Slow, Event=threading.Event))
    with ThreadPoolExecutor(2) as pool:
        resuming = pool.submit(producer.resume)
        assert starting.wait(PATIENCE)
        ending = pool.submit(getattr(producer, end))
        with pytest.raises(TimeoutError):
            ending.result(0.2)
        start.set()
        resuming.result(PATIENCE)
        ending.result(PATIENCE)
    assert task.released.get(timeout=PATIENCE) == 1


def test_a_plan_that_comes_after_the_end_starts_nothing(producer, task, published):
    producer.resume()
    assert published.first.wait(PATIENCE)
    producer.close()
    producer.resume()
    assert task.opened == 1
