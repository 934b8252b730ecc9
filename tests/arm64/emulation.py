"""Programs of arm64 on this machine: Debian's user-mode QEMU, registered with the kernel while it is needed."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from tests.node.build import install_packages
from tests.node.shell import run

if TYPE_CHECKING:
    from collections.abc import Iterator

FORMATS = Path("/proc/sys/fs/binfmt_misc")
NAME = "qemu-aarch64"
DEBIAN_PACKAGES = ("arch-test", "binfmt-support", "qemu-user-static")


@contextmanager
def registered() -> Iterator[None]:
    """The kernel starts arm64's programs with the emulator, which is installed; afterwards only if it did before."""
    install_packages(DEBIAN_PACKAGES)
    mounted = (FORMATS / "register").exists()
    if not mounted:
        run(["mount", "-t", "binfmt_misc", "binfmt_misc", str(FORMATS)])
    known = (FORMATS / NAME).exists()
    try:
        if not known:
            run(["update-binfmts", "--enable", NAME])
        yield
    finally:
        if not known:
            run(["update-binfmts", "--disable", NAME])
        if not mounted:
            run(["umount", str(FORMATS)])
