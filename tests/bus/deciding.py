"""A policy whose plans go to the bus."""

from __future__ import annotations

from tests.planning.builders import a_context, a_policy, a_stream, a_task

POLICY = a_policy(
    streams=[a_stream("imu")],
    tasks=[a_task("slam", priority=10), a_task("speech")],
    contexts=[a_context("moving", "imu.speed > 0.1", {"speech": {"suspend": True}})],
)
