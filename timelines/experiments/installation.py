"""One configuration on the node: operator and robot by helm, the policy by kubectl; fresh pods for every run."""

from __future__ import annotations

import base64
import json
import os
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from contextpolicy.bus.session import open_visitor
from timelines.demo import cgroup, deploy
from timelines.experiments.configurations import at_pace, autoscalers

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

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
SECURE = ("agent.enabled=true", "agent.realtime=true", f"security.namespaces={{{deploy.ROBOT}}}")
POD_LOGS = "/var/log/pods"
"""Where a kubelet keeps the logs of pods, if it does not say."""
AUTOSCALERS = "verticalpodautoscalers.autoscaling.k8s.io"


def policy_document(pace: float = 1.0, path: Path = deploy.POLICY) -> Document:
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
                "env": {"PUBLISH_RUNS": "true", **_deep_queues(module_file(task))},
            }
            for task, cpu in configuration.resources(document, cores).items()
        }
    }


def _deep_queues(module: Mapping[str, Any]) -> dict[str, str]:
    return {f"INPUT_{name}".upper().replace("-", "_"): f"{{depth: {DEPTH}}}" for name in module["inputs"]}


def install(configuration: Configuration) -> None:
    """Install the operator with its router, with the node agent where the configuration wants it."""
    if configuration.agent:
        deploy.run("kubectl", "create", "namespace", deploy.ROBOT, quiet=True)
    chart = str(deploy.REPOSITORY / "charts" / "contextpolicy")
    settings = ["image.repository=contextpolicy", "image.tag=dev", f"router.service.clusterIP={deploy.free_address()}"]
    settings += (*SECURE, f"agent.podLogs={_pod_logs()}") if configuration.agent else ()
    deploy.run(
        *("helm", "upgrade", "--install", "contextpolicy", chart, "--namespace", deploy.SYSTEM, "--create-namespace"),
        *(part for setting in settings for part in ("--set", setting)),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", deploy.TIMEOUT),
    )


def _pod_logs() -> str:
    """Where this node's kubelet keeps them: the agent tells by their names which pods are whose."""
    [node] = json.loads(deploy.run("kubectl", "get", "nodes", "-o", "json"))["items"]
    path = f"/api/v1/nodes/{node['metadata']['name']}/proxy/configz"
    told = json.loads(deploy.run("kubectl", "get", "--raw", path))["kubeletconfig"]
    return str(told.get("podLogsDir", POD_LOGS))


def start_robot(configuration: Configuration, document: Document, folder: Path) -> None:
    """Start the robot's modules anew, none of them knows what was; values are kept in `folder`."""
    stop_robot()
    own = folder / "values.yaml"
    own.write_text(yaml.safe_dump(values(configuration, document, cores())), encoding="utf-8")
    settings = ["image.tag=dev", f"zenoh.connect={endpoint(configuration)}"]
    settings += ["zenoh.secret=contextpolicy-bus-module"] if configuration.agent else []
    deploy.run(
        *("helm", "upgrade", "--install", "robot", str(deploy.MODULES), "--namespace", deploy.ROBOT),
        *("--create-namespace", "--values", str(deploy.VALUES), "--values", str(own)),
        *(part for setting in settings for part in ("--set", setting)),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", deploy.TIMEOUT),
    )
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
    deploy.run("kubectl", "delete", "-f", str(deploy.POLICY), f"--timeout={deploy.TIMEOUT}", quiet=True)
    deploy.run(
        *("helm", "uninstall", "robot", "--namespace", deploy.ROBOT, "--ignore-not-found", "--wait"),
        *("--timeout", deploy.TIMEOUT),
    )
    deploy.run("kubectl", "wait", "pods", "--all", "-n", deploy.ROBOT, "--for=delete", "--timeout=60s", quiet=True)


def endpoint(configuration: Configuration) -> str:
    """Where the router listens."""
    plain = deploy.router()
    return plain.replace("tcp/", "tls/", 1) if configuration.agent else plain


@contextmanager
def session(configuration: Configuration, role: str) -> Iterator[zenoh.Session]:
    """A session on the robot's bus that rather waits than loses; where the bus asks who speaks, in the given role."""
    with tempfile.TemporaryDirectory() as folder:
        credentials = _credentials(role, Path(folder)) if configuration.agent else None
        with open_visitor([endpoint(configuration)], patience=20, credentials=credentials, keep=KEEP) as opened:
            yield opened


def _credentials(role: str, folder: Path) -> Path:
    name = f"contextpolicy-bus-{role}"
    secret = json.loads(deploy.run("kubectl", "get", "secret", name, "-n", deploy.SYSTEM, "-o", "json"))
    for file, content in secret["data"].items():
        (folder / file).write_bytes(base64.b64decode(content))
    return folder


def cgroups() -> dict[str, Cgroup]:
    """The containers of the tasks, and of operator and router, by name; without a policy no plan names them."""
    found = {name: cgroup.find(identity) for name, identity in {**_control(), **deploy.containers()}.items()}
    return {name: own for name, own in found.items() if own is not None and name in (*deploy.TASKS, *CONTROL)}


def _control() -> dict[str, str]:
    pods = json.loads(deploy.run("kubectl", "get", "pods", "-n", deploy.SYSTEM, "-o", "json"))["items"]
    statuses = [status for pod in pods for status in pod.get("status", {}).get("containerStatuses", ())]
    return {status["name"]: status["containerID"] for status in statuses if "running" in status["state"]}
