"""Archives that depend on nothing but the files in them."""

from __future__ import annotations

import shutil
import tarfile
from contextlib import nullcontext
from pathlib import Path


def tar(folder: Path, target: Path, epoch: int, *, prefix: str = "") -> Path:
    """Pack a folder, which then goes away: sorted, owned by root, all of one time."""
    with tarfile.open(target, "w", format=tarfile.PAX_FORMAT) as archive:
        for path in sorted(folder.rglob("*")):
            member = archive.gettarinfo(path, str(Path(prefix) / path.relative_to(folder)))
            member.uid = member.gid = 0
            member.uname = member.gname = "root"
            member.mode = 0o755 if member.isdir() or member.mode & 0o100 else 0o644
            member.mtime = epoch
            with path.open("rb") if member.isfile() else nullcontext() as content:
                archive.addfile(member, content)
    shutil.rmtree(folder)
    return target
