"""What is left in place because another writer insists on it is known to others, and so is its end."""

from __future__ import annotations

import pytest

from contextpolicy.actuators.resize.conflict import STRIKES, YIELDED
from contextpolicy.actuators.resize.contests import Contests
from contextpolicy.actuators.resize.pauses import CONFLICTING
from contextpolicy.cluster.pod_parsing import view
from tests.actuators.resize.rig import POLICY, Rig
from tests.cluster.builders import a_pod


class Contested:
    """A container that another writer resizes again and again."""

    def __init__(self, strikes: int) -> None:
        self.rig = Rig(a_pod("slam"))
        self.rig.enforce(slam=300)
        self.heard: list[str] = []
        self.rig.resizer.contests.changes.subscribe(self.heard.append)
        for _ in range(strikes):
            self.strike()
            self.rig.wait(CONFLICTING.longest + 0.1)
            while self.rig.workers.jobs:
                self.rig.work()
            self.rig.watch()

    def strike(self, limit: str = "700m") -> None:
        self.rig.cluster.edit("uid-slam", "slam", cpu=limit)
        self.rig.watch()

    @property
    def left(self) -> int | None:
        return self.rig.resizer.contests.left("uid-slam", "slam")


@pytest.fixture
def lost():
    """The writer has insisted for long enough."""
    return Contested(STRIKES + 1)


def test_what_is_put_back_is_not_left_in_place():
    contested = Contested(STRIKES)
    assert (contested.left, contested.heard) == (None, [])


def test_what_a_writer_insists_on_is_left_in_place_and_reported(lost):
    assert (lost.left, lost.heard) == (700, ["lab"])


def test_another_value_of_that_writer_is_left_in_place_instead(lost):
    lost.strike("710m")
    assert (lost.left, lost.heard) == (710, ["lab"] * 2)


def test_the_plan_is_enforced_again_when_it_is_tried_again(lost):
    lost.rig.wait(YIELDED)
    lost.rig.work()
    lost.rig.wait(1)
    assert (lost.left, lost.heard) == (None, ["lab"] * 2)
    assert lost.rig.cluster.limit("slam") == 300


@pytest.mark.parametrize(
    "end",
    [
        lambda rig: rig.hold(POLICY),
        lambda rig: rig.release(),
        lambda rig: rig.remove("uid-slam"),
        lambda rig: rig.resizer.abandon(POLICY),
    ],
    ids=["unclaimed", "policy deleted", "pod gone", "namespace left to another operator"],
)
def test_nothing_is_left_in_place_where_nothing_is_enforced(lost, end):
    end(lost.rig)
    lost.rig.wait(1)
    assert lost.left is None


def test_only_the_pods_of_an_abandoned_namespace_are_forgotten():
    contests, here = Contests(), view(a_pod("slam"))
    there = view(a_pod("arm", namespace="elsewhere"))
    for pod in (here, there):
        contests.note(pod, pod.name, 700)
    contests.abandon("lab")
    assert (contests.left("uid-slam", "slam"), contests.left("uid-arm", "arm")) == (None, 700)
