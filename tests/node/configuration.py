"""The configuration files of the components as text: pure, nothing is read or written here."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import yaml

from tests.node import cgroups
from tests.node.certificates import AUTHORITY, certificate, private_key
from tests.node.layout import (
    API_URL,
    BIN,
    CNI_NETWORK,
    CNI_PLUGINS,
    CONFIG,
    CONTAINERD_SOCKET,
    K3S,
    MANIFESTS,
    NODE_NAME,
    PAUSE_REFERENCE,
    POD_CIDR,
    ROOT,
    RUN,
)

if TYPE_CHECKING:
    from tests.node.certificates import Identity

CONTAINERD_TOML = f"""
version = 3
root = '{ROOT}/containerd'
state = '{RUN}/containerd'

[grpc]
address = '{CONTAINERD_SOCKET}'

[plugins.'io.containerd.shim.v1.manager']
socket_dir = '{RUN}/s'

[plugins.'io.containerd.internal.v1.opt']
path = '{ROOT}/containerd/opt'

[plugins.'io.containerd.nri.v1.nri']
disable = true

[plugins.'io.containerd.cri.v1.images'.pinned_images]
sandbox = '{PAUSE_REFERENCE}'

[plugins.'io.containerd.cri.v1.runtime']
# Without CAP_SYS_RESOURCE nobody may lower a process's oom_score_adj, and every sandbox would fail on trying.
restrict_oom_score_adj = true
netns_mounts_under_state_dir = true

[plugins.'io.containerd.cri.v1.runtime'.cni]
bin_dirs = ['{CNI_PLUGINS}']
conf_dir = '{CONFIG}/cni'

[plugins.'io.containerd.cri.v1.runtime'.containerd.runtimes.runc]
runtime_type = 'io.containerd.runc.v2'
runtime_path = '{BIN}/containerd-shim-runc-v2'

[plugins.'io.containerd.cri.v1.runtime'.containerd.runtimes.runc.options]
BinaryName = '{BIN}/runc'
Root = '{RUN}/runc'
SystemdCgroup = %s
"""


def containerd() -> str:
    return CONTAINERD_TOML % str(cgroups.driver() == "systemd").lower()


def kubeconfig(identity: Identity) -> str:
    user = {"client-certificate": certificate(identity.name), "client-key": private_key(identity.name)}
    cluster = {"server": API_URL, "certificate-authority": certificate(AUTHORITY)}
    config = {
        "apiVersion": "v1",
        "kind": "Config",
        "clusters": [{"name": NODE_NAME, "cluster": cluster}],
        "users": [{"name": identity.name, "user": user}],
        "contexts": [{"name": NODE_NAME, "context": {"cluster": NODE_NAME, "user": identity.name}}],
        "current-context": NODE_NAME,
    }
    return json.dumps(config, indent=2)


def audit_policy() -> str:
    """Who called what, of the programs that run in pods: the node's own components make nearly all of the noise."""
    policy = {
        "apiVersion": "audit.k8s.io/v1",
        "kind": "Policy",
        "omitStages": ["RequestReceived"],
        "rules": [
            {"level": "None", "userGroups": ["system:serviceaccounts:kube-system"]},
            {"level": "Metadata", "userGroups": ["system:serviceaccounts"]},
            {"level": "None"},
        ],
    }
    return json.dumps(policy, indent=2)


def kubelet() -> str:
    config = {
        "apiVersion": "kubelet.config.k8s.io/v1beta1",
        "kind": "KubeletConfiguration",
        "authentication": {
            "anonymous": {"enabled": False},
            "webhook": {"enabled": True},
            "x509": {"clientCAFile": certificate(AUTHORITY)},
        },
        "authorization": {"mode": "Webhook"},
        "cgroupDriver": cgroups.driver(),
        "failCgroupV1": False,
        "failSwapOn": False,
        # Under cgroup v1 the kubelet refuses to let pods swap.
        "memorySwap": {"swapBehavior": "LimitedSwap" if cgroups.driver() == "systemd" else "NoSwap"},
        "oomScoreAdj": 0,
        "containerRuntimeEndpoint": f"unix://{CONTAINERD_SOCKET}",
        "staticPodPath": str(MANIFESTS),
        "podLogsDir": f"{ROOT}/pods",
        "volumePluginDir": f"{ROOT}/volume-plugins",
        "resolvConf": "",
        # Nothing answers there. Without one the kubelet writes an Event each time that it syncs a pod.
        "clusterDNS": ["127.0.0.1"],
        # Images come from no registry: a collected one is gone. The host's full disk must not evict pods.
        "imageGCHighThresholdPercent": 100,
        "evictionHard": {"memory.available": "100Mi", "nodefs.available": "1%", "imagefs.available": "1%"},
    }
    return json.dumps(config, indent=2)


def kubelet_arguments() -> list[str]:
    """What config/k3s/config.yaml adds to the command line where the node is as k3s makes it; elsewhere nothing."""
    if cgroups.driver() != "systemd":
        return []
    config = yaml.safe_load((K3S / "config.yaml").read_text())
    return [f"--{argument}" for argument in config["kubelet-arg"]]


def cni() -> str:
    ipam = {
        "type": "host-local",
        "ranges": [[{"subnet": POD_CIDR}]],
        "routes": [{"dst": "0.0.0.0/0"}],
        "dataDir": f"{RUN}/cni",
    }
    bridge = {"type": "bridge", "bridge": "cni0", "isGateway": True, "hairpinMode": True, "ipam": ipam}
    plugins = [bridge, {"type": "portmap", "capabilities": {"portMappings": True}}]
    return json.dumps({"cniVersion": "1.0.0", "name": CNI_NETWORK, "plugins": plugins}, indent=2)
