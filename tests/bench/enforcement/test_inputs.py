"""Which input is taken next, with queues that keep the newest or all, and with gates that close."""

import math

import pytest

from tests.bench.enforcement.inputs import Inputs, Queue

ALWAYS = [(0.0, math.inf)]


def ten_hertz(queue=Queue.NEWEST, windows=ALWAYS, phase=0.0):
    return Inputs(rate=10, count=10, queue=queue, windows=windows, phase=phase)


@pytest.mark.parametrize(("queue", "taken"), [(Queue.NEWEST, 3), (Queue.LOSSLESS, 1)])
def test_queue_decides_which_waiting_input_is_taken(queue, taken):
    assert ten_hertz(queue).next(0, 0.35) == taken


def test_an_input_is_taken_once():
    assert ten_hertz().next(3, 0.35) is None


def test_input_is_available_from_its_arrival():
    inputs = ten_hertz(phase=0.03)
    assert inputs.next(-1, 0.02) is None
    assert inputs.next(-1, inputs.arrival(0)) == 0
    assert inputs.next(0, inputs.arrival(7)) == 7


def test_no_input_follows_the_last():
    assert ten_hertz().next(9, 5.0) is None
    assert ten_hertz().wake(9, 5.0) is None
    assert ten_hertz().next(8, 5.0) == 9


def test_a_task_sleeps_until_the_next_arrival():
    assert ten_hertz().wake(-1, -1.0) == 0
    assert ten_hertz().wake(2, 0.25) == pytest.approx(0.3)
    assert ten_hertz(phase=0.05).wake(2, 0.26) == pytest.approx(0.35)


def test_closed_gate_drops_waiting_and_arriving_inputs():
    inputs = ten_hertz(Queue.LOSSLESS, windows=[(0.0, 0.35), (0.6, 0.9)])
    assert inputs.next(0, 0.34) == 1
    assert inputs.next(1, 0.4) is None, "it closed"
    assert inputs.wake(1, 0.4) == pytest.approx(0.6)
    assert inputs.next(1, 0.75) == 6, "what came meanwhile is dropped"
    assert inputs.wake(8, 0.85) is None


def test_task_does_not_wait_for_an_input_at_gate_close():
    assert ten_hertz(windows=[(0.0, 0.3), (0.7, 1.0)]).wake(2, 0.25) == pytest.approx(0.7)
