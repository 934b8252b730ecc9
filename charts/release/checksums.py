"""SHA256SUMS, as sha256sum writes and checks it: who trusts this file trusts all that it lists."""

from __future__ import annotations

import hashlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

FILE = "SHA256SUMS"


def write(folder: Path) -> Path:
    """List a folder's files."""
    target = folder / FILE
    files = sorted(path for path in folder.iterdir() if path.is_file())
    target.write_text("".join(f"{digest(file)}  {file.name}\n" for file in files))
    return target


def digest(file: Path) -> str:
    """Return a file's SHA-256."""
    with file.open("rb") as content:
        return hashlib.file_digest(content, "sha256").hexdigest()
