"""How to reach the cluster: ours from inside its network, or the one that the user's KUBECONFIG names."""

from __future__ import annotations

import os

from tests.node import shell
from tests.node.build import path_with_binaries
from tests.node.errors import ClusterError
from tests.node.layout import CONTAINERD_SOCKET, KUBECONFIG, NETWORK_NAMESPACE
from tests.node.network import inside


def user_cluster() -> str | None:
    """Return the user's own KUBECONFIG; ours may be set too, by `exec`, and does not count."""
    chosen = os.environ.get("KUBECONFIG")
    return chosen if chosen and chosen != str(KUBECONFIG) else None


def environment() -> dict[str, str]:
    """Return the environment in which kubectl, helm and ctr speak to the cluster."""
    if user_cluster():
        return dict(os.environ)
    ctr = {"CONTAINERD_ADDRESS": str(CONTAINERD_SOCKET), "CONTAINERD_NAMESPACE": "k8s.io"}
    return {**os.environ, **ctr, "PATH": path_with_binaries(), "KUBECONFIG": str(KUBECONFIG)}


def command(argv: list[str]) -> list[str]:
    """Return the command line that runs a command where the cluster's addresses are reachable."""
    if user_cluster():
        return argv
    if not NETWORK_NAMESPACE.exists():
        raise ClusterError("the node is not up: run `python -m tests.node up` first")
    return inside(argv)


def run(argv: list[str], *, timeout: float = 60, stdin: str | None = None) -> str:
    """Run a command against the cluster and return what it printed."""
    return shell.run(command(argv), timeout=timeout, env=environment(), stdin=stdin)
