"""A robot's policy and pods, so that a test names only what it is about."""

from __future__ import annotations

from tests.cluster.builders import cpu
from tests.planning.builders import a_context, a_stream, a_task, limited

IMU = "robot/imu"


def a_policy(name="robot", generation=1, created="2026-01-01T00:00:00Z", **spec):
    """While the robot moves slam gets all; else both the same."""
    full = {
        "streams": [a_stream("imu", staleAfter="10s")],
        "tasks": [a_task("slam"), a_task("speech")],
        "contexts": [a_context("moving", "imu.speed > 0.1", {"slam": {"weight": 8}, "speech": {"weight": 2}})],
        **spec,
    }
    metadata = {"name": name, "namespace": "lab", "uid": f"uid-{name}", "generation": generation}
    return {
        "apiVersion": "contextpolicy.dev/v1alpha1",
        "kind": "ContextPolicy",
        "metadata": {**metadata, "creationTimestamp": created},
        "spec": limited(full),
    }


def resources():
    return cpu("10m", "400m")
