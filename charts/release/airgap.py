"""One archive for robots without a network: image, chart, and the command that installs both."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

from charts.release import archives, checksums

if TYPE_CHECKING:
    from charts.release.source import Commit

SCRIPTS = Path(__file__).parent / "offline"


def pack(commit: Commit, folder: Path, image: Path, package: Path) -> Path:
    """Put everything into one archive, whose folder has the archive's name."""
    name = f"contextpolicy-{commit.version}-airgap"
    content = folder / name
    content.mkdir()
    for file in (image, package, *sorted(SCRIPTS.iterdir())):
        shutil.copy2(file, content)
    checksums.write(content)
    return archives.tar(content, folder / f"{name}.tar", commit.epoch, prefix=name)
