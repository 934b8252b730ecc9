"""Images: built from a Dockerfile without a daemon, skipped when nothing changed, and put where pods find them."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from pathlib import Path

from tests.cluster import access, base, build, cache, host, mounts, shell
from tests.cluster.errors import ClusterError
from tests.cluster.layout import BIN, CACHE, CONTAINERD_SOCKET, PAUSE_IMAGE, REPOSITORY, ROOT, SOURCES, TAG
from tests.cluster.lock import held

log = logging.getLogger(__name__)

STORE = CACHE / "images" / "store"
BUILD_TIMEOUT = 1800.0
IMPORT_TIMEOUT = 300.0


def image(name: str, dockerfile: Path, context: Path) -> str:
    """Build NAME:dev from a Dockerfile, import it into the cluster and return how pods call it."""
    build.install_packages()
    with held("images"):
        base_image = _base_image()
        inputs = cache.key(name, base.key(), dockerfile.read_text(), files=cache.source_files(context), root=context)
        archive = _archive(name, inputs, dockerfile, context, base_image)
        _deliver(name, inputs, archive)
    return f"{name}:{TAG}"


def import_pause() -> None:
    """Import the image of every pod's first container, which no registry has to serve."""
    with held("images"):
        program = next(one for one in build.PROGRAMS if one.name == "pause")
        context, dockerfile = build.build(program), SOURCES / "node" / "pause" / "Dockerfile"
        inputs = cache.key(build.program_key(program))
        _import(PAUSE_IMAGE, inputs, _archive(PAUSE_IMAGE, inputs, dockerfile, context, base_image=""))


def _base_image() -> str:
    """Put the base image into buildah's store and return its name there."""
    name = f"localhost/{base.IMAGE}"
    folder, stamp = base.archive(), STORE / f"base-{base.key()}"
    if not stamp.exists():
        _bud(name, folder / "Dockerfile", folder, base_image="")
        stamp.touch()
    return name


def _archive(name: str, inputs: str, dockerfile: Path, context: Path, base_image: str) -> Path:
    """Return the built image as a docker-archive; older archives of the same name are dropped."""
    archive = CACHE / "images" / f"{name}-{inputs}.tar"
    if archive.exists():
        log.info("image %s:%s: unchanged", name, TAG)
        return archive
    _bud(f"localhost/{name}:{TAG}", dockerfile, context, base_image=base_image)
    for old in archive.parent.glob(f"{name}-{'?' * len(inputs)}.tar"):
        old.unlink()
    _push(name, archive)
    return archive


def _bud(name: str, dockerfile: Path, context: Path, *, base_image: str) -> None:
    options = ["--isolation", "chroot", "--layers", "--format", "docker", "--pull-never"]
    if base_image:
        options += ["--build-arg", f"BASE_IMAGE={base_image}"]
        options += [part for volume in host.volumes() for part in ("--volume", volume)]
    argv = _buildah("bud", *options, "--file", str(dockerfile), "--tag", name, str(context))
    output = CACHE / "logs" / f"image-{name.rpartition('/')[2]}.log"
    try:
        shell.run_long(f"building image {name}", argv, output=output, timeout=BUILD_TIMEOUT, env=os.environ)
    finally:
        mounts.remove(STORE)


def _push(name: str, archive: Path) -> None:
    """Write the archive beside its place and move it there: it is complete or absent."""
    with tempfile.TemporaryDirectory(dir=archive.parent, prefix=".draft-") as folder:
        draft = Path(folder) / "image.tar"
        target = f"docker-archive:{draft}:docker.io/library/{name}:{TAG}"
        shell.run(_buildah("push", f"localhost/{name}:{TAG}", target), timeout=IMPORT_TIMEOUT)
        mounts.remove(STORE)
        draft.rename(archive)


def _buildah(command: str, *arguments: str) -> list[str]:
    STORE.mkdir(parents=True, exist_ok=True)
    return ["buildah", "--root", f"{STORE}/root", "--runroot", f"{STORE}/run", command, *arguments]


def _deliver(name: str, inputs: str, archive: Path) -> None:
    if not access.user_cluster():
        _import(name, inputs, archive)
        return
    copy = REPOSITORY / "build" / "images" / f"{name}.tar"
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(archive, copy)
    _give_to_user_cluster(copy)


def _give_to_user_cluster(archive: Path) -> None:
    argv = ["k3s", "ctr", "images", "import", str(archive)]
    if shutil.which("k3s"):
        shell.run(argv, timeout=IMPORT_TIMEOUT)
    else:
        log.info("no k3s on this machine; on the cluster's node run: %s", " ".join(argv))


def _import(name: str, inputs: str, archive: Path) -> None:
    """Import into our containerd; the stamp lives and dies with containerd's state."""
    stamp = ROOT / "images" / name
    if stamp.exists() and stamp.read_text() == inputs:
        return
    if not CONTAINERD_SOCKET.exists():
        raise ClusterError(f"image {name}: built, but the node is not up: run `python -m tests.cluster up` first")
    ctr = [str(BIN / "ctr"), "--address", str(CONTAINERD_SOCKET), "--namespace", "k8s.io"]
    shell.run([*ctr, "images", "import", "--local", str(archive)], timeout=IMPORT_TIMEOUT)
    stamp.parent.mkdir(parents=True, exist_ok=True)
    stamp.write_text(inputs)
