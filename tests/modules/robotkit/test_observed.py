from __future__ import annotations

import pytest

from robotkit import Input, Module, Needs
from robotkit.observed import MOST, Heard, Observed
from robotkit.profile import Profile

MS = 1_000_000
NOW = 1_700_000_000_000_000_000
SCAN = "0/scan/sensor_msgs::msg::dds_::LaserScan_/*"


class Node:
    """A node whose inputs and answers come when the test says so: milliseconds for time, and for stamps."""

    def __init__(self, *, answers_all=True, depth=2, deadline=0.1):
        self.cpu = 5 * MS
        scan = Input(SCAN, "cdr", "sensor_msgs/msg/LaserScan", depth=depth)
        module = Module("slam", inputs={"scan": scan}, needs=Needs(deadline=deadline))
        self.profile = Profile(module, lambda: self.cpu)
        self.observed = Observed(module, self.profile, lambda: self.cpu, answers_all=answers_all)

    def takes(self, stamp, at):
        self.observed.came("scan", Heard(NOW + stamp * MS, NOW + (at - 1) * MS, NOW + at * MS))

    def answers(self, stamp, at, cpu=0):
        self.cpu += cpu * MS
        self.observed.answered(NOW + stamp * MS, NOW + at * MS)

    @property
    def waiting(self):
        return [(received - NOW) // MS for _, received in self.observed.unfinished]

    @property
    def scan(self):
        return self.profile.inputs["scan"]

    def means(self):
        document = self.scan.as_json(self.observed.dropped["scan"])
        return {name: round(document[name]["mean"] * 1000) for name in ("cpu", "wait", "service", "latency")}


def test_an_input_waits_for_an_answer_with_its_stamp():
    node = Node()
    node.takes(0, at=2)
    node.answers(7, at=3)
    assert (node.waiting, node.scan.done, node.observed.strange) == ([2], 0, 1)
    node.answers(0, at=40, cpu=30)
    assert (node.waiting, node.scan.done, node.observed.matched) == ([], 1, 1)
    assert node.means() == {"cpu": 30, "wait": 0, "service": 38, "latency": 39}


def test_an_answer_without_a_stamp_is_to_no_input():
    node = Node()
    node.takes(-NOW // MS, at=2)  # stamp 0
    node.observed.answered(None, NOW + 3 * MS)
    assert (node.waiting, node.scan.done, node.observed.strange) == ([2], 0, 1)


def test_the_second_of_two_begins_when_the_first_is_done():
    node = Node()
    node.takes(0, at=2)
    node.takes(10, at=12)
    node.answers(0, at=40, cpu=20)
    node.answers(10, at=60, cpu=10)
    assert node.means() == {"cpu": 15, "wait": 14, "service": 29, "latency": 44}  # waits 0 and 28, works 38 and 20


def test_a_late_answer_is_a_miss():
    node = Node()
    node.takes(0, at=2)
    node.answers(0, at=200)
    assert (node.scan.done, node.scan.missed) == (1, 1)


def test_inputs_older_than_the_answered_one_are_dropped():
    node = Node()
    node.takes(0, at=2)
    node.takes(10, at=12)
    node.answers(10, at=30)
    assert (node.waiting, node.observed.dropped) == ([], {"scan": 1})


def test_inputs_beyond_the_queue_depth_are_dropped_but_not_the_one_in_work():
    node = Node()
    for at in range(0, 50, 10):
        node.takes(at, at=at)
    assert (node.waiting, node.observed.dropped) == ([0, 30, 40], {"scan": 2})
    node.answers(0, at=60)
    assert (node.waiting, node.scan.done, node.observed.strange) == ([30, 40], 1, 0)


def test_only_answers_count_for_a_node_that_skips_inputs():
    node = Node(answers_all=False)
    for at in range(0, 50, 10):
        node.takes(at, at=at)
    assert (node.waiting, node.observed.dropped) == ([], {"scan": 0})
    node.answers(40, at=200)
    assert (node.scan.done, node.scan.missed, node.observed.dropped) == (1, 1, {"scan": 0})


def test_late_answers_of_a_node_that_skips_inputs_are_misses():
    """Six scans come while it works on one: each answer is to an input that a queue of ROS would have lost."""
    node = Node(answers_all=False, depth=1, deadline=0.5)
    for at in range(0, 2000, 100):
        node.takes(at, at=at)
        if at >= 600:
            node.answers(at - 600, at=at)
    assert (node.scan.done, node.scan.missed, node.observed.strange) == (14, 14, 0)
    assert node.means()["latency"] == 601


@pytest.mark.parametrize(("deadline", "kept"), [(0.1, 61), (60.0, 121), (None, 61)])
def test_inputs_that_a_node_skipped_are_forgotten_in_time(deadline, kept):
    node = Node(answers_all=False, deadline=deadline)
    for at in range(0, 200_000, 1000):
        node.takes(at, at=at)
    assert len(node.observed._queues["scan"]) == kept


def test_a_node_that_skips_inputs_takes_a_bounded_number():
    node = Node(answers_all=False, deadline=None)
    for at in range(2 * MOST):
        node.takes(at, at=at)
    assert len(node.observed._queues["scan"]) == MOST


def test_suspension_clears_waiting_inputs():
    node = Node()
    node.takes(0, at=2)
    node.observed.forget()
    node.answers(0, at=500)
    assert (node.waiting, node.scan.missed, node.observed.dropped) == ([], 0, {"scan": 0})


@pytest.mark.parametrize("at", [1, 3])
def test_service_time_is_never_negative(at):
    node = Node()
    node.takes(0, at=2)
    node.answers(0, at=at)
    assert node.means()["service"] >= 0
