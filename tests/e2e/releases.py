"""Further releases of the chart, beside the one under test: for what happens to a release itself."""

from __future__ import annotations

import json
import subprocess
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.bus.session import open_visitor
from tests.e2e.cluster import CHART, apply, helm_command, run
from tests.e2e.robot import Robot, Sensors
from timelines.demo.deploy import free_address

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

KINDS = (
    "jobs,pods,serviceaccounts,roles,rolebindings,clusterroles,clusterrolebindings,deployments,services,networkpolicies"
)


@dataclass(frozen=True)
class Release:
    """A release that serves one namespace; `address` is the last part of its router's address."""

    name: str
    address: int

    @property
    def system(self) -> str:
        """The namespace of the operator."""
        return f"e2e-{self.name}-system"

    @property
    def namespace(self) -> str:
        """The namespace of the robot."""
        return f"e2e-{self.name}"

    def install(self, chart: Path = CHART, **values: str) -> None:
        """Install or upgrade; the definition comes from elsewhere by default, so that no other release loses it."""
        apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": self.namespace}})
        run(*self.upgrade_command(chart, **values), timeout=150)

    def upgrade_command(self, chart: Path, **values: str) -> list[str]:
        """How helm is called."""
        settings = {
            "fullnameOverride": self.name,
            "image.tag": "dev",
            "crds.enabled": "false",
            "router.service.clusterIP": free_address(self.address),
            "watchNamespaces": "{" + self.namespace + "}",
            "security.enabled": "false",
            **values,
        }
        return helm_command(self.name, self.system, settings, chart)

    def uninstall(self, timeout: int = 60) -> None:
        """Uninstall; Helm does not wait for the operator's end."""
        run("helm", "uninstall", self.name, "--namespace", self.system, "--timeout", f"{timeout}s")

    def objects(self) -> list[str]:
        """What is there of the release."""
        found = run("kubectl", "get", KINDS, "-A", "-o", "json", "-l", f"app.kubernetes.io/instance={self.name}")
        return [f"{item['kind']} {item['metadata']['name']}" for item in json.loads(found)["items"]]

    def leader(self) -> str:
        """The pod that holds the release's Lease; empty without a Lease."""
        query = ("kubectl", "get", "lease", self.name, "-n", self.system, "--ignore-not-found")
        return run(*query, "-o", "jsonpath={.spec.holderIdentity}").partition("_")[0]

    def rights(self) -> list[str]:
        """Which of its objects give rights, or are somebody who has them."""
        return [one for one in self.objects() if one.startswith(("Role", "ClusterRole", "ServiceAccount"))]

    @contextmanager
    def sensors(self) -> Iterator[Robot]:
        """A robot whose sensors can be read; it has neither pods nor a policy yet."""
        endpoint = f"tcp/{free_address(self.address)}:7447"
        with open_visitor([endpoint], patience=20) as session, Sensors(session) as sensors:
            yield Robot(self.namespace, sensors)

    @contextmanager
    def robot(self) -> Iterator[Robot]:
        """A moving robot whose limits a policy has moved."""
        with self.sensors() as robot:
            robot.drive(0.3)
            robot.start("slam", "speech")
            robot.policy()
            robot.expect(slam=990, speech=10)
            yield robot

    def remove(self) -> None:
        """Take everything away; policies first: one that a failed test left may be held, with nobody to let go."""
        subprocess.run(
            ["helm", "uninstall", self.name, "--namespace", self.system, "--no-hooks", "--ignore-not-found"],
            check=False,
            timeout=60,
        )
        run("kubectl", "delete", "ctxp", "--all", "-n", self.namespace, "--wait=false")
        for name in run("kubectl", "get", "ctxp", "-n", self.namespace, "-o", "name").split():
            patch = '{"metadata":{"finalizers":null}}'
            run("kubectl", "patch", name, "-n", self.namespace, "--type=merge", "-p", patch)
        roles = "clusterroles,clusterrolebindings"
        run("kubectl", "delete", roles, "-l", f"app.kubernetes.io/instance={self.name}")
        run("kubectl", "delete", "namespace", self.system, self.namespace, "--ignore-not-found", "--timeout=90s")
