"""Real modules in pods: what they publish about themselves and the node, and that a policy acts on it."""

from __future__ import annotations

import json
import queue
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pytest

from modules.signs.rendering import TEST_FONTS, Conditions, render
from tests.e2e.cluster import apply, until
from tests.e2e.conftest import router
from tests.e2e.robot import pod, task
from timelines.datasets import euroc
from timelines.datasets.motion import Motion
from timelines.datasets.readers import read

if TYPE_CHECKING:
    from pathlib import Path

HOST = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": "200m", "memory": "128Mi"}}
SIGNS = {"requests": {"cpu": "10m", "memory": "64Mi"}, "limits": {"cpu": "1", "memory": "512Mi"}}
SLAM = {"requests": {"cpu": "10m", "memory": "64Mi"}, "limits": {"cpu": "1", "memory": "512Mi"}}


def module(name, namespace, resources):
    """A pod of a module's own image."""
    manifest = pod(name, namespace, [], resources)
    container = manifest["spec"]["containers"][0]
    del container["command"]
    container["image"] = f"contextpolicy-{name}:dev"
    container["env"] = [{"name": "ZENOH_CONNECT", "value": router()}]
    return manifest


def heard(session, key):
    """Every JSON object on a key, as it comes."""
    samples: queue.Queue[dict[str, object]] = queue.Queue()
    subscriber = session.declare_subscriber(key, lambda sample: samples.put(json.loads(sample.payload.to_bytes())))
    return samples, subscriber


@pytest.fixture
def frames(tmp_path: Path):
    euroc.write(tmp_path / "short", euroc.Sequence(Motion(1, ((0, 1),))), progress=lambda _: None)
    return [payload for _, payload in read(tmp_path, "short/stereo")]


def test_the_host_reports_its_pressure_from_inside_a_pod(session, empty):
    samples, subscriber = heard(session, "robot/host/state")
    apply(module("host", empty.namespace, HOST))
    reading = samples.get(timeout=60)
    subscriber.undeclare()
    assert reading["memory"] > 0
    assert reading["load"] is not None
    assert set(reading["pressure"]) == {"cpu", "memory", "io"}


def test_a_sign_is_read_once_in_a_pod(session, empty):
    """PP-OCR's networks out of the image, on a read-only file system."""
    signs, subscriber = heard(session, "robot/signs/number")
    health, listener = heard(session, "robot/signs/health")
    apply(module("signs", empty.namespace, SIGNS))
    health.get(timeout=120)
    camera = session.declare_publisher("robot/camera/side")
    seen = Conditions(height=32, tilt=15)
    for x in range(280, 320, 4):
        sign = render("214", TEST_FONTS[1], seen, np.random.default_rng(6), size=(752, 480), middle=(x, 200))
        camera.put(cv2.imencode(".jpg", sign.picture)[1].tobytes())
        until("the picture is done", lambda: health.get(timeout=10)["queue"] == 0, patience=60)
    reported = [signs.get(timeout=30)["text"]]
    while not signs.empty():
        reported.append(signs.get()["text"])
    for one in (subscriber, listener):
        one.undeclare()
    assert reported == ["214"]


def test_a_task_that_misses_its_deadlines_gets_more(session, empty, frames):
    """Its own health is a stream of the policy, in one line; 48m are too little for SLAM."""
    samples, subscriber = heard(session, "robot/slam/health")
    empty.start("speech")
    apply(module("slam", empty.namespace, SLAM))
    samples.get(timeout=120)
    empty.policy(
        reserve="1",
        streams=[{"name": "slam", "key": "robot/slam/health"}],
        tasks=[task("slam", priority=1), task("speech", priority=20)],
        contexts=[
            {"name": "starves", "when": "slam.misses > 0.1", "exitAfter": "1m", "tasks": {"slam": {"weight": 100}}}
        ],
    )
    until("the policy gives SLAM its small share", lambda: empty.limits("slam")["slam"] < 100)
    camera = session.declare_publisher("robot/camera/stereo")

    def helped():
        for frame in frames:
            camera.put(frame)
        reported = samples.get(timeout=10)
        return True if empty.limits("slam")["slam"] > 500 else reported

    until("slam reports missed deadlines, and gets more", helped, patience=60)
    subscriber.undeclare()
