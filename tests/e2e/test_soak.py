"""An hour, or a minute, of everything at once: contexts, pods that come and go, killed parts, and what others do.

    make soak [DURATION=3600] [SEED=7]

Afterwards nothing may have leaked, no limit was wrong at any moment, and every container is as it came. A soak of an
hour writes what it saw into docs/measurements/faults.md.
"""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import deque
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from random import randrange

import pytest

from tests.e2e.background import Background
from tests.e2e.cluster import REPOSITORY, CommandError, apply, delete, run, until
from tests.e2e.conftest import SYSTEM
from tests.e2e.robot import IDLE, pod, policy, task
from tests.e2e.test_faults import routes
from tests.node import access, components, lifecycle, processes
from tests.soak import growth, oracle, page, story
from tests.soak.growth import Size
from tests.soak.story import Coming, Flip, Killing, Trouble
from tests.soak.troubles import Troubles, member
from timelines.demo import deploy
from timelines.demo.cgroup import Cgroup, find

pytestmark = pytest.mark.skipif(access.user_cluster() is not None, reason="kills parts of the node: not on yours")

DURATION = float(os.environ.get("SOAK_SECONDS") or 75)
LONG = 3600.0
"""Seconds of a soak whose result is kept."""
SEED = int(os.environ.get("SOAK_SEED") or randrange(1_000_000))  # noqa: S311 - no secret, a story
CORES = 2
LOOK = 0.05
"""Seconds between two looks at the limits in the kernel."""
SIZE = 5.0
"""Seconds between two looks at the processes."""
RECOVERY = 420.0
"""Seconds in which everything is back: a container that was killed several times waits up to five minutes."""


def soak_policy(namespace):
    """Three tasks, and contexts that overlap."""
    effects = {"speech": {"suspend": True}, "slam": {"scale": 2}}
    moving = {"name": "moving", "when": "imu.speed > 0.05", "tasks": effects}
    loud = {"name": "loud", "when": "mic.level > 0.5", "tasks": {"speech": {"scale": 3}, "arm": {"suspend": True}}}
    keys = {"imu": "imu", "mic": "mic", "loud": "loud/**"}
    streams = [{"name": name, "key": f"{namespace}/{key}"} for name, key in keys.items()]
    return policy(namespace, streams=streams, tasks=[task(name) for name in story.TASKS], contexts=[moving, loud])


def readings():
    """All that the sensors can say, and what they have not said yet."""
    imu = ({}, *({"imu": {"speed": speed}} for speed in (0.0, 0.3)))
    mic = ({}, *({"mic": {"level": level}} for level in (0.0, 0.9)))
    return [{**one, **other} for one in imu for other in mic]


@dataclass
class Living:
    """A task's container, with the limit that it came with."""

    task: str
    cgroup: Cgroup
    original: int

    def limit(self):
        """In thousandths of a core; None when the container is gone."""
        try:
            cores = self.cgroup.limit()
        except OSError:
            return None
        return None if cores is None else round(cores * 1000)


@dataclass
class Watch(Background):
    """Looks at limits and processes all the time, from a thread of its own."""

    planned: dict[str, set[int]]
    living: dict[str, Living] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    sizes: dict[str, list[Size]] = field(default_factory=lambda: {part: [] for part in story.PODS})
    pids: dict[str, int] = field(default_factory=dict)
    looks: int = 0
    began: float = field(default_factory=time.monotonic)

    def __post_init__(self):
        super().__init__(self._watch)

    def _watch(self):
        due = 0.0
        while not self._stop.wait(LOOK):
            for one in list(self.living.values()):
                self._look(one)
            if time.monotonic() >= due:
                due = time.monotonic() + SIZE
                self._measure()

    def _look(self, one):
        limit = one.limit()
        self.looks += limit is not None
        if limit is not None and oracle.wrong(limit, one.original, self.planned[one.task]):
            at = time.monotonic() - self.began
            self.wrong.append(f"{one.task}: {limit}m after {at:.1f} s, came with {one.original}m")

    def _measure(self):
        for part, pid in list(self.pids.items()):
            try:
                self.sizes[part].append(Size.of(pid, time.monotonic()))
            except OSError:
                self.pids.pop(part, None)


