"""Results that cost minutes, kept by a hash of all that went into them."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable


def key(*inputs: object, files: Iterable[Path] = (), root: Path = Path()) -> str:
    """Return a short hash of plain values and of files: their place below root, their mode and content."""
    digest = hashlib.sha256(json.dumps(inputs, sort_keys=True).encode())
    for file in sorted(files):
        content = hashlib.sha256(file.read_bytes()).hexdigest()
        digest.update(f"{file.relative_to(root)}\0{file.stat().st_mode:o}\0{content}\n".encode())
    return digest.hexdigest()[:16]


def source_files(folder: Path) -> list[Path]:
    """List a folder's files; in a git work tree without those that git ignores."""
    listing = ["git", "-C", str(folder), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    done = subprocess.run(listing, capture_output=True, text=True, timeout=60, check=False)
    if done.returncode:
        return [path for path in folder.rglob("*") if path.is_file()]
    paths = {folder / name for name in done.stdout.split("\0") if name}
    return [path for path in paths if path.is_file()]


def folder(target: Path, fill: Callable[[Path], None]) -> Path:
    """Return the target folder, filled at most once: it appears complete or not at all."""
    if target.exists():
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=".draft-", dir=target.parent))
    try:
        fill(draft)
        draft.chmod(0o755)
        _settle(draft, target)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return target


def _settle(draft: Path, target: Path) -> None:
    """Move the draft to its place, unless another run was faster with the same."""
    try:
        draft.rename(target)
    except OSError:
        if not target.exists():
            raise
