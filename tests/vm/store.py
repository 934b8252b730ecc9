"""The machine's container images: containerd's store is filled here, in seconds; in there it would take minutes."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

from tests.node import build, images
from tests.node.errors import ClusterError
from tests.node.layout import REPOSITORY, ROOT
from tests.node.shell import run, succeeds, wait_until

CONFIGURATION = """
version = 3
root = '{store}'
state = '{state}'
disabled_plugins = ['io.containerd.grpc.v1.cri', 'io.containerd.nri.v1.nri']

[grpc]
address = '{socket}'

[plugins.'io.containerd.internal.v1.opt']
path = '{state}/opt'
"""


def fill(root: Path) -> None:
    """Build the images and import them into the store below an unpacked root."""
    archives = [images.built("contextpolicy", REPOSITORY / "operator" / "Dockerfile", REPOSITORY), images.pause()]
    with tempfile.TemporaryDirectory(prefix="vm-") as state:
        _import(archives, root / ROOT.relative_to("/") / "containerd", Path(state))


def _import(archives: list[Path], store: Path, state: Path) -> None:
    store.mkdir(parents=True)
    [programs] = (build.build(program) for program in build.PROGRAMS if program.name == "containerd")
    socket, log = state / "containerd.sock", state / "containerd.log"
    (state / "containerd.toml").write_text(CONFIGURATION.format(store=store, state=state / "run", socket=socket))
    ctr = [str(programs / "ctr"), "--address", str(socket), "--namespace", "k8s.io"]
    argv = [str(programs / "containerd"), "--config", str(state / "containerd.toml")]
    with log.open("w") as said, subprocess.Popen(argv, stdout=said, stderr=said, env=os.environ) as containerd:
        try:
            if not wait_until(lambda: succeeds([*ctr, "version"]), timeout=60):
                raise ClusterError(f"containerd: not ready after 60 s\n{log.read_text()}")
            for archive in archives:
                run([*ctr, "images", "import", str(archive)], timeout=600)
        finally:
            containerd.terminate()
            containerd.wait(30)