class Stage(Background):
    """Carries out what the story says, each kind in its own thread: a pod that takes long must not stop contexts."""

    def __init__(self, robot, watch, session, link):
        super().__init__(self._supervise, self._replace_all, self._have_troubles, patience=RECOVERY)
        self.robot, self.watch = robot, watch
        self._coming_troubles: deque[Trouble] = deque()
        self.killed: list[str] = []
        self.originals: dict[str, int] = {}
        self.troubles = Troubles(robot, session, link, self.originals.get)
        self._away: dict[str, float] = {}
        self._wanted: dict[str, Coming] = {}
        self._come: dict[str, Coming] = {}

    def play(self, events):
        """All of the story, in its own time; then everything is back, and every pod has come that was to come."""
        began = time.monotonic()
        for event in events:
            time.sleep(max(0.0, began + event.at - time.monotonic()))
            self.check()
            self._carry_out(event)
        until("every part is back", lambda: not self._missing() or self._missing(), RECOVERY)
        for name in components.names():
            lifecycle.start(name)  # waits until it serves
        until("every pod has come", lambda: self._come == self._wanted, RECOVERY)
        until("no trouble is left", lambda: not self._coming_troubles or list(self._coming_troubles), RECOVERY)
        self.troubles.clear()
        until("our own processes are back", lambda: all(map(main_processes, story.PODS)), RECOVERY)

    def _carry_out(self, event):
        match event:
            case Flip(speed=speed, level=level):
                self.robot.drive(speed)
                self.robot.hear(level)
            case Coming():
                self._wanted[event.task] = event  # a busy node replaces pods more slowly than they are to come
            case Killing(part=part, away=away):
                self._kill(part, away)
            case Trouble():
                self._coming_troubles.append(event)

    def _kill(self, part, away):
        self._away[part] = time.monotonic() + away
        pid = self.watch.pids.get(part) if part in story.PODS else processes.alive(part)
        if pid is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
                self.killed.append(part)

    def _missing(self):
        return [name for name in components.names() if processes.alive(name) is None]

    def _supervise(self):
        """Start again what has ended, as k3s or systemd would, also what ended itself; note our own processes' ids."""
        while not self._stop.wait(1.0):
            for name in self._missing():
                if time.monotonic() >= self._away.get(name, 0.0):
                    # Not waited for: it may need another one that is away, and ends itself until that is back.
                    processes.start(name, lifecycle.component(name).argv)
            for part in story.PODS:
                if self.watch.pids.get(part) is None and (pids := main_processes(part)):
                    self.watch.pids[part] = min(pids)

    def _replace_all(self):
        while not self._stop.wait(0.2):
            for name, wanted in list(self._wanted.items()):
                if self._come.get(name) is not wanted and self._replaced(wanted):
                    self._come[name] = wanted

    def _have_troubles(self):
        """One after the other; what can't be done because a part is away is left out."""
        while not self._stop.wait(0.2):
            if self._coming_troubles:
                one = self._coming_troubles[0]
                with contextlib.suppress(AssertionError, LookupError, deploy.DeployError, subprocess.TimeoutExpired):
                    self.troubles.have(one.kind, one.task)
                self._coming_troubles.popleft()

    def _replaced(self, wanted):
        """Whether it could be done: the API or the kubelet may be away in the middle of it."""
        try:
            self.replace(wanted.task, wanted.limit)
        except (CommandError, subprocess.TimeoutExpired):
            return False
        return True

    def replace(self, name, limit):
        """Delete the task's pod, and create another one with the same name."""
        self.stop(name)
        apply(stateful_set(name, self.robot.namespace, limit))
        self._kubectl("rollout", "status", f"statefulset/{name}", "--timeout=60s")
        cgroup = self.robot.container(member(name))
        if cgroup is None:
            raise CommandError(f"{name} has no cgroup")
        self.originals[name] = limit
        self.watch.living[name] = Living(name, cgroup, limit)

    def stop(self, name):
        """Delete the task's pod and its StatefulSet, in this order."""
        self.watch.living.pop(name, None)
        self.originals.pop(name, None)
        how = ("--ignore-not-found", "--cascade=foreground", "--timeout=60s")
        self._kubectl("delete", f"statefulset/{name}", *how)

    def _kubectl(self, *command):
        run("kubectl", *command, "-n", self.robot.namespace)


def stateful_set(name, namespace, limit):
    """A task whose StatefulSet states the original limit of its pod.

    The original of a pod without an owner is lost if somebody empties or forges it while no operator runs.
    """
    resources = {"requests": {"cpu": "10m", "memory": "32Mi"}, "limits": {"cpu": f"{limit}m", "memory": "64Mi"}}
    made = pod(name, namespace, IDLE, resources)
    template = {"metadata": {"labels": made["metadata"]["labels"]}, "spec": made["spec"]}
    spec = {"serviceName": name, "selector": {"matchLabels": template["metadata"]["labels"]}, "template": template}
    return {
        "apiVersion": "apps/v1",
        "kind": "StatefulSet",
        "metadata": {"name": name, "namespace": namespace},
        "spec": spec,
    }


