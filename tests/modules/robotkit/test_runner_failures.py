"""A module whose task, or its device, fails: what is its own fault ends it loudly, what is the world's does not."""

from __future__ import annotations

import threading

import pytest

from robotkit import ConfigurationError, DeviceError
from robotkit import producer as producer_module
from tests.modules.robotkit.world import ECHO, SENSOR, Echo, Sensor, running
from tests.waiting import PATIENCE, until


class Adapting(Echo):
    """Fails in `adapt` and `close` as it is made to."""

    def __init__(self, in_adapt=None, in_close=None):
        super().__init__()
        self.in_adapt, self.in_close = in_adapt, in_close

    def adapt(self, decision):
        super().adapt(decision)
        if self.in_adapt is not None:
            raise self.in_adapt

    def close(self):
        super().close()
        if self.in_close is not None:
            raise self.in_close


def test_an_unexpected_source_error_ends_the_module():
    with running(SENSOR, Sensor(RuntimeError("bug"))) as world, pytest.raises(RuntimeError, match="bug"):
        world.running.result(PATIENCE)


def test_a_bad_sample_does_not_end_the_module():
    with running(ECHO, Echo()) as world:
        world.say(b"bad")
        world.say(b"good")
        assert world.next_result()["heard"] == "good"


def test_an_unexpected_error_closes_and_ends_the_module():
    task = Echo()
    with running(ECHO, task) as world:
        world.say(b"fatal")
        with pytest.raises(RuntimeError, match="fatal"):
            world.running.result(PATIENCE)
    assert task.closed


def test_an_unexpected_error_in_adapt_closes_and_ends_the_module():
    task = Adapting(TypeError("no number"))
    with running(ECHO, task) as world:
        world.decide(sequence=1, task="echo", share=0.3)
        with pytest.raises(TypeError, match="no number"):
            world.running.result(PATIENCE)
    assert task.closed


def test_inputs_are_paused_before_adapt_fails_on_suspension():
    task = Adapting(TypeError("no number"))
    with running(ECHO, task) as world:
        world.decide(sequence=1, task="echo", suspended=True)
        world.wait_for_inputs(expected=False)
        with pytest.raises(TypeError, match="no number"):
            world.running.result(PATIENCE)


@pytest.mark.parametrize("failure", [DeviceError("unplugged"), ConfigurationError("row 7 makes no sense")])
def test_a_device_lost_in_adapt_is_a_failure_and_the_next_plan_counts(failure):
    task = Adapting(failure)
    with running(ECHO, task) as world:
        world.suspend_and_resume(task)
        assert world.ask("robot/echo/profile")["failures"] == 2


def test_a_late_configuration_error_is_treated_as_a_device_error():
    class Careless(Echo):
        def process(self, received):
            if received.payload == b"bad row":
                raise ConfigurationError("row 7 makes no sense")
            return super().process(received)

    with running(ECHO, Careless()) as world:
        world.say(b"bad row")
        until(lambda: world.ask("robot/echo/profile")["failures"] == 1)  # the next input would replace one that waits
        world.say(b"good")
        assert world.next_result()["heard"] == "good"


def test_an_error_in_close_does_not_mask_an_earlier_error():
    with running(ECHO, Adapting(in_close=ValueError("later"))) as world:
        world.say(b"fatal")
        with pytest.raises(RuntimeError, match="fatal"):
            world.running.result(PATIENCE)


def test_a_device_that_is_lost_in_close_does_not_end_the_module_loudly():
    with running(ECHO, Adapting(in_close=DeviceError("unplugged"))) as world:
        world.stop()
        world.running.result(PATIENCE)


def test_an_unexpected_error_in_close_is_raised_after_cleanup():
    with running(ECHO, Adapting(in_close=ValueError("bug"))) as world:
        world.stop()
        with pytest.raises(ValueError, match="bug"):
            world.running.result(PATIENCE)
        until(lambda: list(world.session.liveliness().get("robot/*/alive")) == [])


def test_a_hanging_adapt_does_not_block_a_failed_module():
    hung, freed = threading.Event(), threading.Event()

    class Hanging(Echo):
        def adapt(self, decision):
            super().adapt(decision)
            hung.set()
            freed.wait(PATIENCE)

    with running(ECHO, Hanging()) as world:
        world.decide(sequence=1, task="echo", share=0.3)
        assert hung.wait(PATIENCE)
        world.say(b"fatal")
        with pytest.raises(RuntimeError, match="fatal"):
            world.running.result(PATIENCE / 2)
        freed.set()


@pytest.mark.parametrize("failure", [DeviceError("unplugged"), ConfigurationError("row 7 makes no sense")])
def test_a_source_that_fails_is_opened_again_and_freed_while_suspended(failure, monkeypatch):
    monkeypatch.setattr(producer_module, "FIRST_RETRY_S", 0.01)
    task = Sensor(failure)
    with running(SENSOR, task) as world:
        assert [world.next_result() for _ in range(2)] == [{"stamp": 7, "value": 1}, {"stamp": 7, "value": 2}]
        assert task.released.get(timeout=PATIENCE) == 1
        world.decide(sequence=1, task="sensor", suspended=True)
        assert task.released.get(timeout=PATIENCE) == 2, "of two plans in a row only the newer one counts"
        world.decide(sequence=2, task="sensor", share=0.1)
        assert world.next_result()["value"] == 3
