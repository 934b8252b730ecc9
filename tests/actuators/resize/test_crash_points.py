"""The operator is killed at every call to the API, before and after its effect: what the next one makes of it."""

from __future__ import annotations

import itertools

import pytest

from tests.actuators.resize.fake_cluster import Killed, Unanswered
from tests.actuators.resize.rig import POLICY, Rig, by_id
from tests.cluster.builders import a_pod, cpu

BEFORE = {"slam": 500, "map": 300, "speech": 400}
FIRST = {"slam__slam": 800, "slam__map": 100, "speech__speech": 300}
SECOND = {"slam__slam": 100, "slam__map": 200, "speech__speech": 900}
CALLS = 10
"""What the story below costs: one write of the originals and one that takes the first of them away, and every decrease
before every increase."""
POINTS = list(itertools.product(range(CALLS), [False, True]))


class Story:
    """A policy plans twice and is deleted; `target` is what it wants now, None when it is to be gone."""

    def __init__(self) -> None:
        self.rig = Rig(
            a_pod("slam", {"slam": cpu("10m", "500m"), "map": cpu("10m", "300m")}),
            a_pod("speech", {"speech": cpu("10m", "400m")}),
            stores=True,
        )
        self.target: dict[str, int] | None = None

    def run(self) -> None:
        for self.target in (FIRST, SECOND, None):
            self.rig.survive(self.ask_and_settle)
            self.go_on()

    def go_on(self) -> None:
        """The next operator, or the same one once more: asking again changes nothing."""
        self.ask_and_settle()
        limits = {**self.rig.cluster.limits("uid-slam"), **self.rig.cluster.limits("uid-speech")}
        originals = {**self.rig.cluster.originals("uid-slam"), **self.rig.cluster.originals("uid-speech")}
        if self.target is None:
            assert (limits, originals, self.rig.released) == (BEFORE, {}, [POLICY])
        else:
            assert limits == {name.rpartition("__")[2]: share for name, share in self.target.items()}
            assert {name: original.cpu.limit for name, original in originals.items()} == BEFORE

    def ask_and_settle(self) -> None:
        self.rig.released.clear()
        if self.target is None:
            self.rig.release()
        else:
            self.rig.order(POLICY, by_id(self.target), n=1200)
        self.rig.settle()


def test_the_story_has_this_many_calls():
    story = Story()
    story.run()
    assert len(story.rig.cluster.calls) == CALLS


@pytest.mark.parametrize(("call", "effect"), POINTS)
def test_operator_killed_at_any_call_still_converges(call, effect):
    story = Story()
    story.rig.cluster.faults.extend([None] * call + [Unanswered(Killed()) if effect else Killed()])
    story.run()
    assert not story.rig.cluster.faults, "never killed"


@pytest.mark.parametrize(("call", "effect"), POINTS)
def test_deleted_policy_is_restored_after_a_kill_at_any_call(call, effect):
    story = Story()
    story.rig.cluster.faults.extend([None] * call + [Unanswered(Killed()) if effect else Killed()])
    for story.target in (FIRST, SECOND, None):
        if not story.rig.survive(story.ask_and_settle):
            break
    assert not story.rig.cluster.faults, "never killed"
    story.target = None
    story.go_on()


@pytest.mark.parametrize("second", range(CALLS))
@pytest.mark.parametrize("first", range(CALLS))
def test_two_kills_in_a_row_still_converge(first, second):
    """The next operator dies as well, after as many calls of its own."""
    story = Story()
    story.rig.cluster.faults.extend([None] * first + [Unanswered(Killed())] + [None] * second + [Killed()])
    for story.target in (FIRST, SECOND, None):
        while not story.rig.survive(story.ask_and_settle):
            pass
        story.go_on()
