"""What the documents and messages ask users to install exists."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
OURS = re.compile(r"pip3? install [^\n`]*\bcontextpolicy\b")
TEXTS = [
    path
    for folder in ("operator", "docs", "modules", "timelines", "config", "charts", "crds")
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".py", ".md", ".yaml", ".txt")
] + sorted(ROOT.glob("*.md"))


def test_no_document_installs_an_unpublished_package():
    """Somebody who registers the name could run code on users' machines."""
    asked = {str(path.relative_to(ROOT)) for path in TEXTS if OURS.search(path.read_text(encoding="utf-8"))}
    assert TEXTS
    assert asked == set()
