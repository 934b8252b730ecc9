"""Virtual time begins where a recording's stamps are of their own moments."""

from __future__ import annotations

import pytest

from contextpolicy.simulation.epoch import EPOCH, epoch_of
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from tests.simulation.stories import a_context, a_policy, a_timeline, at

NOW = 1_800_000_000
S = {"name": "s", "key": "s", "timestamp": "stamp", "staleAfter": "1s"}
ROS = {"sec": NOW + 2, "nanosec": 500_000_000}


@pytest.mark.parametrize(
    ("values", "epoch"),
    [
        ({}, EPOCH),
        ({2.0: {"x": 1}}, EPOCH),
        ({2.0: {"stamp": (NOW + 2) * 10**9}}, NOW),
        ({2.5: {"stamp": ROS}}, NOW),
        ({2.0: {"stamp": NOW + 2}, 1.0: {"stamp": NOW + 1.5}}, NOW + 0.5),
        ({2.0: {"stamp": 12.5}}, EPOCH),
        ({2.0: {"stamp": "noon"}}, EPOCH),
        ({2.0: 7}, EPOCH),
    ],
    ids=["nothing", "no stamp", "nanoseconds", "ros", "the earliest", "simulated time", "no time", "no map"],
)
def test_the_epoch_follows_from_the_first_real_stamp(values, epoch):
    line = a_timeline(*(at(time, value) for time, value in values.items()), at(0, 1, "other"))
    assert epoch_of(a_policy(S), line) == epoch


def test_unread_stamps_do_not_set_the_epoch():
    line = a_timeline(at(0, {"stamp": NOW}))
    assert epoch_of(a_policy({"name": "s", "key": "s"}), line) == EPOCH
    assert epoch_of(a_policy({**S, "key": "other"}), line) == EPOCH


def test_a_recording_with_real_stamps_is_replayed_unchanged():
    samples = [at(i / 10, {"stamp": (NOW + i / 10) * 1e9, "v": i}) for i in range(20)]
    late = at(2.0, {"stamp": (NOW + 0.5) * 1e9, "v": 99})
    policy = a_policy(S, contexts=[a_context("s.v > 50", a={"weight": 2})])
    run = simulate(policy, a_timeline(*samples, late), robot=Robot({NODE: 1000}))
    assert run.planner.drops == {("s", "out of order"): 1}
    assert all(plan.contexts == () for plan in run.plans)
    assert [plan.time for plan in run.plans if "silent" in plan.cause] == []
    assert run.planner.streams["s"].silent


def test_samples_without_a_stamp_get_the_current_time():
    line = a_timeline(at(1.0, {"stamp": (NOW + 1) * 10**9}), at(1.5, {"v": 1}))
    run = simulate(a_policy(S), line, robot=Robot({NODE: 1000}), until=2)
    assert run.planner.streams["s"].value == {"stamp": (NOW * 10 + 15) * 10**8, "v": 1}
    assert run.epoch == NOW
