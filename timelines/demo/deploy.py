"""Bring the demo up and take it down with helm and kubectl, as a user would."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from contextpolicy.policy.quantities import parse_cpu

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

REPOSITORY = Path(__file__).resolve().parents[2]
SYSTEM, ROBOT = "contextpolicy-system", "robot"
POLICY = REPOSITORY / "config" / "policies" / "whole-robot.yaml"
MODULES = REPOSITORY / "charts" / "robot"
_SPECS = yaml.safe_load(POLICY.read_text(encoding="utf-8"))["spec"]["tasks"]
TASKS = tuple(task["name"] for task in _SPECS)
PROTECTED = frozenset(task["name"] for task in _SPECS if task.get("protected"))
VALUES = Path(__file__).with_name("values.yaml")
TIMEOUT = "180s"
SETTLE = 2.0
"""Seconds after which the API follows the agent: the chart's default is longer than the demo's plans last."""
AGENT = ("agent.enabled=true", f"agent.settleSeconds={SETTLE:g}")
SET_AGENT = f" --set {','.join(AGENT)},security.namespaces={{{ROBOT}}}"
SET_OPEN = " --set security.enabled=false"
POD_LOGS = "/var/log/pods"
"""Where a kubelet keeps the logs of pods, if it does not say."""


class DeployError(Exception):
    """A deployment step failed; the message has the command and its output."""


def up(*, agent: bool) -> Iterator[str]:
    """Install the operator and the robot's modules; yields each step before it runs."""
    yield "helm upgrade --install contextpolicy charts/contextpolicy" + (SET_AGENT if agent else SET_OPEN)
    install_operator(*AGENT * agent)
    run("kubectl", "delete", "-f", str(POLICY), "--ignore-not-found", f"--timeout={TIMEOUT}")
    yield "helm upgrade --install robot charts/robot"
    install_robot(VALUES, closed=agent)


def install_operator(*settings: str, closed: bool = False) -> None:
    """Install the operator with its router; the bus is open unless `closed`, or with the node agent."""
    agent = "agent.enabled=true" in settings
    if agent or closed:
        run("kubectl", "create", "namespace", ROBOT, quiet=True)
        settings += (f"security.namespaces={{{ROBOT}}}",)
    else:
        settings += ("security.enabled=false",)
    if agent:
        settings += (f"agent.podLogs={_pod_logs()}",)
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    usual = ("image.repository=contextpolicy", "image.tag=dev", f"router.service.clusterIP={free_address()}")
    run(
        *("helm", "upgrade", "--install", "contextpolicy", chart, "--namespace", SYSTEM, "--create-namespace"),
        *(part for setting in (*usual, *settings) for part in ("--set", setting)),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", TIMEOUT),
    )


def install_robot(*values: Path, closed: bool) -> None:
    """Install the modules; on a bus that is closed, with the certificate of their role."""
    settings = ["image.tag=dev", f"zenoh.connect={router(closed=closed)}"]
    settings += ["zenoh.secret="] * (not closed)
    run(
        *("helm", "upgrade", "--install", "robot", str(MODULES), "--namespace", ROBOT, "--create-namespace"),
        *(part for path in values for part in ("--values", str(path))),
        *(part for setting in settings for part in ("--set", setting)),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", TIMEOUT),
    )


def _pod_logs() -> str:
    """Where this node's kubelet keeps them: the agent sees by their names which pods are whose."""
    [node] = json.loads(run("kubectl", "get", "nodes", "-o", "json"))["items"]
    path = f"/api/v1/nodes/{node['metadata']['name']}/proxy/configz"
    own = json.loads(run("kubectl", "get", "--raw", path))["kubeletconfig"]
    return str(own.get("podLogsDir", POD_LOGS))


def down() -> Iterator[str]:
    """Remove the robot's namespace, then the operator; yields each step before it runs."""
    yield "helm uninstall robot"
    run("helm", "uninstall", "robot", "--namespace", ROBOT, "--ignore-not-found", "--wait", "--timeout", TIMEOUT)
    run("kubectl", "delete", "namespace", ROBOT, "--ignore-not-found", f"--timeout={TIMEOUT}")
    yield "helm uninstall contextpolicy"
    run("helm", "uninstall", "contextpolicy", "--namespace", SYSTEM, "--wait", "--timeout", TIMEOUT)


def apply_policy() -> None:
    """Apply the policy: from now on the operator decides."""
    run("kubectl", "apply", "-f", str(POLICY))


def delete_policy() -> None:
    """Delete the policy; returns when the operator has put every container back."""
    run("kubectl", "delete", "-f", str(POLICY), f"--timeout={TIMEOUT}")


def router(*, closed: bool) -> str:
    """The Zenoh endpoint of the chart's router, by its cluster address: a node need not have DNS."""
    service = json.loads(run("kubectl", "get", "service", "contextpolicy-router", "-n", SYSTEM, "-o", "json"))
    return f"{'tls' if closed else 'tcp'}/{service['spec']['clusterIP']}:{service['spec']['ports'][0]['port']}"


def containers(tasks: Iterable[str] = TASKS) -> dict[str, str]:
    """The id of each task's running container."""
    return dict(_running(_pods(tasks)))


def limits() -> dict[str, str]:
    """The CPU limit of each task in the API."""
    return {
        container["name"]: container["resources"]["limits"]["cpu"]
        for pod in _pods()
        for container in pod["spec"]["containers"]
    }


def requests_beside() -> dict[str, int]:
    """What the other containers of each task's pod request, in thousandths of a core."""
    return {one["name"]: _requested(pod, but=one["name"]) for pod in _pods() for one in pod["spec"]["containers"]}


def _requested(pod: dict[str, Any], but: str) -> int:
    sidecars = [one for one in pod["spec"].get("initContainers", ()) if one.get("restartPolicy") == "Always"]
    others = [one for one in (*pod["spec"]["containers"], *sidecars) if one["name"] != but]
    return sum(parse_cpu(one["resources"].get("requests", {}).get("cpu", 0)) for one in others)


def request_factor() -> float:
    """What turns weights into requests where no agent writes them, from the policy's status; else 1."""
    status = json.loads(run("kubectl", "get", "-f", str(POLICY), "-o", "json")).get("status", {})
    return float(next((node["requestFactor"] for node in status.get("nodes", ()) if "requestFactor" in node), 1))


def free_address(last: int = 47) -> str:
    """An address for the router among the cluster's service addresses: a node need not have DNS."""
    kubernetes = json.loads(run("kubectl", "get", "service", "kubernetes", "-n", "default", "-o", "json"))
    network, _, _ = str(kubernetes["spec"]["clusterIP"]).rpartition(".0.")
    return f"{network}.7.{last}"


def _pods(tasks: Iterable[str] = TASKS) -> list[dict[str, Any]]:
    selector = f"app in ({','.join(tasks)})"
    found: list[dict[str, Any]] = json.loads(run("kubectl", "get", "pods", "-n", ROBOT, "-l", selector, "-o", "json"))[
        "items"
    ]
    return found


def _running(pods: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    for pod in pods:
        for status in pod.get("status", {}).get("containerStatuses", []):
            if "running" in status.get("state", {}):
                yield status["name"], status["containerID"]


def run(*argv: str, quiet: bool = False) -> str:
    """Run a command and return what it prints; DeployError if it fails, unless it may (`quiet`)."""
    try:
        done = subprocess.run(argv, capture_output=True, text=True, timeout=300, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeployError(f"{' '.join(argv)}: {error}") from error
    if done.returncode != 0 and not quiet:
        raise DeployError(f"{' '.join(argv)}\n{done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
