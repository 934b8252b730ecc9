"""Images: built from a Dockerfile without a daemon, only when something changed, and put where pods look."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from tests.node import access, base, build, cache, context, host, mounts, shell
from tests.node.errors import ClusterError
from tests.node.layout import BIN, CACHE, CONTAINERD_SOCKET, PAUSE_IMAGE, REPOSITORY, ROOT, SOURCES, TAG
from tests.node.lock import held

if TYPE_CHECKING:
    from collections.abc import Sequence

log = logging.getLogger(__name__)

STORE = CACHE / "images" / "store"
INSIDE = Path("/srv")
BUILD_TIMEOUT = 1800.0
IMPORT_TIMEOUT = 300.0


def image(name: str, dockerfile: Path, folder: Path) -> str:
    """Build NAME:dev from a Dockerfile, import it into the cluster and return how pods call it."""
    _deliver(name, built(name, dockerfile, folder).stem)
    return f"{name}:{TAG}"


def built(name: str, dockerfile: Path, folder: Path) -> Path:
    """Build NAME:dev and return its archive; it is imported nowhere."""
    build.install_packages()
    inputs = cache.key(name, base.key(), dockerfile.read_text(), files=context.files(folder), root=folder)
    return _archive(name, _known(name, inputs) or _build(name, inputs, dockerfile, folder))


def reference(name: str) -> str:
    """Return the full name that the container runtime makes of a pod's `image: NAME:dev`."""
    return f"docker.io/library/{name}:{TAG}"


def import_pause() -> None:
    """Import the image of every pod's first container, which no registry has to serve."""
    _import(PAUSE_IMAGE, pause().stem)


def pause() -> Path:
    """Build that image and return its archive."""
    inputs, dockerfile = build.program_key(build.PAUSE), SOURCES / "program" / "pause" / "Dockerfile"
    known = _known(PAUSE_IMAGE, inputs)
    identifier = known or _build(PAUSE_IMAGE, inputs, dockerfile, build.build(build.PAUSE), on_base=False)
    return _archive(PAUSE_IMAGE, identifier)


def _known(name: str, inputs: str) -> str:
    """Return the id of the image that these inputs made, or nothing; no build has to be waited for."""
    record = _record(name)
    known, _, identifier = record.read_text().partition(" ") if record.exists() else ("", "", "")
    if known != inputs or not _archive(name, identifier).exists():
        return ""
    log.info("image %s:%s: unchanged", name, TAG)
    return identifier


def _build(name: str, inputs: str, dockerfile: Path, folder: Path, *, on_base: bool = True) -> str:
    """Build and return the image's id; an archive is written only when the id is a new one."""
    with held("images"):
        base_image = _base_image() if on_base else ""
        identifier = _bud(reference(name), dockerfile, folder, base_image=base_image)
        if not _archive(name, identifier).exists():
            _push(name, identifier)
        _record(name).write_text(f"{inputs} {identifier}")
    return identifier


def foreign(name: str, dockerfile: Path, folder: Path, architecture: str) -> str:
    """Build an image for another architecture and return its name in the store; its programs run here, emulated."""
    target = f"localhost/{name}-{architecture}:{TAG}"
    with held("images"):
        _bud(target, dockerfile, folder, base_image=_base_image(architecture), architecture=architecture)
    return target


def run(image: str, argv: Sequence[str], *, folders: Sequence[Path], timeout: float) -> str:
    """Run a program of an image in the store and return what it printed; it sees the folders below INSIDE.

    Where they are here, perhaps below a home directory, is not for the image's user to read.
    """
    with held("images"):
        container = shell.run(_buildah("from", "--pull-never", image), timeout=timeout).strip()
        volumes = [part for folder in folders for part in ("--volume", f"{folder}:{INSIDE / folder.name}:ro")]
        try:
            command = _buildah("run", "--isolation", "chroot", *volumes, container, "--", *argv)
            return shell.run(command, timeout=timeout)
        finally:
            shell.run(_buildah("rm", container))
            mounts.remove(STORE)


