"""The node's programs: Debian packages, and Go programs built from source once and then cached."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from tests.node import cache
from tests.node.errors import ClusterError
from tests.node.layout import (
    BIN,
    CACHE,
    CONTAINERD_VERSION,
    HELM_CONTROLLER_VERSION,
    HELM_VERSION,
    KINE_VERSION,
    KUBERNETES_VERSION,
    METRICS_SERVER_VERSION,
    RUNC_VERSION,
    SOURCES,
)
from tests.node.shell import run, run_long, succeeds

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

DEBIAN_PACKAGES = (
    "buildah",
    "conntrack",
    "containernetworking-plugins",
    "gcc",
    "iproute2",
    "iptables",
    "libc6-dev",
    "libseccomp-dev",
    "mmdebstrap",
    "nftables",
    "openssl",
    "pkg-config",
)
GO_BUILD_TIMEOUT = 1800.0


@dataclass(frozen=True)
class Program:
    """Go packages that are built together: from `source`, a folder here, else fetched at their version."""

    name: str
    packages: tuple[str, ...]
    source: str = ""
    tags: str = ""
    ldflags: str = "-s -w"
    cgo: bool = False


def kubernetes_ldflags(version: str) -> str:
    """Stamp the version into both places that read it; without it the components refuse each other."""
    major, minor, _patch = version.removeprefix("v").split(".")
    values = {"gitVersion": version, "gitMajor": major, "gitMinor": minor, "gitTreeState": "clean"}
    places = ("k8s.io/component-base/version", "k8s.io/client-go/pkg/version")
    stamps = (f"-X {place}.{name}={value}" for place in places for name, value in values.items())
    return " ".join(["-s -w", *stamps])


CONTAINERD = "github.com/containerd/containerd/v2/cmd"
HELM = Program("helm", (f"helm.sh/helm/v4/cmd/helm@{HELM_VERSION}",))
NODE = Program("node", (".",), source="program", ldflags=kubernetes_ldflags(KUBERNETES_VERSION))
PAUSE = Program("pause", ("./pause",), source="program")
PROGRAMS = (
    NODE,
    PAUSE,
    # As in k3s: with SQLite itself, where the build without cgo has a translation of it to Go.
    Program("kine", (f"github.com/k3s-io/kine@{KINE_VERSION}",), cgo=True),
    Program(
        "containerd",
        (
            f"{CONTAINERD}/containerd@{CONTAINERD_VERSION}",
            f"{CONTAINERD}/containerd-shim-runc-v2@{CONTAINERD_VERSION}",
            f"{CONTAINERD}/ctr@{CONTAINERD_VERSION}",
        ),
        tags="no_btrfs,no_zfs,no_devmapper",
    ),
    Program("runc", (f"github.com/opencontainers/runc@{RUNC_VERSION}",), tags="seccomp", cgo=True),
    HELM,
)
PROMTOOL = Program("promtool", ("github.com/prometheus/prometheus/cmd/promtool",), source="promtool")
"""Judges the chart's alert rules; no part of a node. Its module has replacements, so it can't be fetched by version."""
VPA_MODULE = "k8s.io/autoscaler/vertical-pod-autoscaler"
AUTOSCALER = (
    # Its module excludes versions, so it can't be fetched by version either.
    Program(
        "vpa",
        tuple(f"{VPA_MODULE}/pkg/{part}" for part in ("recommender", "updater", "admission-controller")),
        source="vpa",
    ),
    Program("metrics-server", (f"sigs.k8s.io/metrics-server/cmd/metrics-server@{METRICS_SERVER_VERSION}",)),
)
"""The VerticalPodAutoscaler and the metrics-server that it reads: no part of a node, but of what it may meet there."""
FLUX = Program("flux", ("./health", "github.com/fluxcd/kustomize-controller"), source="flux")
"""Flux' kustomize-controller, and a program that asks GitOps tools' own libraries for an object's health."""
REGISTRY = Program("registry", (".",), source="registry")
"""Serves a release's chart and image in a test."""
SYFT = Program("syft", ("github.com/anchore/syft/cmd/syft@v1.54.1",), ldflags="-s -w -X main.version=1.54.1")
"""Lists what is in a release's image."""
HELM_CONTROLLER = Program("helm-controller", (f"github.com/k3s-io/helm-controller@{HELM_CONTROLLER_VERSION}",))
"""What k3s installs charts with (`HelmChart` manifests); no part of this node, a test runs it."""
FURTHER = {program.name: program for program in (*AUTOSCALER, PROMTOOL, FLUX, REGISTRY, SYFT, HELM_CONTROLLER)}


def build_further(names: Iterable[str]) -> None:
    """Build programs that no node needs, but a test."""
    for name in names:
        build(FURTHER[name])


def build_all() -> None:
    """Build one program after the other: each go build already uses every core."""
    install_packages()
    for program in PROGRAMS:
        build(program)


def install_packages(names: Iterable[str] = DEBIAN_PACKAGES) -> None:
    missing = [name for name in names if not _installed(name)]
    if not missing:
        return
    log = CACHE / "logs" / "apt.log"
    env = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    run_long("updating the package lists", ["apt-get", "update"], output=log, timeout=300, env=env)
    install = ["apt-get", "install", "--yes", "--no-install-recommends", *missing]
    run_long(f"installing {' '.join(missing)}", install, output=log, timeout=600, env=env)


def _installed(package: str) -> bool:
    query = ["dpkg-query", "--show", "--showformat=${db:Status-Status}", package]
    return succeeds(query) and run(query) == "installed"


def build(program: Program) -> Path:
    """Return the folder that holds the program's binaries."""
    if shutil.which("go") is None:
        raise ClusterError("go is not on the PATH: the node's programs are built from source")
    target = CACHE / "bin" / f"{program.name}-{program_key(program)}"
    return cache.folder(target, lambda out: _compile(program, out))


def program_key(program: Program) -> str:
    root = SOURCES / program.source
    files = cache.source_files(root) if program.source else []
    return cache.key(asdict(program), files=files, root=root)


def _compile(program: Program, out: Path) -> None:
    flags = ["-trimpath", "-buildvcs=false", "-tags", program.tags, "-ldflags", program.ldflags]
    if program.source:
        source = str(SOURCES / program.source)
        argv = ["go", "-C", source, "build", *flags, "-o", f"{out}/", *program.packages]
    else:
        argv = ["go", "install", *flags, *program.packages]
    env = {**os.environ, "GOBIN": str(out), "CGO_ENABLED": "1" if program.cgo else "0"}
    log = CACHE / "logs" / f"build-{program.name}.log"
    run_long(f"building {program.name}", argv, output=log, timeout=GO_BUILD_TIMEOUT, env=env)


def link_binaries() -> None:
    """Make BIN the one folder that the PATH needs, with `kubectl` as another name of `node`."""
    BIN.mkdir(parents=True, exist_ok=True)
    for program in PROGRAMS:
        for binary in build(program).iterdir():
            _link(BIN / binary.name, binary)
    _link(BIN / "kubectl", BIN / "node")


def _link(link: Path, target: Path) -> None:
    link.unlink(missing_ok=True)
    link.symlink_to(target)


def path_with_binaries() -> str:
    """Debian keeps nft, ip and conntrack in the sbin folders, which not every PATH has."""
    return os.pathsep.join([str(BIN), os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"])
