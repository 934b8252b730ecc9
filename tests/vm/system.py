"""The machine's operating system: Debian with systemd, as one tar, and a bootable disk made of it."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

from tests.node import base, cache
from tests.node.shell import run
from tests.vm.places import SYSTEMS

if TYPE_CHECKING:
    from pathlib import Path

PACKAGES = (
    "ca-certificates",
    "conntrack",
    "containernetworking-plugins",
    "dbus",
    "iproute2",
    "iptables",
    "kmod",
    "libseccomp2",
    "linux-image-cloud-amd64",
    "nftables",
    "openssl",
    "procps",
    "python3",
    "systemd",
    "systemd-sysv",
    "udev",
)
DISK_SIZE = "6G"


def archive() -> Path:
    """Return the folder with system.tar."""
    key = cache.key(base.SUITE, PACKAGES, base.UNWANTED)
    return cache.folder(
        SYSTEMS / f"system-{key}", lambda out: base.make("the machine's system", out / "system.tar", PACKAGES)
    )


def unpack(folder: Path) -> None:
    """Make the folder the machine's root."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    run(["tar", "--extract", "--file", str(archive() / "system.tar"), "--directory", str(folder)], timeout=300)


def kernel(root: Path) -> tuple[Path, Path]:
    """Return the kernel and its initial file system in an unpacked root."""
    [image], [initial] = (sorted((root / "boot").glob(f"{name}-*")) for name in ("vmlinuz", "initrd.img"))
    return image, initial


def make_disk(root: Path, disk: Path) -> None:
    """Make an ext4 disk of a root; sparse, so that it costs what is on it."""
    disk.unlink(missing_ok=True)
    run(["mke2fs", "-q", "-t", "ext4", "-L", "root", "-d", str(root), str(disk), DISK_SIZE], timeout=600)
