"""Which input is taken next, with queues that keep the newest or all, and with gates that close."""

import math

import pytest

from tests.bench.enforcement.inputs import Inputs, Queue

ALWAYS = [(0.0, math.inf)]


def ten_hertz(queue=Queue.NEWEST, windows=ALWAYS, phase=0.0):
    return Inputs(rate=10, count=10, queue=queue, windows=windows, phase=phase)


@pytest.mark.parametrize(("queue", "taken"), [(Queue.NEWEST, 3), (Queue.LOSSLESS, 1)])
def test_what_is_taken_of_several_that_wait(queue, taken):
    assert ten_hertz(queue).next(0, 0.35) == taken


def test_an_input_is_taken_once():
    assert ten_hertz().next(3, 0.35) is None


def test_an_input_is_there_at_its_arrival_and_not_before():
    inputs = ten_hertz(phase=0.03)
    assert inputs.next(-1, 0.02) is None
    assert inputs.next(-1, inputs.arrival(0)) == 0
    assert inputs.next(0, inputs.arrival(7)) == 7


def test_after_the_last_one_none_comes():
    assert ten_hertz().next(9, 5.0) is None
    assert ten_hertz().wake(9, 5.0) is None
    assert ten_hertz().next(8, 5.0) == 9


def test_a_task_sleeps_until_the_next_arrival():
    assert ten_hertz().wake(-1, -1.0) == 0
    assert ten_hertz().wake(2, 0.25) == pytest.approx(0.3)
    assert ten_hertz(phase=0.05).wake(2, 0.26) == pytest.approx(0.35)


def test_a_closed_gate_drops_what_waits_and_what_comes():
    inputs = ten_hertz(Queue.LOSSLESS, windows=[(0.0, 0.35), (0.6, 0.9)])
    assert inputs.next(0, 0.34) == 1
    assert inputs.next(1, 0.4) is None, "it closed"
    assert inputs.wake(1, 0.4) == pytest.approx(0.6)
    assert inputs.next(1, 0.75) == 6, "what came meanwhile is dropped"
    assert inputs.wake(8, 0.85) is None


def test_what_arrives_as_the_gate_closes_is_not_waited_for():
    assert ten_hertz(windows=[(0.0, 0.3), (0.7, 1.0)]).wake(2, 0.25) == pytest.approx(0.7)
