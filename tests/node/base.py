"""The base image that every image builds on, made from the distribution's packages without a registry."""

from __future__ import annotations

import os
import re
from pathlib import Path

from tests.node import cache, host
from tests.node.layout import CACHE
from tests.node.shell import run_long

SUITE = "bookworm"
PACKAGES = ("ca-certificates", "python3", "python3-venv")
UNWANTED = ("/usr/share/doc/*", "/usr/share/info/*", "/usr/share/locale/*", "/usr/share/man/*")
IMAGE = f"contextpolicy-base:{SUITE}"
DOCKERFILE = "FROM scratch\nADD base.tar /\n"
# The host's apt settings serve to build the image and are no part of it; nor are apt's 80 MB of caches.
HOOKS = (
    'rm -f "$1/etc/apt/apt.conf.d/99mmdebstrap" "$1/etc/dpkg/dpkg.cfg.d/99mmdebstrap" "$1"/var/cache/apt/*.bin',
    """echo 'Dir::Cache { pkgcache ""; srcpkgcache ""; };' > "$1/etc/apt/apt.conf.d/no-caches\"""",
)
APT_SOURCES = (Path("/etc/apt/sources.list.d/debian.sources"), Path("/etc/apt/sources.list"))
TIMEOUT = 600.0


def archive() -> Path:
    """Return the folder with base.tar and the Dockerfile that turns it into the image."""
    return cache.folder(CACHE / "images" / f"base-{key()}", _create)


def key() -> str:
    return cache.key(SUITE, PACKAGES, UNWANTED, HOOKS, DOCKERFILE)


def _create(folder: Path) -> None:
    (folder / "Dockerfile").write_text(DOCKERFILE)
    argv = command(folder / "base.tar", _host_settings(), _mirrors())
    output = CACHE / "logs" / "base.log"
    run_long("making the base image", argv, output=output, timeout=TIMEOUT, env=os.environ)


def command(tar: Path, settings: list[str], mirrors: list[str]) -> list[str]:
    """Return the mmdebstrap call that writes the tar."""
    options = [f"--aptopt={setting}" for setting in settings]
    options += [f"--dpkgopt=path-exclude={pattern}" for pattern in UNWANTED]
    options += [f"--customize-hook={hook}" for hook in HOOKS]
    contents = ["--variant=minbase", f"--include={','.join(PACKAGES)}"]
    return ["mmdebstrap", *contents, *options, SUITE, str(tar), *mirrors]


def _host_settings() -> list[str]:
    return host.apt_settings(host.output("apt-config", "dump"))


def _mirrors() -> list[str]:
    """Return the host's own package sources when it runs the same release, else mmdebstrap's default."""
    release = Path("/etc/os-release").read_text()
    if not re.search(rf"^VERSION_CODENAME={SUITE}$", release, re.MULTILINE):
        return []
    return [str(path) for path in APT_SOURCES if path.exists()][:1]
