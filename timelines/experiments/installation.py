"""One configuration on the node: operator and robot by helm, the policy by kubectl; fresh pods for every run."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from timelines.demo import bus, cgroup, deploy
from timelines.experiments.configurations import at_pace, autoscalers

if TYPE_CHECKING:
    from collections.abc import Mapping
    from contextlib import AbstractContextManager

    import zenoh

    from timelines.demo.cgroup import Cgroup
    from timelines.experiments.configurations import Configuration

    Document = dict[str, Any]

DEPTH = 100_000
"""So long that a queue drops nothing: what waits, waits."""
ROOM = "1536Mi"
"""Memory limit of a module with such a queue of pictures."""
KEEP = 1.0
"""Seconds that an input waits for its place on the bus: all configurations must have the same work."""
REALTIME = Path("/sys/fs/cgroup/cpu/cpu.rt_runtime_us")
CONTROL = ("operator", "router", "agent")
"""Containers of what decides and carries it out; the router is the bus, with and without."""
MODULES = deploy.REPOSITORY / "modules"
POLICY = Path(__file__).with_name("policy.yaml")
"""What all configurations with contexts start from."""
AGENT = ("agent.enabled=true", "agent.realtime=true")
AUTOSCALERS = "verticalpodautoscalers.autoscaling.k8s.io"


def policy_document(pace: float = 1.0, path: Path = POLICY) -> Document:
    """The policy that divides the whole robot when it gets its inputs at this pace."""
    document: Document = yaml.safe_load(path.read_text(encoding="utf-8"))
    return document if pace == 1 else at_pace(document, pace)


def cores() -> int:
    """Processors of this machine."""
    return os.cpu_count() or 1


def module_file(task: str) -> Document:
    """What a task's module.yaml says."""
    document: Document = yaml.safe_load((MODULES / task / "module.yaml").read_text(encoding="utf-8"))
    return document


def can_do_realtime() -> bool:
    """Whether this node's kernel has realtime groups (CONFIG_RT_GROUP_SCHED, cgroup v1)."""
    return REALTIME.exists()


def can(configuration: Configuration) -> bool:
    """Whether this node is able to carry a configuration out."""
    return not (configuration.realtime and not can_do_realtime()) and not (
        configuration.autoscaled and not _autoscales()
    )


def _autoscales() -> bool:
    """Whether the VerticalPodAutoscaler is installed."""
    return bool(deploy.run("kubectl", "get", "crd", AUTOSCALERS, "--ignore-not-found", "-o", "name").strip())


def values(configuration: Configuration, document: Document, cores: int) -> Document:
    """The robot chart's values: queues that lose nothing, and each container's CPU. Pure but for module.yaml files."""
    return {
        "modules": {
            task: {
                "cpu": dict(cpu),
                "memory": {"request": "64Mi", "limit": ROOM},
                "env": {"PUBLISH_RUNS": "true", "ADAPT": "false", **_deep_queues(module_file(task))},
            }
            for task, cpu in configuration.resources(document, cores).items()
        }
    }


def _deep_queues(module: Mapping[str, Any]) -> dict[str, str]:
    return {f"INPUT_{name}".upper().replace("-", "_"): f"{{depth: {DEPTH}}}" for name in module["inputs"]}


def install(configuration: Configuration) -> None:
    """Install the operator with its router, with the node agent where the configuration wants it."""
    deploy.install_operator(*AGENT if configuration.agent else ())


def start_robot(configuration: Configuration, document: Document, folder: Path) -> None:
    """Restart the robot's modules, without any state; values are kept in `folder`."""
    stop_robot()
    own = folder / "values.yaml"
    own.write_text(yaml.safe_dump(values(configuration, document, cores())), encoding="utf-8")
    deploy.install_robot(deploy.VALUES, own, closed=configuration.agent)
    if configuration.autoscaled:
        path = folder / "autoscalers.yaml"
        path.write_text(yaml.safe_dump_all(autoscalers(document, cores())), encoding="utf-8")
        deploy.run("kubectl", "apply", "-f", str(path))


def decide(configuration: Configuration, document: Document, folder: Path) -> None:
    """Apply the configuration's policy, if there is one, and wait until its decisions are in force."""
    variant = configuration.variant(document)
    if variant is None:
        return
    path = folder / "policy.yaml"
    path.write_text(yaml.safe_dump(variant, sort_keys=False), encoding="utf-8")
    deploy.run("kubectl", "apply", "-f", str(path))
    name = variant["metadata"]["name"]
    deploy.run("kubectl", "wait", f"ctxp/{name}", "-n", deploy.ROBOT, "--for=condition=Ready", "--timeout=60s")


def stop_robot() -> None:
    """Remove the policy, or the autoscalers, then the modules."""
    deploy.run("kubectl", "delete", AUTOSCALERS, "--all", "-n", deploy.ROBOT, quiet=True)
    deploy.run("kubectl", "delete", "-f", str(POLICY), f"--timeout={deploy.TIMEOUT}", quiet=True)
    deploy.run(
        *("helm", "uninstall", "robot", "--namespace", deploy.ROBOT, "--ignore-not-found", "--wait"),
        *("--timeout", deploy.TIMEOUT),
    )
    deploy.run("kubectl", "wait", "pods", "--all", "-n", deploy.ROBOT, "--for=delete", "--timeout=60s", quiet=True)


def session(configuration: Configuration, role: str) -> AbstractContextManager[zenoh.Session]:
    """A session on the robot's bus that rather waits than loses; where the bus asks who speaks, in the given role."""
    return bus.session(role, closed=configuration.agent, keep=KEEP)


def cgroups() -> dict[str, Cgroup]:
    """The containers of the tasks, and of operator and router, by name; without a policy no plan names them."""
    found = {name: cgroup.find(identity) for name, identity in {**_control(), **deploy.containers()}.items()}
    return {name: own for name, own in found.items() if own is not None and name in (*deploy.TASKS, *CONTROL)}


def _control() -> dict[str, str]:
    pods = json.loads(deploy.run("kubectl", "get", "pods", "-n", deploy.SYSTEM, "-o", "json"))["items"]
    statuses = [status for pod in pods for status in pod.get("status", {}).get("containerStatuses", ())]
    return {status["name"]: status["containerID"] for status in statuses if "running" in status["state"]}
