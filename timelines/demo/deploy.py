"""Bring the demo up and take it down with helm and kubectl, as a user would."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from collections.abc import Iterator

REPOSITORY = Path(__file__).resolve().parents[2]
SYSTEM, ROBOT = "contextpolicy-system", "robot"
POLICY = REPOSITORY / "config" / "policies" / "whole-robot.yaml"
MODULES = REPOSITORY / "charts" / "robot"
TASKS = tuple(task["name"] for task in yaml.safe_load(POLICY.read_text(encoding="utf-8"))["spec"]["tasks"])
VALUES = Path(__file__).with_name("values.yaml")
TIMEOUT = "180s"


class DeployError(Exception):
    """A deployment step failed; the message has the command and its output."""


def up() -> Iterator[str]:
    """Install the operator and the robot's modules; yields each step before it runs."""
    yield "helm upgrade --install contextpolicy charts/contextpolicy"
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    values = ["--set", "image.repository=contextpolicy", "--set", "image.tag=dev"]
    values += ["--set", f"router.service.clusterIP={free_address()}"]
    _run(
        *("helm", "upgrade", "--install", "contextpolicy", chart, "--namespace", SYSTEM, "--create-namespace"),
        *(*values, "--take-ownership", "--force-conflicts", "--wait", "--timeout", TIMEOUT),
    )
    _run("kubectl", "delete", "-f", str(POLICY), "--ignore-not-found", f"--timeout={TIMEOUT}")
    yield "helm upgrade --install robot charts/robot"
    _run(
        *("helm", "upgrade", "--install", "robot", str(MODULES), "--namespace", ROBOT, "--create-namespace"),
        *("--values", str(VALUES), "--set", "image.tag=dev", "--set", f"zenoh.connect={router()}"),
        *("--take-ownership", "--force-conflicts", "--wait", "--timeout", TIMEOUT),
    )


def down() -> Iterator[str]:
    """Remove the robot's namespace, then the operator; yields each step before it runs."""
    yield "helm uninstall robot"
    _run("helm", "uninstall", "robot", "--namespace", ROBOT, "--ignore-not-found", "--wait", "--timeout", TIMEOUT)
    _run("kubectl", "delete", "namespace", ROBOT, "--ignore-not-found", f"--timeout={TIMEOUT}")
    yield "helm uninstall contextpolicy"
    _run("helm", "uninstall", "contextpolicy", "--namespace", SYSTEM, "--wait", "--timeout", TIMEOUT)


def apply_policy() -> None:
    """Apply the policy: from now on the operator decides."""
    _run("kubectl", "apply", "-f", str(POLICY))


def delete_policy() -> None:
    """Delete the policy; returns when the operator has put every container back."""
    _run("kubectl", "delete", "-f", str(POLICY), f"--timeout={TIMEOUT}")


def router() -> str:
    """The Zenoh endpoint of the chart's router, by its cluster address: a node need not have DNS."""
    service = json.loads(_run("kubectl", "get", "service", "contextpolicy-router", "-n", SYSTEM, "-o", "json"))
    return f"tcp/{service['spec']['clusterIP']}:{service['spec']['ports'][0]['port']}"


def containers() -> dict[str, str]:
    """The id of each task's running container."""
    return dict(_running(_pods()))


def limits() -> dict[str, str]:
    """The CPU limit of each task in the API."""
    return {
        container["name"]: container["resources"]["limits"]["cpu"]
        for pod in _pods()
        for container in pod["spec"]["containers"]
    }


def free_address(last: int = 47) -> str:
    """An address for the router among the cluster's service addresses: a node need not have DNS."""
    kubernetes = json.loads(_run("kubectl", "get", "service", "kubernetes", "-n", "default", "-o", "json"))
    network, _, _ = str(kubernetes["spec"]["clusterIP"]).rpartition(".0.")
    return f"{network}.7.{last}"


def _pods() -> list[dict[str, Any]]:
    selector = f"app in ({','.join(TASKS)})"
    found: list[dict[str, Any]] = json.loads(_run("kubectl", "get", "pods", "-n", ROBOT, "-l", selector, "-o", "json"))[
        "items"
    ]
    return found


def _running(pods: list[dict[str, Any]]) -> Iterator[tuple[str, str]]:
    for pod in pods:
        for status in pod.get("status", {}).get("containerStatuses", []):
            if "running" in status.get("state", {}):
                yield status["name"], status["containerID"]


def _run(*argv: str) -> str:
    try:
        done = subprocess.run(argv, capture_output=True, text=True, timeout=300, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DeployError(f"{' '.join(argv)}: {error}") from error
    if done.returncode != 0:
        raise DeployError(f"{' '.join(argv)}\n{done.stderr.strip() or done.stdout.strip()}")
    return done.stdout
