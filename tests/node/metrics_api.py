"""Who serves the resource metrics API (metrics.k8s.io) of the node's cluster: something at the node's own address."""

from __future__ import annotations

import json
from typing import Any

from tests.node import access
from tests.node.errors import ClusterError
from tests.node.layout import NODE_ADDRESS
from tests.node.shell import wait_until

GROUP = "metrics.k8s.io"
ROOT = f"/apis/{GROUP}/v1beta1"
NAME = "resource-metrics"
NAMESPACE = "kube-system"
PATIENCE = 60.0


def register(port: int) -> None:
    """Have the API server ask the node's port for metrics; returns when it gets answers."""
    content = json.dumps({"apiVersion": "v1", "kind": "List", "items": objects(port)})
    access.run(["kubectl", "apply", "-f", "-"], stdin=content)
    if not wait_until(_served, timeout=PATIENCE):
        raise ClusterError(f"{ROOT} is not served after {PATIENCE:.0f} s")


def withdraw() -> None:
    """There are no resource metrics any more."""
    access.run(["kubectl", "delete", "apiservice", f"v1beta1.{GROUP}", "--ignore-not-found"])
    found = f"service/{NAME}", f"endpointslice/{NAME}"
    access.run(["kubectl", "delete", *found, "-n", NAMESPACE, "--ignore-not-found"])


def objects(port: int) -> list[dict[str, Any]]:
    """A Service without pods, and the API that it stands for."""
    metadata = {"name": NAME, "namespace": NAMESPACE}
    named = {"name": "https", "port": port, "protocol": "TCP"}
    spec = {
        "group": GROUP,
        "version": "v1beta1",
        "groupPriorityMinimum": 100,
        "versionPriority": 100,
        "insecureSkipTLSVerify": True,
        "service": {"name": NAME, "namespace": NAMESPACE, "port": 443},
    }
    return [
        {
            "apiVersion": "v1",
            "kind": "Service",
            "metadata": metadata,
            "spec": {"ports": [{**named, "port": 443, "targetPort": port}]},
        },
        {
            "apiVersion": "discovery.k8s.io/v1",
            "kind": "EndpointSlice",
            "metadata": {**metadata, "labels": {"kubernetes.io/service-name": NAME}},
            "addressType": "IPv4",
            "ports": [named],
            "endpoints": [{"addresses": [NODE_ADDRESS], "conditions": {"ready": True}}],
        },
        {
            "apiVersion": "apiregistration.k8s.io/v1",
            "kind": "APIService",
            "metadata": {"name": f"v1beta1.{GROUP}"},
            "spec": spec,
        },
    ]


def _served() -> bool:
    try:
        access.run(["kubectl", "get", "--raw", ROOT])
    except ClusterError:
        return False
    return True
