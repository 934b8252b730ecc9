"""A node's cgroups as plain files, and messages of the decision bus about its pods."""

from __future__ import annotations

import itertools
import json
from typing import TYPE_CHECKING

from hypothesis import strategies as st

from contextpolicy.agent.agent import Agent
from contextpolicy.agent.agent_settings import AgentSettings
from contextpolicy.agent.cgroup_paths import CgroupPaths, Driver
from contextpolicy.agent.control_files import CFS, REALTIME
from contextpolicy.agent.open_files import Unwatched
from contextpolicy.agent.threads import THREAD_FILES
from contextpolicy.agent.weight_units import FILES
from contextpolicy.policy.environment import DEFAULT_CONNECT

if TYPE_CHECKING:
    from pathlib import Path

NODE = "node-1"
LAYOUTS = [(1, Driver.CGROUPFS), (1, Driver.SYSTEMD), (2, Driver.CGROUPFS), (2, Driver.SYSTEMD)]
UNWATCHED = Unwatched()
POLICY = "robot/delivery"
SLAM, SPEECH, CHAT, SANDBOX = "a" * 64, "b" * 64, "c" * 64, "f" * 64

TIMES = itertools.count(1_800_000_000_000_000_000)
"""Nanoseconds since 1970: no two messages are signed at the same time."""

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)
"""Anything at all."""


class Tree:
    """The files that the kernel and the kubelet would make."""

    def __init__(self, mount: Path, version: int = 1, driver: Driver = Driver.CGROUPFS, *, realtime: bool = True):
        self.mount, self.version, self.realtime = mount, version, realtime
        self.layout = CgroupPaths(mount if version == 2 else mount / "cpu", version, driver)
        self.logs = logs_of(mount)
        self.logs.mkdir(parents=True, exist_ok=True)
        self._group(self.layout.top)
        if version == 2:
            (mount / "cgroup.controllers").write_text("cpu memory\n")

    def container(self, identity: str, *, limit: int | None = 500, uid: str | None = None, qos: str = "Burstable"):
        """Make a container and what is above it; the pod's limit is the sum of its containers'."""
        self.pod(uid or f"uid-{identity[0]}")
        group = self.layout.container(qos, uid or f"uid-{identity[0]}", f"containerd://{identity}")
        for above in reversed(group.parents):
            if above.is_relative_to(self.layout.top) and not above.exists():
                self._group(above)
        self._group(group)
        self.set(group, limit)
        limits = [self.limit(child) for child in group.parent.iterdir() if child.is_dir() and child.name != SANDBOX]
        self.set(group.parent, None if None in limits else sum(limit or 0 for limit in limits))
        return group

    def pod(self, uid: str, namespace: str = "robot"):
        """The kubelet keeps a directory for the logs of each pod."""
        for known in self.logs.glob(f"*_{uid}"):
            known.rmdir()
        (self.logs / f"{namespace}_pod_{uid}").mkdir()

    def sandbox(self, container: Path):
        """The pod's infrastructure container has no limit of its own, and does not keep the pod from having one."""
        self._group(container.parent / SANDBOX)

    def set(self, group: Path, limit: int | None):
        """Write a limit as the kubelet would."""
        form = CFS[self.version]
        time = form.unlimited if limit is None else str(limit * 100)
        (group / form.file).write_text(time + ("\n" if self.version == 1 else " 100000\n"))

    def limit(self, group: Path) -> int | None:
        form = CFS[self.version]
        time = (group / form.file).read_text().split()[0]
        return None if time == form.unlimited else int(time) // 100

    def set_weight(self, group: Path, weight: int):
        """Write a weight as the kubelet would, in the kernel's unit."""
        self.weight_file(group).write_text(f"{weight}\n")

    def weight(self, group: Path) -> int:
        """In the kernel's unit."""
        return int(self.weight_file(group).read_text().split()[0])

    def weight_file(self, group: Path) -> Path:
        return group / FILES[self.version]

    def budget(self, group: Path) -> int:
        """In thousandths of the group's period."""
        form = REALTIME[self.version]
        text = (group / form.file).read_text().split()
        period = (group / form.period_file).read_text().split()[0] if form.period_file else text[1]
        return int(text[0]) * 1000 // int(period)

    def threads(self, group: Path, *threads: int):
        (group / THREAD_FILES[self.version]).write_text("".join(f"{thread}\n" for thread in threads))

    def limit_file(self, group: Path) -> Path:
        return group / CFS[self.version].file

    def _group(self, group: Path):
        group.mkdir(parents=True)
        files = {"cgroup.procs": "", THREAD_FILES[self.version]: ""}
        if self.version == 1:
            files |= {"cpu.cfs_quota_us": "-1\n", "cpu.cfs_period_us": "100000\n", "cpu.shares": "1024\n"}
            files |= {"cpu.rt_runtime_us": "0\n", "cpu.rt_period_us": "1000000\n"} if self.realtime else {}
        else:
            files |= {"cpu.max": "max 100000\n", "cpu.weight": "100\n"} | (
                {"cpu.rt.max": "0 1000000\n"} if self.realtime else {}
            )
        for name, text in files.items():
            (group / name).write_text(text)


def an_agent(tree: Tree, state: Path, scheduler, watch=UNWATCHED, *, grace: float = 10.0):
    """An agent of this node, whose messages are signed one after the other unless a test says when.

    By default it watches in vain: tests say themselves who wrote what.
    """
    return Informed(agent_settings(tree.mount, state, grace=grace), scheduler, lambda _: watch)


def agent_settings(mount: Path, state: Path, *, grace: float = 10.0):
    return AgentSettings(
        node=NODE,
        keys=state,
        connect=(DEFAULT_CONNECT,),
        credentials=None,
        metrics_port=8081,
        log_format="text",
        log_level="info",
        cgroup_root=mount,
        logs=logs_of(mount),
        state=state,
        priority=10,
        grace=grace,
    )


def logs_of(mount: Path) -> Path:
    return mount.parent / f"{mount.name}-pods"


class Informed(Agent):
    def hear(self, policy, payload, signed=None):
        return super().hear(policy, payload, next(TIMES) if signed is None else signed)


class Watch:
    """What is watched."""

    def __init__(self):
        self.paths = set()

    def add(self, path):
        self.paths.add(path)

    def remove(self, path):
        self.paths.discard(path)


def a_target(identity: str = SLAM, cores: float = 0.5, *, task: str = "slam", **more):
    return {
        "task": task,
        "node": NODE,
        "namespace": "robot",
        "pod": f"{task}-0",
        "uid": f"uid-{identity[0]}",
        "qos": "Burstable",
        "container": task,
        "containerId": f"containerd://{identity}",
        "cores": cores,
        "limit": None,
        "weight": None,
        "quota": cores,
        "held": False,
        "original": 0.5,
        **more,
    }


def a_message(*targets, sequence: int = 1, capacity: float = 1.0, suspended: tuple[str, ...] = (), **more):
    tasks = {target["task"]: {"share": target["cores"], "suspended": target["task"] in suspended} for target in targets}
    weighted = any(target["weight"] is not None for target in targets)
    message = {
        "policy": POLICY,
        "run": 1,
        "sequence": sequence,
        "edition": 0,
        "mode": "Enforce",
        "scheduler": "CFS",
        "control": "Weight" if weighted else "Limit",
        "realtime": {"policy": "RR", "period": 0.1},
        "tasks": tasks,
        "nodes": {NODE: {"capacity": capacity, "scheduler": more.get("scheduler", "CFS"), "tasks": {}}},
        "targets": list(targets),
    }
    return json.dumps(message | more).encode()
