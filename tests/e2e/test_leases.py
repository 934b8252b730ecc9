"""One operator acts, and another is soon there: killed, paused, rolled out, or of another release.

Each story prints what it measured; docs/measurements/faults.md has the figures.
"""

import contextlib
import itertools
import json
import os
import signal
import statistics
import sys
import time

import pytest
import yaml

from contextpolicy.bus.session import open_visitor
from tests.e2e.background import Background
from tests.e2e.cluster import REPOSITORY, apply, apply_definition, get, helm_command, run, until
from tests.e2e.robot import Robot, Sensors, together
from timelines.demo.cgroup import find
from timelines.demo.deploy import free_address

SYSTEM, NAMESPACE, SECOND = "e2e-lease-system", "e2e-lease", "e2e-second-system"


def install(release, system, address, **values):
    settings = {
        "fullnameOverride": release,
        "image.tag": "dev",
        "crds.enabled": "false",
        "restoreOnUninstall": "false",
        "rbac.aggregateToUserRoles": "false",
        "security.enabled": "false",
        "watchNamespaces": "{" + NAMESPACE + "}",
        **values,
    }
    if address:
        settings["router.service.clusterIP"] = address
    run(*helm_command(release, system, settings), timeout=150)


def remove(release, system):
    run("helm", "uninstall", release, "--namespace", system, "--ignore-not-found", "--wait", "--timeout", "60s")


def pods(release, system):
    labels = f"app.kubernetes.io/component=operator,app.kubernetes.io/instance={release}"
    found = json.loads(run("kubectl", "get", "pods", "-n", system, "-l", labels, "-o", "json"))
    return [pod for pod in found["items"] if "deletionTimestamp" not in pod["metadata"]]


def leader():
    holder = run("kubectl", "get", "lease", "lease", "-n", SYSTEM, "-o", "jsonpath={.spec.holderIdentity}")
    return next((pod for pod in pods("lease", SYSTEM) if holder.startswith(pod["metadata"]["name"])), None)


def processes(pod):
    cgroup = find(pod["status"]["containerStatuses"][0]["containerID"])
    return cgroup.processes() if cgroup else []


def send(pod, number):
    for pid in processes(pod):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)


def all_ready(count):
    def look():
        found = pods("lease", SYSTEM)
        return len(found) == count and all(
            status["ready"] for pod in found for status in pod["status"].get("containerStatuses") or [{"ready": False}]
        )

    return look


def started_again(pod):
    """Whether the killed container runs again: for a moment after the kill the API server still calls it ready."""
    name, before = pod["metadata"]["name"], pod["status"]["containerStatuses"][0]["restartCount"]

    def look():
        [status] = [
            one["status"]["containerStatuses"][0] for one in pods("lease", SYSTEM) if one["metadata"]["name"] == name
        ]
        return (status["restartCount"] > before and status["ready"]) or status["state"]

    return look


class Flipping(Background):
    """Contexts that change all the time, and when the kernel's limits followed; sums of limits as they were."""

    def __init__(self, robot):
        super().__init__(self._flip, self._look)
        self._robot = robot
        self.changes, self.sums = [], []

    def gap(self, since):
        """The longest time without a change of limits, from `since` on."""
        moments = [since, *(at for at in self.changes if at > since)]
        return max(later - earlier for earlier, later in itertools.pairwise(moments))

    def first(self, since):
        return next((at - since for at in self.changes if at > since), None)

    def _flip(self):
        for speed in itertools.cycle([0.3, 0.0]):
            self._robot.drive(speed)
            if self._stop.wait(0.1):
                return

    def _look(self):
        cgroups = {task: self._robot.container(task) for task in ("slam", "speech")}
        before = None
        while not self._stop.wait(0.005):
            limits = together(cgroups)
            if limits:
                self.sums.append(sum(limits.values()))
                if limits != before:
                    before = limits
                    self.changes.append(time.monotonic())


@pytest.fixture(scope="module")
def governed():
    """A robot under a release with a standby."""
    apply_definition()
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": NAMESPACE}})
    try:
        install("lease", SYSTEM, free_address(52), **{"operator.replicas": "2"})
        with open_visitor([f"tcp/{free_address(52)}:7447"], patience=20) as session, Sensors(session) as sensors:
            robot = Robot(NAMESPACE, sensors)
            robot.drive(0.0)
            robot.start("slam", "speech")
            robot.policy(enforcement={"transition": "Strict"})
            robot.expect(slam=500, speech=500)
            yield robot
            run("kubectl", "delete", "ctxp", "--all", "-n", NAMESPACE, "--timeout=60s")
    finally:
        for release, system in (("second", SECOND), ("lease", SYSTEM)):
            remove(release, system)
        run("kubectl", "delete", "namespace", SYSTEM, SECOND, NAMESPACE, "--ignore-not-found", "--timeout=90s")


