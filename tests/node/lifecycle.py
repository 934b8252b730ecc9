"""The node's life: up, down, and single components stopped and started in between."""

from __future__ import annotations

import logging
import shutil
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from tests.node import (
    access,
    base,
    build,
    certificates,
    cgroups,
    components,
    configuration,
    images,
    leftovers,
    mounts,
    network,
    processes,
    traces,
)
from tests.node.errors import ClusterError
from tests.node.layout import BIN, CONFIG, K3S, KUBECONFIG, LOGS, MANIFESTS, NODE_NAME, ROOT, RUN
from tests.node.lock import held
from tests.node.shell import succeeds, tail, wait_until

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

NODE_PATIENCE = 60.0


def up() -> None:
    """Build what is missing and start the node; one that is half dead is ended and started with its state."""
    if access.user_cluster():
        log.info("using the cluster of KUBECONFIG=%s", access.user_cluster())
        return
    with held("node"):
        if is_ready():
            log.info("the node is up")
            return
        _build()
        if RUN.exists():
            log.info("the node is half dead: starting it again with its state")
            leftovers.clean(keep_state=True)
        build.link_binaries()
        _start(images.import_pause)
        log.info("the node is up: kubeconfig %s, logs %s", KUBECONFIG, LOGS)


def boot() -> None:
    """Start the node after its machine has started; nothing is built, for programs and images are there already."""
    with held("node"):
        shutil.rmtree(RUN, ignore_errors=True)
        _start(lambda: None)


def down(*, keep_state: bool = False) -> None:
    """End everything and leave nothing behind; with keep_state, as a power cut would leave it."""
    if access.user_cluster():
        log.info("leaving the cluster of KUBECONFIG=%s as it is", access.user_cluster())
        return
    with held("node"):
        if not ROOT.exists():
            log.info("the node is down")
            return
        leftovers.clean(keep_state=keep_state)
        log.info("the node is down%s", f", its state is kept in {ROOT}" if keep_state else "")


def stop(name: str) -> None:
    """Stop one component and leave the rest alone: pods go on while their kubelet or containerd is away."""
    processes.stop(component(name).name)


def start(name: str) -> None:
    """Start one component that was stopped, and wait until it serves."""
    chosen = component(name)
    if processes.alive(name) is None:
        processes.start(name, chosen.argv)
    processes.await_ready(name, chosen.probe, patience=chosen.patience)


def component(name: str) -> components.Component:
    """Find one of our node's components; those of the user's cluster are not ours to stop."""
    if access.user_cluster():
        raise ClusterError(f"the components of KUBECONFIG={access.user_cluster()} cannot be stopped or started here")
    found = [one for one in components.all_components() if one.name == name]
    if not found:
        raise ClusterError(f"no component is called {name!r}: it is one of {', '.join(components.names())}")
    return found[0]


def status() -> dict[str, str]:
    """Return the state of each component and of the node itself."""
    states = {one.name: _state(one) for one in components.all_components()}
    return {**states, NODE_NAME: "ready" if _node_is_ready() else "not ready"}


def is_ready() -> bool:
    return network.exists() and all(state == "ready" for state in status().values())


def _state(one: components.Component) -> str:
    if processes.alive(one.name) is None:
        return "stopped"
    return "ready" if succeeds(network.inside(one.probe)) else "not ready"


def _build() -> None:
    """Build the programs, which keeps the cores busy, while the base image mostly waits for the network."""
    build.install_packages()
    with ThreadPoolExecutor(max_workers=1) as background:
        archive = background.submit(base.archive)
        build.build_all()
        archive.result()


def _start(import_images: Callable[[], None]) -> None:
    if cgroups.pod_processes():
        raise ClusterError("another Kubernetes runs pods on this machine: set KUBECONFIG to use that one")
    traces.remember()
    _write_configuration()
    network.create()
    cgroups.create()
    mounts.share(ROOT / "kubelet")
    for one in components.all_components():
        log.info("starting %s", one.name)
        start(one.name)
        if one.name == "containerd":
            import_images()
    _await_node()


def _write_configuration() -> None:
    certificates.create()
    for folder in (MANIFESTS, CONFIG / "cni", CONFIG / "kubelet.conf.d", ROOT / "kine"):
        folder.mkdir(parents=True, exist_ok=True)
    for identity in certificates.CLIENTS:
        (CONFIG / f"{identity.name}.kubeconfig").write_text(configuration.kubeconfig(identity))
    KUBECONFIG.write_text(configuration.kubeconfig(certificates.ADMIN))
    KUBECONFIG.chmod(0o600)
    (CONFIG / "containerd.toml").write_text(configuration.containerd())
    (CONFIG / "audit-policy.json").write_text(configuration.audit_policy())
    (CONFIG / "kubelet.json").write_text(configuration.kubelet())
    shutil.copy(K3S / "kubelet.conf", CONFIG / "kubelet.conf.d" / "90-contextpolicy.conf")
    (CONFIG / "cni" / "10-node.conflist").write_text(configuration.cni())


def _await_node() -> None:
    """Wait until pods can be created: the node takes them and the default service account is there."""
    _await("kubelet", "the node is not Ready", _node_is_ready)
    _await("controller-manager", "no default service account", lambda: _kubectl("get", "sa", "default"))


def _await(name: str, complaint: str, condition: Callable[[], bool]) -> None:
    if not wait_until(condition, timeout=NODE_PATIENCE):
        file = LOGS / f"{name}.log"
        raise ClusterError(f"{name}: {complaint} after {NODE_PATIENCE:.0f} s, the end of {file}:\n{tail(file)}")


def _node_is_ready() -> bool:
    return _kubectl("wait", "--for=condition=Ready", f"node/{NODE_NAME}", "--timeout=5s")


def _kubectl(*arguments: str) -> bool:
    return succeeds(network.inside([str(BIN / "kubectl"), "--kubeconfig", str(KUBECONFIG), *arguments]))
