"""Which runs count: the machine had its pace, the player was in time, and the recording is complete."""

from __future__ import annotations

from dataclasses import replace

import pytest

from tests.timelines.experiments.made_up import ABOUT, a_run
from timelines.experiments.validity import reasons


def changed(**about):
    run = a_run("linux")
    return replace(run, about={**run.about, **about})


def test_a_run_on_a_quiet_machine_counts():
    assert list(reasons(a_run("linux", slam="d" * 10))) == []  # whatever was missed in it


@pytest.mark.parametrize(
    ("left", "worst", "said"),
    [
        (0.95, 0.9, "95% of their pace, and 90% in their worst second: expected 97% to 105%, and at least 70%"),
        (0.99, 0.6, "99% of their pace, and 60% in their worst second"),
        (1.1, 1.0, "110% of their pace"),
    ],
)
def test_processors_that_had_another_pace_do_not_count(left, worst, said):
    (reason,) = reasons(changed(pace={**ABOUT["pace"], "left": left, "worst": worst}))
    assert said in reason


def under(configuration, speed):
    run = a_run(configuration)
    return replace(run, about={**run.about, "expected": 1e6, "pace": {**ABOUT["pace"], "speed": 1e6 * speed}})


@pytest.mark.parametrize("speed", [0.46, 0.79, 1.21])
def test_limits_that_counted_on_another_speed_do_not_count(speed):
    """As measured: the host halved its speed between two runs, and limits allowed half the work."""
    (reason,) = reasons(under("limits", speed))
    assert reason == f"the processors were {speed:.0%} as fast as the limits counted on: expected 80% to 120%"


@pytest.mark.parametrize(
    ("configuration", "speed"), [("limits-gated", 0.81), ("limits-resized", 1.19), ("weights", 0.46)]
)
def test_limits_that_counted_on_about_the_speed_count_and_weights_count_on_none(configuration, speed):
    assert list(reasons(under(configuration, speed))) == []


def test_a_run_during_which_the_machine_stood_still_does_not_count():
    """What comes late comes all at once: it says nothing about who gets the CPU."""
    (reason,) = reasons(replace(a_run("linux"), late={"robot/camera/stereo": [10, 0, 2001, 2001]}))
    assert reason == "50 % of the inputs were published more than 0.2 s late: expected at most 1 %"


def test_a_run_with_an_incomplete_recording_does_not_count():
    (reason,) = reasons(changed(unheard={"slam/stereo": 14}))
    assert reason == "the recording lacks 14 inputs that slam/stereo has done"


def test_all_reasons_are_given_at_once():
    assert len(list(reasons(changed(unheard={"slam/stereo": 14}, pace={**ABOUT["pace"], "left": 2.0})))) == 2
