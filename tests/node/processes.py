"""The node's processes: each is started detached and known by its id and start time, never by its name."""

from __future__ import annotations

import os
import signal
from pathlib import Path

from tests.node import cgroups
from tests.node.build import path_with_binaries
from tests.node.errors import ClusterError
from tests.node.layout import CONTAINERD_SOCKET, LOGS, RUN
from tests.node.network import inside
from tests.node.shell import run, succeeds, tail, wait_until

TERM_PATIENCE = 5.0
KILL_PATIENCE = 10.0
PIDS = RUN / "pids"
# The shell puts itself into the components' cgroup, so that no moment passes outside of it.
LAUNCH = 'echo $$ > "$1/cgroup.procs"; log=$2; shift 2; setsid "$@" >>"$log" 2>&1 </dev/null & echo $!'


def start(name: str, argv: tuple[str, ...]) -> None:
    PIDS.mkdir(parents=True, exist_ok=True)
    LOGS.mkdir(parents=True, exist_ok=True)
    arguments = [str(cgroups.components_folder()), str(LOGS / f"{name}.log"), *inside(argv)]
    env = {**os.environ, "PATH": path_with_binaries()}
    pid = int(run(["sh", "-c", LAUNCH, "sh", *arguments], env=env))
    (PIDS / name).write_text(f"{pid} {start_time(pid)}")


def await_ready(name: str, probe: tuple[str, ...], *, patience: float) -> None:
    """Wait until the probe succeeds; a component that ended is not waited for."""
    ready = wait_until(lambda: alive(name) is None or succeeds(inside(probe)), timeout=patience)
    if alive(name) is None or not ready:
        state = f"not ready after {patience:.0f} s" if alive(name) else "ended while it started"
        file = LOGS / f"{name}.log"
        raise ClusterError(f"{name}: {state}, the end of {file}:\n{tail(file)}")


def alive(name: str) -> int | None:
    """Return the component's process id while it runs."""
    file = PIDS / name
    if not file.exists():
        return None
    pid, started = file.read_text().split()
    return int(pid) if start_time(int(pid)) == started else None


def started() -> list[str]:
    """Return the components that were started and not stopped, whatever the environment says now."""
    return sorted(file.name for file in PIDS.iterdir()) if PIDS.exists() else []


def start_time(pid: int) -> str | None:
    """Return when the process started, in ticks since boot: with the id it names a process for good."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return None
    return None if fields[0] in "ZX" else fields[19]


def stop(name: str) -> None:
    """End a component: it is asked first and killed when it takes too long, as the API server likes to."""
    pid = alive(name)
    if pid is not None:
        _signal(pid, signal.SIGTERM)
        if not wait_until(lambda: alive(name) is None, timeout=TERM_PATIENCE):
            kill({pid})
    (PIDS / name).unlink(missing_ok=True)


def kill(pids: set[int]) -> None:
    born = {pid: start_time(pid) for pid in pids}
    for pid in pids:
        _signal(pid, signal.SIGKILL)
    if not wait_until(lambda: not _left(born), timeout=KILL_PATIENCE):
        raise ClusterError(f"processes {sorted(_left(born))} outlived SIGKILL by {KILL_PATIENCE:.0f} s")


def _left(born: dict[int, str | None]) -> set[int]:
    return {pid for pid, started in born.items() if started and start_time(pid) == started}


def _signal(pid: int, number: signal.Signals) -> None:
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return  # it ended by itself in the meantime


def shims() -> set[int]:
    """Find the processes that hold our containers: they name our containerd's socket as their address."""
    return {int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit() and _is_shim(entry)}


def _is_shim(entry: Path) -> bool:
    try:
        words = (entry / "cmdline").read_text(errors="replace").split("\0")
    except OSError:
        return False
    return "containerd-shim" in words[0] and str(CONTAINERD_SOCKET) in words