def _base_image(architecture: str = "") -> str:
    """Put the base image into buildah's store and return its name there."""
    name = f"localhost/{base.IMAGE}" + (f"-{architecture}" if architecture else "")
    folder, stamp = base.archive(architecture), STORE / f"base-{base.key(architecture)}"
    if not stamp.exists():
        _bud(name, folder / "Dockerfile", folder, base_image="", architecture=architecture)
        stamp.touch()
    return name


def _record(name: str) -> Path:
    return CACHE / "images" / f"{name}.built"


def _archive(name: str, identifier: str) -> Path:
    return CACHE / "images" / name / f"{identifier}.tar"


def _bud(name: str, dockerfile: Path, folder: Path, *, base_image: str, architecture: str = "") -> str:
    """Build with buildah, which reuses unchanged layers, and return the id of the image."""
    STORE.mkdir(parents=True, exist_ok=True)
    identifier = STORE / "built"
    options = ["--iidfile", str(identifier)]
    options += ["--isolation", "chroot", "--layers", "--format", "docker", "--pull-never"]
    if architecture:
        options += ["--arch", architecture]
    if base_image:
        options += ["--build-arg", f"BASE_IMAGE={base_image}"]
        options += [part for volume in host.volumes() for part in ("--volume", volume)]
    argv = _buildah("bud", *options, "--file", str(dockerfile), "--tag", name, str(folder))
    output = CACHE / "logs" / f"image-{name.rpartition('/')[2].partition(':')[0]}.log"
    try:
        shell.run_long(f"building image {name}", argv, output=output, timeout=BUILD_TIMEOUT, env=os.environ)
    finally:
        mounts.remove(STORE)
    return identifier.read_text().strip().removeprefix("sha256:")


def _push(name: str, identifier: str) -> None:
    """Replace the archives of the image's earlier builds; the new one appears complete or not at all."""
    archive = _archive(name, identifier)
    shutil.rmtree(archive.parent, ignore_errors=True)
    archive.parent.mkdir(parents=True)
    with tempfile.TemporaryDirectory(dir=archive.parent, prefix=".draft-") as folder:
        draft = Path(folder) / "image.tar"
        shell.run(_buildah("push", reference(name), f"docker-archive:{draft}"), timeout=IMPORT_TIMEOUT)
        mounts.remove(STORE)
        draft.rename(archive)


def _buildah(command: str, *arguments: str) -> list[str]:
    return ["buildah", "--root", f"{STORE}/root", "--runroot", f"{STORE}/run", command, *arguments]


def _deliver(name: str, identifier: str) -> None:
    if not access.user_cluster():
        _import(name, identifier)
        return
    copy = REPOSITORY / "build" / "images" / f"{name}.tar"
    copy.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(_archive(name, identifier), copy)
    _give_to_user_cluster(copy)


def _give_to_user_cluster(archive: Path) -> None:
    argv = ["k3s", "ctr", "images", "import", str(archive)]
    if shutil.which("k3s"):
        shell.run(argv, timeout=IMPORT_TIMEOUT)
    else:
        log.info("no k3s on this machine; on the cluster's node run: %s", " ".join(argv))


def _import(name: str, identifier: str) -> None:
    """Import into our containerd, unless it has it: a kubelet whose disk fills up removes images that nobody runs."""
    stamp = ROOT / "images" / name
    if not CONTAINERD_SOCKET.exists():
        raise ClusterError(f"image {name}: built, but there is no node: run `python -m tests.node up`")
    if stamp.exists() and stamp.read_text() == identifier and reference(name) in _ctr("list", "--quiet").split():
        return
    _ctr("import", str(_archive(name, identifier)))
    stamp.parent.mkdir(parents=True, exist_ok=True)
    stamp.write_text(identifier)


def _ctr(*arguments: str) -> str:
    ctr = [str(BIN / "ctr"), "--address", str(CONTAINERD_SOCKET), "--namespace", "k8s.io", "images"]
    return shell.run([*ctr, *arguments], timeout=IMPORT_TIMEOUT)
