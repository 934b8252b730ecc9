"""What the machine gets besides its system: this repository, the node's programs, Python packages and images."""

from __future__ import annotations

import os
import shutil
import sys
import tomllib
from typing import TYPE_CHECKING

from tests.node import build, cache
from tests.node.layout import BIN, CACHE, CGROUP_DRIVER_VARIABLE, REPOSITORY, SOURCES
from tests.node.shell import run, run_long
from tests.vm import chart, store
from tests.vm.places import INSIDE_CHART, INSIDE_LOGS, INSIDE_PACKAGES, INSIDE_REPOSITORY, SYSTEMS, TESTS_VARIABLE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

UNITS = SOURCES.parent / "vm" / "units"
LOCKED = REPOSITORY / "operator" / "requirements.txt"
PYTHON = "3.11"  # Debian 12's
PLATFORMS = ("manylinux_2_28_x86_64", "manylinux2014_x86_64", "manylinux_2_34_x86_64")
MODULES = ("br_netfilter",)
"""Kernel modules that k3s loads when it starts; other kernels have this one built in.

Without it the answer of a pod that was called at a service's address misses what gives it that address back, if both
pods are on one node.
"""
SLOWNESS = 10
"""How many times longer the machine may take than a computer without emulation."""
PIP_TIMEOUT = 900.0
SWAP, SWAP_BYTES = "swapfile", 64 << 20
"""Swap space, as robots with little memory have it; Burstable pods may use theirs."""


def write(root: Path, tests: Sequence[str]) -> None:
    """Put everything into an unpacked root; `tests` are those to run, all if none is named."""
    _repository(root)
    shutil.copytree(_packages(), _below(root, INSIDE_PACKAGES))
    _programs(root)
    store.fill(root)
    _chart(root)
    _settings(root, tests)
    _swap(root / SWAP)


def _below(root: Path, inside: Path) -> Path:
    return root / inside.relative_to("/")


def _repository(root: Path) -> None:
    for source in cache.source_files(REPOSITORY):
        target = _below(root, INSIDE_REPOSITORY) / source.relative_to(REPOSITORY)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target)


def _packages() -> Path:
    """Return the folder with what the operator's image has, and pytest."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    pytest = next(one for one in project["optional-dependencies"]["dev"] if one.startswith("pytest"))
    key = cache.key(PYTHON, PLATFORMS, pytest, LOCKED.read_text())
    return cache.folder(SYSTEMS / f"packages-{key}", lambda out: _install(out, pytest))


def _install(folder: Path, pytest: str) -> None:
    wheels = ["--only-binary=:all:", "--python-version", PYTHON]
    wheels += [part for platform in PLATFORMS for part in ("--platform", platform)]
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-deps",
        "--upgrade",
        "--target",
        str(folder),
        *wheels,
    ]
    log = CACHE / "logs" / "vm-packages.log"
    locked = [*pip, "--require-hashes", "--requirement", str(LOCKED)]
    run_long("fetching the machine's Python packages", locked, output=log, timeout=PIP_TIMEOUT, env=os.environ)
    more = [*pip, pytest, "iniconfig", "packaging", "pluggy"]
    run_long("fetching pytest", more, output=log, timeout=PIP_TIMEOUT, env=os.environ)


def _programs(root: Path) -> None:
    build.build_all()
    folder = _below(root, BIN)
    for program in build.PROGRAMS:
        shutil.copytree(build.build(program), folder, dirs_exist_ok=True)
    (folder / "kubectl").symlink_to("node")


def _chart(root: Path) -> None:
    [helm] = (build.build(program) for program in build.PROGRAMS if program.name == "helm")
    _below(root, INSIDE_CHART).write_text(chart.rendered(str(helm / "helm")))


def _settings(root: Path, tests: Sequence[str]) -> None:
    etc = root / "etc"
    (etc / "fstab").write_text(f"LABEL=root / ext4 defaults,noatime 0 1\n/{SWAP} none swap sw 0 0\n")
    (etc / "hostname").write_text("robot\n")
    (etc / "modules-load.d" / "node.conf").write_text("".join(f"{module}\n" for module in MODULES))
    (etc / "contextpolicy-vm").write_text("".join(f"{name}={value}\n" for name, value in environment(tests).items()))
    for unit in UNITS.iterdir():
        shutil.copy(unit, etc / "systemd" / "system")
    wanted = etc / "systemd" / "system" / "multi-user.target.wants"
    wanted.mkdir(exist_ok=True)
    for name in ("contextpolicy-node.service", "contextpolicy-tests.service"):
        (wanted / name).symlink_to(f"/etc/systemd/system/{name}")
    _below(root, INSIDE_LOGS).mkdir()
    (root / "var" / "log" / "journal").mkdir(exist_ok=True)  # makes the journal outlive the machine's reboot


def _swap(file: Path) -> None:
    """Without holes, which an ext4 that is made of a folder would make of zeros, and the kernel refuses."""
    file.write_bytes(b"\xff" * SWAP_BYTES)
    file.chmod(0o600)
    run(["mkswap", "--quiet", str(file)])


def environment(tests: Sequence[str] = ()) -> dict[str, str]:
    """Return what the machine's services find in their environment."""
    path = (INSIDE_REPOSITORY, INSIDE_REPOSITORY / "operator", INSIDE_PACKAGES)
    return {
        "CONTEXTPOLICY_NODE_PATIENCE": str(SLOWNESS),
        CGROUP_DRIVER_VARIABLE: "systemd",
        "HOME": "/root",
        "PATH": f"{BIN}:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin",
        "PYTHONPATH": os.pathsep.join(map(str, path)),
        "PYTHONUNBUFFERED": "1",
        TESTS_VARIABLE: " ".join(tests),
    }
