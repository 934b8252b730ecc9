"""Where the node's files live, and the names, addresses and versions that several files agree on."""

from __future__ import annotations

import os
from pathlib import Path

SOURCES = Path(__file__).resolve().parent
REPOSITORY = SOURCES.parents[1]
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "contextpolicy"

# Unix socket paths end at 108 bytes, so the root is short. `run` is what a reboot would clear.
ROOT = Path("/var/lib/contextpolicy-node")
BIN = ROOT / "bin"
CONFIG = ROOT / "config"
LOGS = ROOT / "logs"
AUDIT_LOG = LOGS / "audit.log"
MANIFESTS = ROOT / "manifests"
PKI = ROOT / "pki"
RUN = ROOT / "run"
KUBECONFIG = ROOT / "kubeconfig"
DATASTORE_VARIABLE = "CONTEXTPOLICY_NODE_DATASTORE"
KINE_SOCKET = RUN / "kine.sock"
CONTAINERD_SOCKET = RUN / "containerd.sock"
NETWORK_NAMESPACE = RUN / "net"

NODE_NAME = "contextpolicy-node"
NODE_ADDRESS = "10.240.0.2"
POD_CIDR = "10.244.0.0/24"
SERVICE_CIDR = "10.96.0.0/16"
API_SERVICE_ADDRESS = "10.96.0.1"  # by definition the first of SERVICE_CIDR
API_URL = f"https://{NODE_ADDRESS}:6443"
CNI_NETWORK = "contextpolicy-node"
CNI_PLUGINS = "/usr/lib/cni"

KUBERNETES_VERSION = "v1.36.3"
CONTAINERD_VERSION = "v2.4.2"
KINE_VERSION = "v0.17.5"
RUNC_VERSION = "v1.5.2"
HELM_VERSION = "v4.3.1"
METRICS_SERVER_VERSION = "v0.9.0"

TAG = "dev"
PAUSE_IMAGE = "contextpolicy-pause"
PAUSE_REFERENCE = f"docker.io/library/{PAUSE_IMAGE}:{TAG}"
