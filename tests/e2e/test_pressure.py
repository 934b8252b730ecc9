"""A cluster under pressure: an API that takes 5 s, a full disk, 200 pods that come and go, a debugger in a pod."""

from __future__ import annotations

import contextlib
import itertools
import json
import subprocess
import time

import pytest

from tests.e2e.cluster import delete, get, run, until
from tests.e2e.conftest import SYSTEM
from tests.e2e.robot import pod, together
from tests.node import access, components, lifecycle, shell
from tests.node.layout import ROOT

STATES = ((0.3, {"slam": 990, "speech": 10}), (0.0, {"slam": 500, "speech": 500}))
PODS = 200
ROOM = 8 << 20
"""Bytes that the datastore's disk has left before it is filled."""

own_node = pytest.mark.skipif(access.user_cluster() is not None, reason="changes the node: not yours")


def restarts():
    labels = "app.kubernetes.io/component=operator"
    [found] = json.loads(run("kubectl", "get", "pods", "-n", SYSTEM, "-l", labels, "-o", "json"))["items"]
    return found["status"]["containerStatuses"][0]["restartCount"]


@own_node
@pytest.mark.parametrize("delay", [1.5, 5.0], ids=["answers come late", "no answer comes in time"])
def test_an_api_server_that_is_slow(link, governed, faults, delay):
    """The Lease lasts longer than that: the operator may pause, never ends, and writes nothing old afterwards."""
    governed.policy(enforcement={"transition": "Strict"})
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    cgroups, before = {task: governed.container(task) for task in ("slam", "speech")}, restarts()
    promised = "limits are those of plans, together no more than there is; the newest wins"
    with faults(f"the API server takes {delay:g} s for each answer", promised) as seen:
        link.delay = delay
        for speed, _ in itertools.islice(itertools.cycle(reversed(STATES)), 8):
            governed.drive(speed)
            following = time.monotonic() + 2
            while time.monotonic() < following:
                assert sum((together(cgroups) or {}).values()) <= 1000
        link.delay = 0.0
        seen.back()
        governed.drive(0.0)
        governed.expect(slam=500, speech=500)
    time.sleep(6)  # what was under way still
    assert governed.limits("slam", "speech") == {"slam": 500, "speech": 500}
    assert restarts() == before


@contextlib.contextmanager
def small_disk():
    """The datastore is on a disk of its own for a while; gives the file that can fill it."""
    folder, aside = ROOT / "kine", ROOT / "kine-aside"
    lifecycle.stop("kine")
    folder.rename(aside)
    folder.mkdir()
    size = ROOM + sum(file.stat().st_size for file in aside.iterdir())
    shell.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(folder)])
    try:
        shell.run(["cp", "-a", f"{aside}/.", str(folder)])
        lifecycle.start("kine")
        yield folder / "filler"
    finally:
        lifecycle.stop("kine")
        (folder / "filler").unlink(missing_ok=True)
        shell.run(["cp", "-a", f"{folder}/.", str(aside)])
        shell.run(["umount", str(folder)])
        folder.rmdir()
        aside.rename(folder)
        for name in components.names():
            lifecycle.start(name)


def fill(file):
    with contextlib.suppress(OSError), file.open("wb", buffering=0) as out:
        while True:
            out.write(bytes(4096))


@own_node
@pytest.mark.skipif(components.datastore() != "kine", reason="the folder of another datastore")
def test_a_datastore_whose_disk_is_full(governed, faults):
    """The API server takes no write, or some: a plan that is carried out in part never gives more than there is."""
    governed.policy(enforcement={"transition": "Strict"})
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    cgroups = {task: governed.container(task) for task in ("slam", "speech")}
    promised = "limits are those of plans; the newest wins once there is room"
    with faults("the datastore's disk is full", promised) as seen, small_disk() as filler:
        fill(filler)
        for speed, _ in itertools.islice(itertools.cycle(reversed(STATES)), 6):
            governed.drive(speed)
            time.sleep(1)
            assert sum((together(cgroups) or {}).values()) <= 1000
        filler.unlink()
        seen.back()
        governed.drive(0.0)
        governed.expect(slam=500, speech=500)
    delete("ctxp", "robot", governed.namespace)
    governed.expect(slam=500, speech=500)


def test_two_hundred_pods_created_and_deleted(governed, faults):
    """They match a task's selector, but no node takes them: each change is one more that the operator looks at."""
    crowd = [pod(f"crowd-{number}", governed.namespace, ["true"], None) for number in range(PODS)]
    for one in crowd:
        one["metadata"]["labels"] |= {"app": "slam", "crowd": "yes"}
        one["spec"]["nodeSelector"] = {"nobody": "has"}
    before = restarts()
    asked = json.dumps({"apiVersion": "v1", "kind": "List", "items": crowd})
    leave = ("kubectl", "delete", "pods", "-n", governed.namespace, "-l", "crowd=yes", "--force", "--grace-period=0")
    with faults("200 pods that come and go", "contexts change limits meanwhile") as seen:
        try:
            with subprocess.Popen(["kubectl", "create", "-f", "-"], stdin=subprocess.PIPE, text=True) as coming:
                assert coming.stdin is not None
                coming.stdin.write(asked)
                coming.stdin.close()
                for speed, limits in STATES * 2:
                    governed.drive(speed)
                    governed.expect(**limits)
        finally:
            run(*leave)
        seen.back()
        governed.drive(0.3)
        governed.expect(slam=990, speech=10)
    assert restarts() == before
    until("both tasks are bound", lambda: governed.status()["boundTasks"] == "2/2" or governed.status())


def test_a_debugger_in_a_tasks_pod_is_left_alone(governed):
    """An ephemeral container has no resources, and can have none: a resize that named it would be refused."""
    how = ("--image=contextpolicy:dev", "--image-pull-policy=IfNotPresent", "--container=debugger")
    run("kubectl", "debug", "slam", "-n", governed.namespace, *how, "--", "sleep", "infinity")
    try:
        for speed, limits in STATES:
            governed.drive(speed)
            governed.expect(**limits)
        [debugger] = get("pod", "slam", governed.namespace)["spec"]["ephemeralContainers"]
        assert not debugger.get("resources")
        assert governed.condition("Applied")[0] == "True"
    finally:
        governed.stop("slam")
        governed.start("slam")
