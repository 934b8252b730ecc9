"""Which files of a build context count: those that git knows or would, less those that .dockerignore names."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tests.node import cache

if TYPE_CHECKING:
    from pathlib import Path

GLOBS = {"**/": "(?:.*/)?", "**": ".*", "*": "[^/]*", "?": "[^/]"}


def files(folder: Path) -> list[Path]:
    ignore = folder / ".dockerignore"
    rules = ignore.read_text().splitlines() if ignore.exists() else []
    found = cache.source_files(folder)
    return [path for path in found if not ignored(str(path.relative_to(folder)), rules)]


def ignored(path: str, rules: list[str]) -> bool:
    """Apply the rules in order: the last one that matches the path or a folder above it decides."""
    verdict = False
    for rule in filter(None, map(str.strip, rules)):
        exception = rule.startswith("!")
        if not rule.startswith("#") and _matches(path, rule.removeprefix("!").strip("/")):
            verdict = not exception
    return verdict


def _matches(path: str, pattern: str) -> bool:
    parts = re.split(r"(\*\*/|\*\*|\*|\?)", pattern)
    expression = "".join(GLOBS.get(part) or re.escape(part) for part in parts)
    return re.fullmatch(rf"{expression}(?:/.*)?", path) is not None