def report(what, seconds):
    seconds = sorted(seconds)
    sys.stdout.write(
        f"\n{what}: median {statistics.median(seconds):.2f} s, worst {seconds[-1]:.2f} s of {len(seconds)}\n"
    )


def test_a_standby_takes_over_from_a_killed_operator(governed):
    until("both replicas are ready", all_ready(2))
    times = []
    for _ in range(int(os.environ.get("KILLS", "1"))):
        until("both replicas are ready", all_ready(2), patience=400)
        first = leader()
        with Flipping(governed) as flipping:
            until("limits follow", lambda flipping=flipping: len(flipping.changes) > 2)
            killed = time.monotonic()
            send(first, signal.SIGKILL)
            # What the API server had accepted before is not counted.
            until("limits follow again", lambda f=flipping, at=killed: f.first(at + 0.3) is not None, patience=180)
            times.append(flipping.first(killed + 0.3) + 0.3)
        assert max(flipping.sums) <= 1000
        until("it is started again", started_again(first), patience=400)
    report("takeover after SIGKILL", times)


def test_frozen_leader_changes_nothing_after_a_takeover(governed):
    until("both replicas are ready", all_ready(2), patience=400)
    first = leader()
    with Flipping(governed) as flipping:
        until("limits follow", lambda: len(flipping.changes) > 2)
        send(first, signal.SIGSTOP)
        until("the other leads", lambda: leader()["metadata"]["name"] != first["metadata"]["name"])
        send(first, signal.SIGCONT)
        time.sleep(5)
    assert max(flipping.sums) <= 1000
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)


def test_kubelet_uses_the_documented_crash_loop_backoff():
    node = json.loads(run("kubectl", "get", "nodes", "-o", "json"))["items"][0]["metadata"]["name"]
    config = json.loads(run("kubectl", "get", "--raw", f"/api/v1/nodes/{node}/proxy/configz"))["kubeletconfig"]
    reported = yaml.safe_load((REPOSITORY / "config" / "k3s" / "kubelet.conf").read_text(encoding="utf-8"))
    assert config["crashLoopBackOff"] == reported["crashLoopBackOff"]


def roll_out(governed, what):
    """Roll the operator out while contexts change, and report the longest gap; what was seen."""
    with Flipping(governed) as flipping:
        until("limits follow", lambda: len(flipping.changes) > 2)
        begun = time.monotonic()
        run("kubectl", "rollout", "restart", "deployment/lease", "-n", SYSTEM)
        run("kubectl", "rollout", "status", "deployment/lease", "-n", SYSTEM, "--timeout=180s", timeout=200)
        time.sleep(1)
    report(what, [flipping.gap(begun)])
    return flipping


def test_a_rollout_leaves_no_gap(governed):
    until("both replicas are ready", all_ready(2), patience=400)
    assert max(roll_out(governed, "longest gap in a rollout").sums) <= 1000


def test_killed_lone_operator_is_restarted(governed):
    install("lease", SYSTEM, free_address(52), **{"operator.replicas": "1"})
    until("one is left", all_ready(1), patience=180)
    times = []
    for _ in range(int(os.environ.get("KILLS", "1"))):
        with Flipping(governed) as flipping:
            until("limits follow", lambda flipping=flipping: len(flipping.changes) > 2)
            [pod] = pods("lease", SYSTEM)
            killed = time.monotonic()
            send(pod, signal.SIGKILL)
            until("it is started again", started_again(pod), patience=400)
            until("limits follow again", lambda f=flipping, at=killed: f.first(at + 0.3) is not None)
            times.append(flipping.first(killed + 0.3) + 0.3)
        assert max(flipping.sums) <= 1000
    report("restart after SIGKILL, no standby", times)
    roll_out(governed, "longest gap in a rollout, no standby")


def test_second_release_never_touches_the_namespace(governed):
    """A canary, or the idle half of blue and green.

    It has a router of its own, where nobody moves: if it decided, both tasks would share alike. Its Job may write
    everywhere that the first release may.
    """
    install("second", SECOND, free_address(53), restoreOnUninstall="true")
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
    before = get("ctxp", "robot", NAMESPACE)
    assert before["status"]["originals"]
    with Flipping(governed) as flipping:
        time.sleep(5)
        log = run("kubectl", "logs", "-n", SECOND, "deployment/second")
        remove("second", SECOND)
    assert f"namespace {NAMESPACE} is served by {SYSTEM}/lease" in log
    assert max(flipping.sums) <= 1000
    assert len(flipping.changes) > 10
    after = get("ctxp", "robot", NAMESPACE)
    assert after["status"]["originals"] == before["status"]["originals"]
    assert after["metadata"]["finalizers"] == before["metadata"]["finalizers"]
    governed.drive(0.3)
    governed.expect(slam=990, speech=10)
