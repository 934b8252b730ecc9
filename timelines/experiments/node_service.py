"""Gives what runs the node the weight of a service while tasks are measured.

The tests' node gives the API server, the kubelet and containerd eight times that, so that they answer while pods
saturate it; whenever a quota follows to the API, they then hold the tasks up for 0.1 to 0.4 s. On a robot systemd runs
them, as a service like any other.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from contextpolicy.agent import weight_units
from timelines.demo.cgroup import ROOT
from timelines.demo.deploy import DeployError
from timelines.experiments.confine import Contained

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

SERVICE = {1: 1024, 2: 100}
"""What systemd gives a service, by version of the cgroup hierarchy."""
PROC = Path("/proc")


class Grouped(Contained, Protocol):
    """A container that knows its cgroup hierarchy, such as a `timelines.demo.cgroup.Cgroup`."""

    @property
    def version(self) -> int:
        """Of the hierarchy."""


@contextmanager
def as_service(containers: Iterable[Grouped], root: Path = ROOT, proc: Path = PROC) -> Iterator[None]:
    """Let the group that a container's shim is in, with all else that runs the node, weigh what a service does.

    DeployError if it is in no group of its own.
    """
    container = next(iter(containers))
    file = _weight_file(container, root, proc)
    before = file.read_text(encoding="ascii")
    file.write_text(str(SERVICE[container.version]), encoding="ascii")
    try:
        yield
    finally:
        file.write_text(before, encoding="ascii")


def _weight_file(container: Grouped, root: Path, proc: Path) -> Path:
    """Where the weight is of the group of its shim: the first process above it that is not the container's own."""
    own = container.processes()
    above = own[0] if own else 0
    while above in own:
        above = _parent(above, proc)
    for line in (proc / str(above) / "cgroup").read_text(encoding="utf-8").splitlines() if above else ():
        _, controllers, group = line.split(":", 2)
        if container.version == 1 and "cpu" in controllers.split(","):
            root /= "cpu"
        elif container.version == 1 or controllers:
            continue
        file = root / group.lstrip("/") / weight_units.FILES[container.version]
        if group != "/" and file.exists():
            return file
    raise DeployError("what runs the node has no CPU group of its own: expected one, as a systemd service has")


def _parent(process: int, proc: Path) -> int:
    """The process that started one; the second field of /proc/PID/stat may hold anything, and ends at the last `)`."""
    return int((proc / str(process) / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[1])
