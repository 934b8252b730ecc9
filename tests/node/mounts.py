"""Mounts below a folder: what the container runtime and the kubelet leave when they are killed."""

from __future__ import annotations

from pathlib import Path

from tests.node.errors import ClusterError
from tests.node.shell import run, succeeds

MOUNT_TABLE = Path("/proc/self/mountinfo")


def below(folder: Path, table: str) -> list[str]:
    """List the mount points at or below the folder, the newest first."""
    points = [line.split()[4] for line in table.splitlines()]
    return [point for point in reversed(points) if point == str(folder) or point.startswith(f"{folder}/")]


def share(folder: Path) -> None:
    """Make the folder a shared mount: mounts that the kubelet makes in it must reach the containers."""
    folder.mkdir(parents=True, exist_ok=True)
    run(["mount", "--bind", str(folder), str(folder)])
    run(["mount", "--make-rshared", str(folder)])


def remove(folder: Path) -> None:
    for point in below(folder, MOUNT_TABLE.read_text()):
        if not succeeds(["umount", point]):
            run(["umount", "--lazy", point])
    if left := below(folder, MOUNT_TABLE.read_text()):
        raise ClusterError(f"{folder}: still mounted after umount: {', '.join(left)}")
