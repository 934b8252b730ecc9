"""Frames from pod to pod: by the node's shared memory they are not copied through the router's sockets."""

from __future__ import annotations

import json
import shutil
from typing import TYPE_CHECKING

import pytest

from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import REPOSITORY, apply, delete, get, run, until
from tests.e2e.robot import pod
from timelines.datasets import euroc
from timelines.datasets.motion import Motion
from timelines.demo.cgroup import find

if TYPE_CHECKING:
    from pathlib import Path

NAMESPACE = "e2e-pods"
USER = 65532
"""Segments belong to the user that made them, so that router, camera and module are one user."""
SECONDS, RATE = 8, 10
RESOURCES = {"requests": {"cpu": "10m", "memory": "64Mi"}, "limits": {"cpu": "1", "memory": "512Mi"}}
TABLE = REPOSITORY / "build" / "e2e" / "shared-memory.md"


@pytest.fixture(scope="module")
def recordings():
    """A short EuRoC sequence where pods may read it."""
    folder = REPOSITORY / "build" / "e2e" / "recordings"
    shutil.rmtree(folder, ignore_errors=True)
    moving = euroc.Sequence(Motion(SECONDS, ((0, SECONDS),)))
    euroc.write(folder / "short", moving, progress=lambda _: None)
    yield folder
    shutil.rmtree(folder)


@pytest.fixture(scope="module")
def figures():
    """Rows of a table that says what the memory saves."""
    rows = [
        "| frames by | frames | shared | CPU of the router per frame (ms) | of the camera (ms) |",
        "|---|---|---|---|---|",
    ]
    yield rows
    TABLE.parent.mkdir(parents=True, exist_ok=True)
    TABLE.write_text("\n".join(rows) + "\n")


def pod_on_the_bus(name, image, *, memory, recordings=None, **environment):
    """A pod as the charts make it, with or without the node's memory at /dev/shm."""
    manifest = pod(name, NAMESPACE, [], RESOURCES)
    spec, container = manifest["spec"], manifest["spec"]["containers"][0]
    del container["command"]
    container["image"] = image
    container["env"] = [{"name": key, "value": value} for key, value in environment.items()]
    spec["securityContext"] = {"runAsUser": USER, "runAsGroup": USER}
    paths = {"shm": ("/dev/shm", "/dev/shm")} if memory else {}  # noqa: S108 - the mount that Zenoh uses
    if recordings:
        paths["recordings"] = (str(recordings), "/recordings")
    spec["volumes"] = [{"name": key, "hostPath": {"path": there}} for key, (there, _) in paths.items()]
    container["volumeMounts"] = [{"name": key, "mountPath": here} for key, (_, here) in paths.items()]
    return manifest


def start(manifest):
    """Start the pod; returns its address and its cgroup."""
    name = manifest["metadata"]["name"]
    apply(manifest)
    run("kubectl", "wait", f"pod/{name}", "-n", NAMESPACE, "--for=condition=Ready", "--timeout=60s")
    status = get("pod", name, NAMESPACE)["status"]
    return status["podIP"], find(status["containerStatuses"][0]["containerID"])


def frames(session):
    """What slam's profile says of its input."""
    replies = session.get("robot/slam/profile", timeout=10)
    reported = next((json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok), None)
    return reported and reported["inputs"]["stereo"]


def drive(recordings: Path, *, memory: bool):
    """Play the sequence from a camera's pod to slam's; frames, shared ones, and CPU in s of router and camera."""
    shared = {"SHARED_MEMORY": str(memory).lower()}
    router = pod_on_the_bus("frames-router", "contextpolicy:dev", memory=memory)
    router["spec"]["containers"][0]["args"] = ["router"]
    address, routing = start(router)
    endpoint = {"ZENOH_CONNECT": f"tcp/{address}:7447"}
    try:
        with open_visitor([endpoint["ZENOH_CONNECT"]], patience=30) as session:
            start(pod_on_the_bus("frames-slam", "contextpolicy-slam:dev", memory=memory, **endpoint, **shared))
            until("slam answers", lambda: frames(session) is not None, patience=120)
            before = routing.usage()
            source = {"CAMERA_SOURCE": "/recordings/short", **endpoint, **shared}
            camera = pod_on_the_bus(
                "frames-camera", "contextpolicy-camera:dev", memory=memory, recordings=recordings, **source
            )
            _, filming = start(camera)
            until(
                "slam has had nearly all frames", lambda: arrived(frames(session)) > SECONDS * RATE * 0.9, patience=120
            )
            seen = frames(session)
            return arrived(seen), seen["shared"], routing.usage() - before, filming.usage()
    finally:
        for name in ("frames-camera", "frames-slam", "frames-router"):
            delete("pod", name, NAMESPACE)


def arrived(reported):
    """How many frames came, whether or not slam had time for them."""
    return reported["done"] + reported["dropped"]


def test_frames_between_pods_stay_in_memory(session, recordings, figures):  # noqa: ARG001 - the namespace is the session's
    by_tcp, by_memory = (drive(recordings, memory=memory) for memory in (False, True))
    for name, (count, shared, router, camera) in (("TCP", by_tcp), ("shared memory", by_memory)):
        figures.append(f"| {name} | {count} | {shared} | {router / count * 1e3:.2f} | {camera / count * 1e3:.2f} |")
    assert by_tcp[1] == 0
    # The memory is made when the first frame asks for it, which itself goes by TCP.
    assert by_memory[1] >= by_memory[0] - 5
