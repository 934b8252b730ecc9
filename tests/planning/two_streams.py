"""A policy whose tasks and contexts read two streams."""

from __future__ import annotations

from tests.planning.builders import a_context, a_policy, a_stream, a_task


def two_streams(**spec):
    return a_policy(
        streams=[a_stream("imu"), a_stream("mic")],
        tasks=[
            a_task("slam", priority=10, activity=[{"when": "imu.speed > 0.1"}]),
            a_task("speech", activity=[{"when": "mic.level > 0.1"}], requires=[{"when": "mic.level > 0.05"}]),
            a_task("rest", idle=0.5),
        ],
        contexts=[a_context("moving", "imu.speed > 0.2"), a_context("both", "imu.speed > 0.3 && mic.level > 0.3")],
        **spec,
    )
