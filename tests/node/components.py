"""Each component's command line and its readiness check: pure, nothing is started."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass

from tests.node import configuration
from tests.node.certificates import AUTHORITY, TOKENS, certificate, private_key
from tests.node.errors import ClusterError
from tests.node.layout import (
    API_URL,
    AUDIT_LOG,
    BIN,
    CONFIG,
    CONTAINERD_SOCKET,
    DATASTORE_VARIABLE,
    KINE_SOCKET,
    NODE_ADDRESS,
    NODE_NAME,
    POD_CIDR,
    ROOT,
    SERVICE_CIDR,
    SOURCES,
)

NODE_BINARY = str(BIN / "node")


@dataclass(frozen=True)
class Component:
    """A process of the node; `probe` is a command that succeeds once the component serves."""

    name: str
    argv: tuple[str, ...]
    probe: tuple[str, ...]
    patience: float = 60


def kubeconfig_path(name: str) -> str:
    return str(CONFIG / f"{name}.kubeconfig")


def as_flags(**values: object) -> list[str]:
    """A program's arguments: names with `_` for `-`."""
    return [f"--{name.replace('_', '-')}={value}" for name, value in values.items()]


def answers(url: str) -> tuple[str, ...]:
    """The probe that asks an address."""
    return (sys.executable, str(SOURCES / "probe.py"), url)


def etcd() -> Component:
    client, peer = "http://127.0.0.1:2379", "http://127.0.0.1:2380"
    flags = as_flags(
        name="node",
        data_dir=ROOT / "etcd",
        listen_client_urls=client,
        advertise_client_urls=client,
        listen_peer_urls=peer,
        initial_advertise_peer_urls=peer,
        initial_cluster=f"node={peer}",
    )
    return Component("etcd", (NODE_BINARY, "etcd", *flags), answers(f"{client}/health"))


def kine() -> Component:
    """SQLite behind etcd's API, with the parameters that k3s leaves at kine's default."""
    parameters = "_journal_mode=WAL&_busy_timeout=30000&_synchronous=NORMAL&_txlock=immediate&_stmt_cache_size=20"
    metrics = "127.0.0.1:2381"
    flags = as_flags(
        endpoint=f"sqlite://{ROOT}/kine/state.db?{parameters}&cache=shared",
        listen_address=f"unix://{KINE_SOCKET}",
        metrics_bind_address=metrics,
    )
    return Component("kine", (str(BIN / "kine"), *flags), answers(f"http://{metrics}/metrics"))


DATASTORES = {"kine": (kine, f"unix://{KINE_SOCKET}"), "etcd": (etcd, "http://127.0.0.1:2379")}
"""What serves the API server's objects, and where."""


def datastore() -> str:
    """The datastore that the environment chose: kine, as on a single-node k3s, if it says nothing."""
    chosen = os.environ.get(DATASTORE_VARIABLE) or "kine"
    if chosen not in DATASTORES:
        raise ClusterError(f"{DATASTORE_VARIABLE}={chosen}: it is one of {', '.join(DATASTORES)}")
    return chosen


def apiserver() -> Component:
    flags = as_flags(
        advertise_address=NODE_ADDRESS,
        allow_privileged="true",
        audit_log_maxbackup=1,
        audit_log_maxsize=50,  # megabytes
        audit_log_path=AUDIT_LOG,
        audit_policy_file=CONFIG / "audit-policy.json",
        authorization_mode="Node,RBAC",
        client_ca_file=certificate(AUTHORITY),
        enable_admission_plugins="NodeRestriction",
        etcd_servers=DATASTORES[datastore()][1],
        kubelet_client_certificate=certificate("apiserver-client"),
        kubelet_client_key=private_key("apiserver-client"),
        kubelet_preferred_address_types="InternalIP",
        service_account_issuer="https://kubernetes.default.svc.cluster.local",
        service_account_key_file=certificate(TOKENS),
        service_account_signing_key_file=private_key(TOKENS),
        service_cluster_ip_range=SERVICE_CIDR,
        tls_cert_file=certificate("apiserver"),
        tls_private_key_file=private_key("apiserver"),
    )
    argv = (NODE_BINARY, "kube-apiserver", *flags)
    return Component("apiserver", argv, answers(f"{API_URL}/readyz"), patience=120)


def controller_manager() -> Component:
    flags = as_flags(
        bind_address="127.0.0.1",
        cluster_signing_cert_file=certificate(AUTHORITY),
        cluster_signing_key_file=private_key(AUTHORITY),
        flex_volume_plugin_dir=ROOT / "volume-plugins",
        horizontal_pod_autoscaler_sync_period="5s",  # a test waits for several; 15 s is the default
        kubeconfig=kubeconfig_path("controller-manager"),
        leader_elect="false",
        root_ca_file=certificate(AUTHORITY),
        service_account_private_key_file=private_key(TOKENS),
        use_service_account_credentials="true",
    )
    argv = (NODE_BINARY, "kube-controller-manager", *flags)
    return Component("controller-manager", argv, answers("https://127.0.0.1:10257/healthz"))


def scheduler() -> Component:
    flags = as_flags(
        bind_address="127.0.0.1",
        kubeconfig=kubeconfig_path("scheduler"),
        leader_elect="false",
    )
    return Component("scheduler", (NODE_BINARY, "kube-scheduler", *flags), answers("https://127.0.0.1:10259/healthz"))


def containerd() -> Component:
    ctr = (str(BIN / "ctr"), "--address", str(CONTAINERD_SOCKET), "--timeout", "5s", "version")
    argv = (str(BIN / "containerd"), "--config", str(CONFIG / "containerd.toml"))
    return Component("containerd", argv, ctr)


def kubelet() -> Component:
    flags = as_flags(
        cert_dir=ROOT / "kubelet" / "pki",
        config=CONFIG / "kubelet.json",
        config_dir=CONFIG / "kubelet.conf.d",
        hostname_override=NODE_NAME,
        kubeconfig=kubeconfig_path("kubelet"),
        node_ip=NODE_ADDRESS,
        root_dir=ROOT / "kubelet",
    )
    argv = (NODE_BINARY, "kubelet", *flags, *configuration.kubelet_arguments())
    return Component("kubelet", argv, answers("http://127.0.0.1:10248/healthz"))


def proxy() -> Component:
    flags = as_flags(
        cluster_cidr=POD_CIDR,
        conntrack_max_per_core=0,  # these sysctls belong to the host
        conntrack_tcp_timeout_close_wait=0,
        conntrack_tcp_timeout_established=0,
        healthz_bind_address="127.0.0.1:10256",
        hostname_override=NODE_NAME,
        kubeconfig=kubeconfig_path("proxy"),
        oom_score_adj=0,
        proxy_mode="nftables",
    )
    return Component("proxy", (NODE_BINARY, "kube-proxy", *flags), answers("http://127.0.0.1:10256/healthz"))


def all_components() -> tuple[Component, ...]:
    """Return the components in the order in which they start; they stop in the opposite order."""
    serve, _ = DATASTORES[datastore()]
    return (serve(), apiserver(), controller_manager(), scheduler(), containerd(), kubelet(), proxy())


def names() -> tuple[str, ...]:
    return tuple(component.name for component in all_components())
