"""A robot with two tasks and an operator of its own, for what switches the node off and on, outside of its network."""

from __future__ import annotations

import json
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from tests.e2e.cluster import helm_command, until
from tests.e2e.robot import IDLE, pod, policy, task
from tests.node import access, lifecycle

if TYPE_CHECKING:
    from collections.abc import Iterator

ROBOT, SYSTEM = "e2e-reboot", "e2e-reboot-system"
ORIGINAL = {"slam": ("500m", "500m"), "speech": ("500m", "500m")}
PLANNED = {"slam": ("750m", "750m"), "speech": ("250m", "250m")}
VALUES = {
    "image.repository": "contextpolicy",
    "image.tag": "dev",
    "fullnameOverride": "reboot",
    "watchNamespaces": f"{{{ROBOT}}}",
    "router.service.clusterIP": "10.96.7.51",
    "security.enabled": "false",
}


@contextmanager
def governed(**values: str) -> Iterator[None]:
    """The node is up and the robot's policy in force; all of it is removed at the end. `values` are the chart's."""
    lifecycle.up()
    apply(*({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name}} for name in (ROBOT, SYSTEM)))
    access.run(helm_command("reboot", SYSTEM, {**VALUES, **values}), timeout=150)
    try:
        apply(*(pod(name, ROBOT, IDLE, None) for name in ("slam", "speech")))
        apply(policy(ROBOT, tasks=[task("slam", priority=3), task("speech")]))
        until("the policy holds", lambda: limits() == PLANNED or limits(), patience=120)
        yield
    finally:
        kubectl("delete", "ctxp", "--all", "-n", ROBOT, "--timeout=60s")
        access.run(["helm", "uninstall", "reboot", "--namespace", SYSTEM, "--wait", "--timeout", "60s"], timeout=90)
        kubectl("delete", "namespace", ROBOT, SYSTEM, "--timeout=90s")


def kubectl(*argv: str) -> str:
    """Its answer."""
    return access.run(["kubectl", *argv], timeout=120)


def apply(*objects: dict[str, Any]) -> None:
    """`kubectl apply` of objects."""
    content = json.dumps({"apiVersion": "v1", "kind": "List", "items": list(objects)})
    access.run(["kubectl", "apply", "-f", "-"], timeout=120, stdin=content)


def limits() -> dict[str, tuple[str, str | None]]:
    """What the API has and what the kubelet reports as in force, by pod."""
    items = json.loads(kubectl("get", "pods", "-n", ROBOT, "-o", "json"))["items"]
    return {
        item["metadata"]["name"]: (
            item["spec"]["containers"][0]["resources"]["limits"]["cpu"],
            status.get("resources", {}).get("limits", {}).get("cpu") if "running" in status["state"] else None,
        )
        for item in items
        for status in item["status"].get("containerStatuses", [])
    }