def main_processes(part):
    """The processes of a part that runs in a pod, by its cgroup; none while it is away, or nobody can be asked."""
    labels = f"app.kubernetes.io/component={part}"
    try:
        found = json.loads(run("kubectl", "get", "pods", "-n", SYSTEM, "-l", labels, "-o", "json", timeout=20))
    except (CommandError, subprocess.TimeoutExpired, ValueError):
        return set()
    statuses = [status for one in found["items"] for status in one["status"].get("containerStatuses", [])]
    groups = [find(status["containerID"]) for status in statuses if "running" in status["state"]]
    pids = {pid for group in groups if group is not None for pid in group.processes()}
    with contextlib.suppress(OSError):  # one has just ended
        return pids if part != "router" else set(filter(routes, pids))
    return set()


@pytest.fixture(scope="module")
def soaked(robot, session, link, request):
    """The robot after its soak: what was seen, and the stage on which it was."""
    planned = oracle.plans(soak_policy(robot.namespace), CORES, readings())
    apply(soak_policy(robot.namespace))
    robot.stop("slam", "speech")
    with Watch(planned) as watch, Stage(robot, watch, session, link) as stage:
        for name in story.TASKS:
            stage.replace(name, 400)
        until("our own processes are known", lambda: watch.pids.keys() == set(story.PODS))
        print(f"soak: {DURATION:.0f} s, SOAK_SEED={SEED}", file=sys.stderr)  # noqa: T201 - to repeat it
        stage.play(story.story(SEED, DURATION))
        failures = request.session.testsfailed
        yield stage
    if DURATION >= LONG:
        keep(stage, failed=request.session.testsfailed - failures)
    for name in story.TASKS:
        stage.stop(name)


def keep(stage, failed):
    """Write what was seen into the page of measurements."""
    file = REPOSITORY / "docs" / "measurements" / "faults.md"
    lives = {part: growth.last_life(sizes) for part, sizes in stage.watch.sizes.items()}
    said = [f"{failed} of 4 checks"] if failed else []
    today = datetime.now(UTC).date()
    seen = page.Soak(SEED, DURATION, today, os.cpu_count() or 0, stage.killed, stage.troubles.had, said, lives)
    file.write_text(page.replaced(file.read_text(encoding="utf-8"), page.section(seen)), encoding="utf-8")


def test_no_limit_was_ever_wrong(soaked):
    assert soaked.watch.looks > DURATION
    assert soaked.watch.wrong == []


def test_the_newest_plan_is_in_force_afterwards(soaked):
    robot = soaked.robot
    for speed, level, expected in (
        (0.3, 0.0, {"slam": 660, "speech": 10, "arm": 330}),
        (0.0, 0.9, {"slam": 250, "speech": 740, "arm": 10}),
    ):
        robot.drive(speed)
        robot.hear(level)
        until(f"the kernel enforces {expected}", lambda want=expected: _now(soaked) == want or _now(soaked), RECOVERY)


def test_nothing_leaked(soaked):
    found = []
    lines = [f"soak of {DURATION:.0f} s, SOAK_SEED={SEED}, killed: {', '.join(soaked.killed)}"]
    lines.append(f"troubles: {', '.join(soaked.troubles.had)}")
    for part, sizes in soaked.watch.sizes.items():
        life = growth.last_life(sizes)
        lines.append(growth.reported(part, life))
        found += growth.leaks(part, life)
    file = Path("build/e2e/soak.txt")
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text("\n".join(lines) + "\n")
    looked = {part: [asdict(size) for size in sizes] for part, sizes in soaked.watch.sizes.items()}
    file.with_suffix(".json").write_text(json.dumps(looked))
    print("\n".join(lines), file=sys.stderr)  # noqa: T201 - a slope is to be seen
    assert found == []


def test_deleted_policy_restores_every_container(soaked):
    delete("ctxp", "robot", soaked.robot.namespace)
    expected = soaked.originals
    until(f"the kernel enforces {expected}", lambda: _now(soaked) == expected or _now(soaked))


def _now(stage):
    return {name: one.limit() for name, one in stage.watch.living.items()}
