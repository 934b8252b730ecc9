"""The base image that every image builds on, made from the distribution's packages without a registry."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from tests.node import cache, host
from tests.node.layout import CACHE
from tests.node.shell import run_long

if TYPE_CHECKING:
    from collections.abc import Sequence

SUITE = "bookworm"
PACKAGES = ("ca-certificates", "python3", "python3-venv")
UNWANTED = ("/usr/share/doc/*", "/usr/share/info/*", "/usr/share/locale/*", "/usr/share/man/*")
IMAGE = f"contextpolicy-base:{SUITE}"
DOCKERFILE = "FROM scratch\nADD base.tar /\n"
# The host's apt settings serve to build the image and are no part of it; nor are apt's 80 MB of caches.
HOOKS = (
    'rm -f "$1/etc/apt/apt.conf.d/99mmdebstrap" "$1/etc/dpkg/dpkg.cfg.d/99mmdebstrap" "$1"/var/cache/apt/*.bin',
    # As in python:*-slim, no bytecode: it names the time of its source, and images get times of their own.
    'find "$1/usr/lib" -depth -name __pycache__ -exec rm -r {} +',
    """echo 'Dir::Cache { pkgcache ""; srcpkgcache ""; };' > "$1/etc/apt/apt.conf.d/no-caches\"""",
)
APT_SOURCES = (Path("/etc/apt/sources.list.d/debian.sources"), Path("/etc/apt/sources.list"))
TIMEOUT = 1800.0  # another architecture's packages are installed by an emulator


def archive(architecture: str = "") -> Path:
    """Return the folder with base.tar and the Dockerfile that turns it into the image.

    `architecture` is Debian's name of another one than the machine's; its programs must be able to run here.
    """
    return cache.folder(CACHE / "images" / f"base-{key(architecture)}", lambda out: _create(out, architecture))


def key(architecture: str = "") -> str:
    return cache.key(SUITE, PACKAGES, UNWANTED, HOOKS, DOCKERFILE, *filter(None, [architecture]))


def _create(folder: Path, architecture: str) -> None:
    (folder / "Dockerfile").write_text(DOCKERFILE)
    what = "the base image" + (f" for {architecture}" if architecture else "")
    make(what, folder / "base.tar", PACKAGES, architecture=architecture)


def make(what: str, tar: Path, packages: Sequence[str], *, architecture: str = "") -> None:
    """Make a root file system as a tar, from where the host gets its own packages."""
    settings = host.apt_settings(host.output("apt-config", "dump"))
    argv = command(tar, packages, settings, _mirrors(), architecture=architecture)
    run_long(f"making {what}", argv, output=CACHE / "logs" / "base.log", timeout=TIMEOUT, env=os.environ)


def command(
    tar: Path, packages: Sequence[str], settings: list[str], mirrors: list[str], *, architecture: str = ""
) -> list[str]:
    """Return the mmdebstrap call that writes the tar."""
    options = [f"--aptopt={setting}" for setting in settings]
    options += [f"--dpkgopt=path-exclude={pattern}" for pattern in UNWANTED]
    options += [f"--customize-hook={hook}" for hook in HOOKS]
    options += [f"--architectures={architecture}"] if architecture else []
    contents = ["--variant=minbase", f"--include={','.join(packages)}"]
    return ["mmdebstrap", *contents, *options, SUITE, str(tar), *mirrors]


def _mirrors() -> list[str]:
    """Return the host's own package sources when it runs the same release, else mmdebstrap's default."""
    release = Path("/etc/os-release").read_text()
    if not re.search(rf"^VERSION_CODENAME={SUITE}$", release, re.MULTILINE):
        return []
    return [str(path) for path in APT_SOURCES if path.exists()][:1]
