"""Ages that a stream reaches although its sender is alive, and that plans agree."""

from __future__ import annotations

import pytest

from tests.planning.builders import Story, a_context, a_policy, a_stream, a_task
from tests.policy.validation.loops import IMU, advised
from tests.policy.validation.loops import a_context as context_of


@pytest.mark.parametrize(
    ("when", "warned"),
    [("age(imu) > 0.5", True), ("imu.x > 1 && 0.5 >= age(imu)", True), ("age(imu) > 1", False), ("imu.x > 1", False)],
)
def test_an_age_below_sample_every(when, warned):
    found = advised(streams=[{**IMU, "sampleEvery": "1s"}], contexts=[context_of(when=when, suspends="")])
    message = "age(imu) exceeds 0.5 s between any two samples: with sampleEvery one counts in 1 s"
    assert (message in found) is warned
    assert not [one for one in advised(streams=[IMU], contexts=[context_of(when=when)]) if "sampleEvery" in one]


def test_a_steady_stream_reaches_it_again_and_again():
    story = Story(
        a_policy(
            streams=[a_stream("imu", sampleEvery="1s")],
            tasks=[a_task("slam")],
            contexts=[a_context("late", "age(imu) > 0.5")],
        )
    )
    for tenth in range(21):
        story.sample("imu", at=tenth / 10, x=1.0)
    turned = [active for _, active in story.contexts_over_time()]
    assert turned == [(), ("late",), (), ("late",), ()]
