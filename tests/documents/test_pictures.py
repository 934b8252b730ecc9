"""Pictures are legible on white and on dark pages, and have alternative text for those who do not see them."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def listed(pattern: str) -> list[str]:
    command = ["git", "ls-files", pattern]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, timeout=60).stdout.split()


@pytest.mark.parametrize("picture", listed("*.svg"))
def test_drawings_are_transparent(picture):
    assert "fill: #ffffff" not in (ROOT / picture).read_text(encoding="utf-8")


def test_every_picture_has_an_alternative_text():
    texts = {document: (ROOT / document).read_text(encoding="utf-8") for document in listed("*.md")}
    assert [document for document, text in texts.items() if re.search(r"!\[\s*\]\(", text)] == []
