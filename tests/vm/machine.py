"""QEMU without KVM: a machine that boots a disk, says everything on its console, and is bounded in time.

Its time is counted in instructions, one for each nanosecond, and does not pass while it has nothing to do. So it is a
computer of one slow core, whatever the host's speed and load: no timeout in it depends on them. More cores would take
turns, each spinning away the turn in which it waits for another.
"""

from __future__ import annotations

import logging
import subprocess
import time
from typing import TYPE_CHECKING

from tests.node.errors import ClusterError
from tests.node.shell import tail

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)

PROGRAM = "qemu-system-x86_64"
MEMORY = 4096
"""MiB, and so are the machine's translated instructions."""
TRANSLATED = 1024
KERNEL_ARGUMENTS = "console=ttyS0 root=/dev/vda rw mitigations=off systemd.show_status=false quiet"
LOOK = 1.0


def command(kernel: Path, initial: Path, disk: Path) -> list[str]:
    """Return the command line of a machine that has this disk, no network, and its console on standard output."""
    return [
        *(PROGRAM, "-accel", f"tcg,tb-size={TRANSLATED}", "-cpu", "max", "-m", str(MEMORY)),
        *("-smp", "1", "-icount", "shift=0,sleep=off", "-rtc", "clock=vm"),
        *("-nodefaults", "-display", "none", "-serial", "stdio", "-nic", "none"),
        *("-device", "virtio-rng-pci"),
        *("-kernel", str(kernel), "-initrd", str(initial), "-append", KERNEL_ARGUMENTS),
        *("-drive", f"file={disk},format=raw,if=virtio,cache=unsafe"),
    ]


def run(argv: list[str], console: Path, *, timeout: float) -> None:
    """Run the machine until it powers itself off; what it says goes to the terminal and to the file."""
    console.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + timeout
    with (
        console.open("wb") as said,
        subprocess.Popen(argv, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True) as qemu,
    ):
        try:
            with console.open(errors="replace") as follow:
                while qemu.poll() is None and time.monotonic() < deadline:
                    _show(follow.read())
                    time.sleep(LOOK)
                _show(follow.read())
        finally:
            if ended := qemu.poll() is not None:
                log.debug("the machine is off")
            qemu.kill()
    if not ended:
        raise ClusterError(f"the machine was still on after {timeout:.0f} s, the end of {console}:\n{tail(console)}")
    if qemu.returncode:
        raise ClusterError(f"{PROGRAM}: exit {qemu.returncode}, the end of {console}:\n{tail(console)}")


def _show(text: str) -> None:
    for line in text.splitlines():
        log.info("  %s", line.rstrip())
