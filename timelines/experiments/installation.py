"""One configuration on the node: operator and robot by helm, the policy by kubectl; fresh pods for every run."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING, Any

import yaml

from timelines.demo import bus, cgroup, deploy
from timelines.experiments import gate
from timelines.experiments.capacity import in_cpu_time
from timelines.experiments.tasks import SECOND, module

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping
    from contextlib import AbstractContextManager
    from pathlib import Path

    import zenoh

    from timelines.demo.cgroup import Cgroup
    from timelines.experiments.blocks import Trial
    from timelines.experiments.capacity import Capacity
    from timelines.experiments.configurations import Configuration
    from timelines.experiments.stories import Story

    Document = dict[str, Any]

DEPTH = 100_000
"""So long that a queue drops nothing: under the paper's terms what waits, waits."""
ROOM = "1536Mi"
"""Memory limit of a module with such a queue of pictures."""
CONTROL = ("operator", "router", "agent")
"""Containers of what decides and carries it out; the router is the bus, with and without."""
CONTEXT_POLICIES = "contextpolicies.contextpolicy.dev"
POLICY = "ctxp/whole-robot"


def policy_document(story: Story) -> Document:
    """The policy of a story, as it is written."""
    document: Document = yaml.safe_load(story.policy_file.read_text(encoding="utf-8"))
    return document


def cores() -> int:
    """Processors of this machine."""
    return os.cpu_count() or 1


def _defined(kind: str) -> bool:
    """Whether the cluster defines a kind of object."""
    return bool(deploy.run("kubectl", "get", "crd", kind, "--ignore-not-found", "-o", "name").strip())


def values(trial: Trial, document: Document, cores: int, weights: Mapping[str, int]) -> Document:
    """The robot chart's values. Pure but for module.yaml files."""
    environment = {"KEEP_RUNS": "true", "ADAPT": "true" if trial.configuration.adaptive else "false"}
    if trial.configuration.relayed:
        environment["PLAN_KEY"] = gate.KEY
    modules: Document = {}
    for task, cpu in trial.configuration.resources(document, cores, weights).items():
        own = SECOND.get(task, {})
        modules[task] = {**own, "cpu": cpu, "env": {**own.get("env", {}), **environment}}
        if trial.story.lossless:
            modules[task]["memory"] = {"request": "64Mi", "limit": ROOM}
            modules[task]["env"] |= _deep_queues(module(task).inputs)
    return {"modules": modules}


def _deep_queues(inputs: Iterable[str]) -> dict[str, str]:
    return {f"INPUT_{name}".upper().replace("-", "_"): f"{{depth: {DEPTH}}}" for name in inputs}


def install(configuration: Configuration) -> None:
    """Install the operator with its router, with the node agent where the configuration wants it.

    The bus is closed in any case: the agent needs it so, and encryption takes CPU that all have to pay alike.
    """
    settings = ["agent.enabled=true"] * configuration.agent
    if configuration.realtime:
        settings.append("agent.realtime=true")
    if configuration.settle is not None:
        settings.append(f"agent.settleSeconds={configuration.settle:g}")
    deploy.install_operator(*settings, closed=True)


def start_robot(trial: Trial, weights: Mapping[str, int], folder: Path) -> None:
    """Restart the robot's modules, without any state; values are kept in `folder`."""
    stop_robot()
    document, own = policy_document(trial.story), folder / "values.yaml"
    own.write_text(yaml.safe_dump(values(trial, document, cores(), weights)), encoding="utf-8")
    deploy.install_robot(deploy.VALUES, own, closed=True)


def decide(trial: Trial, capacity: Capacity, speed: float, folder: Path) -> None:
    """Apply the configuration's policy, if there is one, and wait until its decisions are in force.

    `speed` is what a processor does, in whole ones: limits are CPU time. Weights are not, and compare with requests.
    """
    fast = speed if trial.configuration.control == "Limit" else 1.0
    document = in_cpu_time(policy_document(trial.story), fast)
    variant = trial.configuration.variant(document, capacity.reserve(cores(), fast))
    if variant is None:
        return
    path = folder / "policy.yaml"
    path.write_text(yaml.safe_dump(variant, sort_keys=False), encoding="utf-8")
    deploy.run("kubectl", "apply", "-f", str(path))
    for condition in ("Ready", *["Realtime"] * trial.configuration.realtime):
        deploy.run("kubectl", "wait", POLICY, "-n", deploy.ROBOT, f"--for=condition={condition}", "--timeout=60s")


def stop_robot() -> None:
    """Remove the policy, then the modules; DeployError if one stays: the next run would have it."""
    if _defined(CONTEXT_POLICIES):
        deploy.run("kubectl", "delete", CONTEXT_POLICIES, "--all", "-n", deploy.ROBOT, f"--timeout={deploy.TIMEOUT}")
    deploy.run(
        *("helm", "uninstall", "robot", "--namespace", deploy.ROBOT, "--ignore-not-found", "--wait"),
        *("--timeout", deploy.TIMEOUT),
    )
    deploy.run("kubectl", "wait", "pods", "--all", "-n", deploy.ROBOT, "--for=delete", "--timeout=60s", quiet=True)


def session(role: str) -> AbstractContextManager[zenoh.Session]:
    """A session on the robot's bus, in the given role."""
    return bus.session(role, closed=True)


def cgroups(tasks: Collection[str]) -> dict[str, Cgroup]:
    """The containers of these tasks, and of operator and router, by name; without a policy no plan names them.

    DeployError where a task has none: it would be neither counted nor kept on its processors.
    """
    found = {name: cgroup.find(identity) for name, identity in {**_control(), **deploy.containers(tasks)}.items()}
    kept = {name: own for name, own in found.items() if own is not None and name in (*tasks, *CONTROL)}
    missing = [task for task in tasks if task not in kept]
    if missing:
        raise deploy.DeployError(f"no cgroup of a running container was found for {', '.join(missing)}")
    return kept


def _control() -> dict[str, str]:
    """Not of pods that are ending, as the agent's is where the next configuration has none."""
    pods = json.loads(deploy.run("kubectl", "get", "pods", "-n", deploy.SYSTEM, "-o", "json"))["items"]
    stay = [pod for pod in pods if "deletionTimestamp" not in pod["metadata"]]
    statuses = [status for pod in stay for status in pod.get("status", {}).get("containerStatuses", ())]
    return {status["name"]: status["containerID"] for status in statuses if "running" in status["state"]}
