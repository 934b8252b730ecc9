"""A stream that one condition watches."""

from __future__ import annotations

from tests.planning.builders import Story, a_context, a_policy, a_task


def watching(stream, when="imu.speed > 0.0", **fields):
    """One stream and one context over it, so that `contexts_over_time` shows what the stream's readers saw."""
    spec = {"streams": [stream], "tasks": [a_task("slam")], "contexts": [a_context("on", when)]}
    return Story(a_policy(**spec, **fields))
