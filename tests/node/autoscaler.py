"""A VerticalPodAutoscaler beside the node: its three programs, and the metrics-server that they read.

They are the released ones, built from source, with two settings for the impatient: they look every 10 s where they
would look every minute, and change pods of which there is only one. `InPlace`, an alpha mode that never evicts, is on.
"""

from __future__ import annotations

import json
import logging
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tests.node import access, build, certificates, metrics_api, processes
from tests.node.certificates import AUTHORITY, Identity, certificate, private_key
from tests.node.components import Component, answers, as_flags
from tests.node.errors import ClusterError
from tests.node.layout import KUBECONFIG, NODE_ADDRESS, PKI, ROOT, SOURCES
from tests.node.shell import run

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

INTERVAL = 10
"""Seconds; the metrics-server takes no less."""
METRICS_PORT, WEBHOOK_PORT = 4443, 8010
WEBHOOK = Identity("vpa-webhook", "vpa-webhook", alternative_names=(f"IP:{NODE_ADDRESS}",))
ANONYMOUS = "vpa-anonymous-reads-metrics"
DEFINITIONS = "deploy/vpa-v1-crd-gen.yaml"
"""In the autoscaler's module."""


@contextmanager
def running(interval: int = INTERVAL) -> Iterator[None]:
    """While this holds there is a VerticalPodAutoscaler."""
    start(interval)
    try:
        yield
    finally:
        stop()


def start(interval: int = INTERVAL) -> None:
    """Build what is missing, and start it; a VerticalPodAutoscaler object is then seen within `interval` seconds."""
    if access.user_cluster():
        raise ClusterError("a VerticalPodAutoscaler is started beside our own node only: install it on yours")
    programs, metrics = (build.build(program) for program in build.AUTOSCALER)
    if not (PKI / f"{WEBHOOK.name}.crt").exists():
        run(certificates.issue(WEBHOOK))
    access.run(["kubectl", "apply", "--server-side", "--force-conflicts", "-f", _definitions()])
    access.run(["kubectl", "apply", "-f", "-"], stdin=json.dumps(_anonymous_reads_metrics()))
    for one in (metrics_server(metrics, interval), *parts(programs, interval)):
        log.info("starting %s", one.name)
        if processes.alive(one.name) is None:
            processes.start(one.name, one.argv)
        processes.await_ready(one.name, one.probe, patience=one.patience)
        if one.name == "metrics-server":
            metrics_api.register(METRICS_PORT)


def stop() -> None:
    """End it; its definitions go too, and with them all VerticalPodAutoscalers."""
    for name in ("admission-controller", "updater", "recommender", "metrics-server"):
        processes.stop(name)
    metrics_api.withdraw()
    access.run(["kubectl", "delete", "mutatingwebhookconfiguration", "vpa-webhook-config", "--ignore-not-found"])
    access.run(["kubectl", "delete", "clusterrole,clusterrolebinding", ANONYMOUS, "--ignore-not-found"])
    access.run(["kubectl", "delete", "--ignore-not-found", "-f", _definitions()])


def metrics_server(programs: Path, interval: int) -> Component:
    """It reads the kubelet, and answers the API server."""
    settings = as_flags(
        kubeconfig=KUBECONFIG,
        authentication_kubeconfig=KUBECONFIG,
        authorization_kubeconfig=KUBECONFIG,
        cert_dir=ROOT / "metrics-server",
        kubelet_insecure_tls="true",
        kubelet_preferred_address_types="InternalIP",
        kubelet_request_timeout="5s",
        kubelet_use_node_status_port="true",
        metric_resolution=f"{max(10, interval)}s",
        secure_port=METRICS_PORT,
    )
    # It is ready only when it has measured a pod twice, and there may be none yet.
    probe = answers(f"https://127.0.0.1:{METRICS_PORT}/livez")
    return Component("metrics-server", (str(programs / "metrics-server"), *settings), probe, patience=90)


def parts(programs: Path, interval: int) -> tuple[Component, ...]:
    """What recommends, what changes running pods, and what changes new ones."""
    settings = {
        "recommender": as_flags(recommender_interval=f"{interval}s"),
        "updater": as_flags(updater_interval=f"{interval}s", min_replicas=1, feature_gates="InPlace=true"),
        "admission-controller": as_flags(
            client_ca_file=certificate(AUTHORITY),
            tls_cert_file=certificate(WEBHOOK.name),
            tls_private_key=private_key(WEBHOOK.name),
            port=WEBHOOK_PORT,
            register_by_url="true",
            webhook_address=f"https://{NODE_ADDRESS}",
            webhook_port=WEBHOOK_PORT,
            webhook_timeout_seconds=5,
            feature_gates="InPlace=true",
        ),
    }
    return tuple(
        Component(
            name,
            (str(programs / name), *as_flags(kubeconfig=KUBECONFIG, address=f"127.0.0.1:{port}"), *own),
            answers(f"http://127.0.0.1:{port}/health-check"),
        )
        for port, (name, own) in enumerate(settings.items(), start=8942)
    )


def _definitions() -> str:
    """The file with its definitions, as it came with the source."""
    module = ["go", "-C", str(SOURCES / "vpa"), "list", "-m", "-f", "{{.Dir}}", build.VPA_MODULE]
    return f"{run(module).strip()}/{DEFINITIONS}"


def _anonymous_reads_metrics() -> dict[str, object]:
    """Our API server has no certificate by which a metrics-server could know it, so its questions are nobody's."""
    rules = [
        {"apiGroups": [metrics_api.GROUP], "resources": ["pods", "nodes"], "verbs": ["get", "list", "watch"]},
        {"nonResourceURLs": ["/apis", "/apis/*", "/openapi/*"], "verbs": ["get"]},
    ]
    api, metadata = "rbac.authorization.k8s.io", {"name": ANONYMOUS}
    role = {"apiVersion": f"{api}/v1", "kind": "ClusterRole", "metadata": metadata, "rules": rules}
    binding = {
        "apiVersion": f"{api}/v1",
        "kind": "ClusterRoleBinding",
        "metadata": metadata,
        "roleRef": {"apiGroup": api, "kind": "ClusterRole", "name": ANONYMOUS},
        "subjects": [{"apiGroup": api, "kind": "User", "name": "system:anonymous"}],
    }
    return {"apiVersion": "v1", "kind": "List", "items": [role, binding]}
