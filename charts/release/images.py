"""The operator's image for each architecture, as one OCI archive that is the same whenever it is built of a commit."""

from __future__ import annotations

import argparse
import json
import logging
import os
import re
from contextlib import ExitStack
from typing import TYPE_CHECKING

from charts.release import archives
from tests.arm64 import emulation
from tests.node import base, host, mounts, shell
from tests.node import build as programs
from tests.node.layout import CACHE
from tests.node.lock import held

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from charts.release.source import Commit

log = logging.getLogger(__name__)

ARCHITECTURES = ("amd64", "arm64")
NAME = "docker.io/library/contextpolicy"
"""What container runtimes make of the chart's `image.repository: contextpolicy`."""
STORE = CACHE / "release" / "store"
BUILD_TIMEOUT = 3600.0  # pip in an emulator


def pinned(name: str) -> str:
    """Return a base image's name; without a digest it may be another image tomorrow."""
    if not re.fullmatch(r".+@sha256:[0-9a-f]{64}", name):
        raise argparse.ArgumentTypeError(f"invalid value {name!r}: expected NAME@sha256: and 64 hexadecimal digits")
    return name


def build(commit: Commit, folder: Path, architectures: Sequence[str], base_image: str | None) -> Path:
    """Build for each architecture and return the archive with all of them."""
    programs.install_packages()
    name = f"contextpolicy-{commit.version}-image"
    with ExitStack() as stack:
        stack.enter_context(held("release"))
        if set(architectures) - {native()}:
            stack.enter_context(emulation.registered())
        for architecture in architectures:
            _bud(commit, architecture, base_image or _base(architecture))
        layout = folder / name
        _push(commit, architectures, layout)
    _name(layout / "index.json", f"{NAME}:{commit.version}")
    return archives.tar(layout, folder / f"{name}.tar", commit.epoch)


def native() -> str:
    """Return this machine's architecture."""
    return shell.run(["dpkg", "--print-architecture"]).strip()


def _base(architecture: str) -> str:
    """Put the base image into the store and return its name there."""
    other = "" if architecture == native() else architecture
    name, folder = f"localhost/{base.IMAGE}-{architecture}", base.archive(other)
    stamp = STORE / f"base-{base.key(other)}"
    if not stamp.exists():
        _buildah("bud", "--platform", f"linux/{architecture}", "--timestamp", "0", "--tag", name, str(folder))
        stamp.touch()
    return name


def _bud(commit: Commit, architecture: str, base_image: str) -> None:
    """Build from scratch, even if it was built before: what a layer is made of may have changed elsewhere."""
    arguments = {"BASE_IMAGE": base_image, "VERSION": commit.version, "REVISION": commit.identifier}
    options = [part for name, value in arguments.items() for part in ("--build-arg", f"{name}={value}")]
    options += [part for volume in host.volumes() for part in ("--volume", volume)]
    options += ["--no-cache", "--timestamp", str(commit.epoch), "--identity-label=false"]
    options += ["--isolation", "chroot", "--platform", f"linux/{architecture}"]
    options += ["--pull-never"] if base_image.startswith("localhost/") else []
    dockerfile = str(commit.folder / "operator" / "Dockerfile")
    _buildah("bud", *options, "--file", dockerfile, "--tag", _tag(commit, architecture), str(commit.folder))


def _tag(commit: Commit, architecture: str) -> str:
    return f"localhost/contextpolicy:{commit.version}-{architecture}"


def _push(commit: Commit, architectures: Sequence[str], layout: Path) -> None:
    """Write an index of the images and all that it refers to."""
    name = f"localhost/contextpolicy:{commit.version}"
    shell.succeeds(_command("manifest", "rm", name), timeout=60)
    _buildah("manifest", "create", name, *(_tag(commit, one) for one in architectures))
    _buildah("manifest", "push", "--all", name, f"oci:{layout}")


def _name(index: Path, name: str) -> None:
    """Say in the archive's index what the image is called, to containerd (and k3s) and to other programs."""
    content = json.loads(index.read_text())
    (image,) = content["manifests"]
    image["annotations"] = {"io.containerd.image.name": name, "org.opencontainers.image.ref.name": name}
    index.write_text(json.dumps(content, sort_keys=True))


def _buildah(*arguments: str) -> None:
    STORE.mkdir(parents=True, exist_ok=True)
    output = CACHE / "logs" / f"release-{arguments[0]}.log"
    what = f"buildah {' '.join(arguments[:1])} {arguments[-1]}"
    try:
        shell.run_long(what, _command(*arguments), output=output, timeout=BUILD_TIMEOUT, env=os.environ)
    finally:
        mounts.remove(STORE)


def _command(*arguments: str) -> list[str]:
    return ["buildah", "--root", f"{STORE}/root", "--runroot", f"{STORE}/run", *arguments]
