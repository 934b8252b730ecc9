"""A private Docker: Debian's docker.io, unpacked but not installed, with one container that does nothing."""

from __future__ import annotations

import os
import shutil
import subprocess
import tarfile
import tempfile
from pathlib import Path
from typing import Self

from tests.node import build, cache, cgroups, shell
from tests.node.errors import ClusterError
from tests.node.layout import CACHE
from timelines.demo.cgroup import Cgroup

PACKAGES = ("docker.io", "containerd", "runc", "tini")
PATIENCE = 20.0


class DockerError(Exception):
    """docker.io does not run here; the message says why."""


class Docker:
    """Runs from `with` to its end, and leaves nothing behind but the unpacked programs."""

    def __init__(self) -> None:
        self._path = _programs()
        self._folder = Path(tempfile.mkdtemp(prefix="bench-docker-"))
        self._parent = f"/{self._folder.name}"
        self.socket = self._folder / "docker.sock"
        self._daemon: subprocess.Popen[bytes] | None = None
        self.container = ""

    def __enter__(self) -> Self:
        try:
            self._start()
            self.container = self._run_container()
        except (ClusterError, OSError) as error:
            self.__exit__()
            raise DockerError(str(error)) from error
        return self

    def __exit__(self, *_: object) -> None:
        if self._daemon is not None and self._daemon.poll() is None:
            if self.container:
                self.command("rm", "--force", self.container)
            self._daemon.terminate()
            try:
                self._daemon.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._daemon.kill()
                self._daemon.wait(PATIENCE)
        shutil.rmtree(self._folder, ignore_errors=True)
        for hierarchy in (cgroups.MOUNT, *cgroups.MOUNT.iterdir()):
            _remove_group(hierarchy / self._folder.name)

    def command(self, *arguments: str) -> str:
        """Run the docker command; what it printed."""
        return shell.run(self.argv(*arguments), timeout=PATIENCE, env=self._environment()).strip()

    def argv(self, *arguments: str) -> list[str]:
        """The command line."""
        return [str(self._path[-1] / "docker"), "--host", f"unix://{self.socket}", *arguments]

    def group(self) -> Cgroup:
        """The container's cgroup."""
        folder = cgroups.MOUNT / "cpu" / self._folder.name / self.container
        if folder.is_dir():
            return Cgroup(folder / "cpu.cfs_quota_us", folder / "cpu.cfs_period_us", folder / "cpu.stat")
        folder = cgroups.MOUNT / self._folder.name / self.container
        return Cgroup(folder / "cpu.max", None, folder / "cpu.stat")

    def _start(self) -> None:
        own = {"data-root": "data", "exec-root": "exec", "pidfile": "docker.pid"}
        options = [f"--{name}={self._folder / path}" for name, path in own.items()]
        options += [f"--host=unix://{self.socket}", "--storage-driver=vfs", "--bridge=none", "--iptables=false"]
        options += ["--ip-forward=false", "--exec-opt=native.cgroupdriver=cgroupfs", f"--cgroup-parent={self._parent}"]
        log = (self._folder / "log").open("wb")
        self._daemon = subprocess.Popen(
            [str(self._path[0] / "dockerd"), *options],
            stdout=log,
            stderr=log,
            stdin=subprocess.DEVNULL,
            env=self._environment(),
            start_new_session=True,
        )
        log.close()
        ready = shell.wait_until(lambda: self._daemon_ended() or shell.succeeds(self.argv("version")), timeout=PATIENCE)
        if not ready or self._daemon_ended():
            raise DockerError(f"dockerd does not run: {shell.tail(self._folder / 'log', lines=3)}")

    def _daemon_ended(self) -> bool:
        return self._daemon is not None and self._daemon.poll() is not None

    def _run_container(self) -> str:
        archive = self._folder / "image.tar"
        with tarfile.open(archive, "w") as tar:
            tar.add(build.build(build.PAUSE) / "pause", "pause")
        self.command("import", "--change", 'CMD ["/pause"]', str(archive), "bench")
        return self.command("run", "--detach", "--network=none", "--cpus=0.5", "bench").splitlines()[-1]

    def _environment(self) -> dict[str, str]:
        path = os.pathsep.join([*map(str, self._path), build.path_with_binaries()])
        return {**os.environ, "PATH": path, "DOCKER_CONFIG": str(self._folder)}


def _programs() -> tuple[Path, Path]:
    """The folders of the programs. Unpacked, no service starts and the host's own containerd and runc stay."""

    def unpack(folder: Path) -> None:
        with tempfile.TemporaryDirectory() as packages:
            argv = ["sh", "-ec", 'cd "$1"; shift; apt-get download "$@"', "sh", packages, *PACKAGES]
            shell.run([*_outside(), *argv], timeout=300)
            for package in Path(packages).glob("*.deb"):
                shell.run(["dpkg-deb", "--extract", str(package), str(folder)])

    try:
        root = cache.folder(CACHE / "bin" / f"docker-{cache.key(PACKAGES)}", unpack)
    except ClusterError as error:
        raise DockerError(str(error)) from error
    return root / "usr/sbin", root / "usr/bin"


def _outside() -> list[str]:
    """How to run a command in the network that we were started from: the node's own reaches no package archive."""
    own, pid = Path("/proc/self/ns/net").readlink(), os.getppid()
    while pid > 1:
        network = Path(f"/proc/{pid}/ns/net")
        if network.readlink() != own:
            return ["nsenter", f"--net={network}", "--"]
        pid = int(Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[1])
    return []


def _remove_group(folder: Path) -> None:
    if folder.is_dir():
        for child in folder.iterdir():
            if child.is_dir():
                child.rmdir()
        folder.rmdir()
