"""The chart as the machine installs it: rendered here, for helm is slow to start there."""

from __future__ import annotations

import json

import yaml

from tests.node.layout import REPOSITORY, ROOT
from tests.node.shell import run

NAMESPACE, RELEASE = "contextpolicy-system", "contextpolicy"
ROBOT = "robot"
ROUTER = "10.96.7.49"
VALUES = {
    "fullnameOverride": RELEASE,
    "image.repository": "contextpolicy",
    "image.tag": "dev",
    "router.service.clusterIP": ROUTER,
    "watchNamespaces": f"{{{ROBOT}}}",
    "agent.enabled": "true",
    "agent.settleSeconds": "2",
    "agent.realtime": "true",
    "agent.podLogs": str(ROOT / "pods"),
}


def rendered(helm: str) -> str:
    """Return all objects of the chart as a JSON list, the namespaces first."""
    settings = [part for name, value in VALUES.items() for part in ("--set", f"{name}={value}")]
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    text = run([helm, "template", RELEASE, chart, "--namespace", NAMESPACE, "--no-hooks", *settings])
    spaces = [{"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": name}} for name in (NAMESPACE, ROBOT)]
    return json.dumps([*spaces, *filter(None, yaml.safe_load_all(text))])
