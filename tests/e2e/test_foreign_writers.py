"""Somebody else resizes the same containers: it is reported and reverted, and never becomes a fight."""

import json
import time

import pytest

from tests.e2e.cluster import delete, get, run, until


def resize(robot, task, limit, manager):
    """As a VerticalPodAutoscaler or a person does it."""
    patch = {"spec": {"containers": [{"name": task, "resources": {"limits": {"cpu": limit}}}]}}
    where = ("-n", robot.namespace, "--subresource", "resize", "--field-manager", manager)
    run("kubectl", "patch", "pod", task, *where, "--patch", json.dumps(patch))


def generation(robot, task):
    return get("pod", task, robot.namespace)["metadata"]["generation"]


@pytest.mark.parametrize("manager", ["updater", "kubectl-patch"])  # as the VPA 1.8 and as kubectl call themselves
def test_foreign_limit_is_reported_and_put_back(governed, manager):
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    resize(governed, "slam", "300m", manager)
    governed.expect(slam=990, speech=10)
    said = f"{governed.namespace}/slam/slam: {manager} changed its CPU limit from 990m to 300m"
    until("the status names it", lambda: said in governed.condition("Applied")[1])
    assert any(said in message for message in governed.reported("ResizedByOther"))


def test_persistent_foreign_writer_is_reverted_with_backoff(governed):
    """It writes all the time; each of the operator's answers is one more generation, and each of its own.

    The pauses before the answers are 0, 0.5, 1, 2 and 4 s, and from then on 5 s.
    """
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    before, began = generation(governed, "slam"), time.monotonic()
    while time.monotonic() < began + 10:
        resize(governed, "slam", "300m", "vpa-updater")
    written, elapsed = generation(governed, "slam") - before, time.monotonic() - began
    assert 4 <= written <= 2 * (6 + elapsed / 5)
    assert "vpa-updater" in governed.condition("Applied")[1]
    governed.expect(slam=990, speech=10)


def test_a_writer_that_never_stops_wins_and_is_reported(governed):
    """After ten answers, half a minute here; nothing is reverted while it is reported."""
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    deadline = time.monotonic() + 150
    while "the operator leaves the change in place" not in governed.condition("Applied")[1]:
        assert time.monotonic() < deadline
        resize(governed, "slam", "300m", "vpa-updater")
    reported = generation(governed, "slam")
    for speed in (0.0, 0.3):
        governed.drive(speed)
        governed.expect(slam=300, speech=10 if speed else 500)
    assert generation(governed, "slam") == reported
    assert any("retries the plan's value every 10 min" in message for message in governed.reported("ResizedByOther"))
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)


@pytest.mark.parametrize("speed", [0.0, 0.3], ids=["where the plan had changed nothing", "where it had"])
def test_foreign_limit_never_becomes_the_original(governed, speed):
    governed.drive(speed)
    governed.expect(slam=990 if speed else 500, speech=10 if speed else 500)
    resize(governed, "slam", "700m", "vpa-updater")
    governed.expect(slam=990 if speed else 500)
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)
