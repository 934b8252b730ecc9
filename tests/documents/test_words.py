"""Words that our documents and messages do without, because readers search for others."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
AVOIDED = re.compile(r"\b(told|tells|whoever|anew|mended|dear)\b", re.IGNORECASE)
"""Instead: reported, shows, anyone who, again, fixed, expensive."""
DOCUMENTS = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
).stdout.split()
SOURCES = [
    *(ROOT / "operator" / "contextpolicy").rglob("*.py"),
    *(ROOT / "timelines").rglob("*.py"),
    *(path for path in (ROOT / "modules").rglob("*.py") if path.name != "corpus.py"),  # sentences to train on
]


@pytest.mark.parametrize("document", DOCUMENTS)
def test_documents(document):
    lines = (ROOT / document).read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if AVOIDED.search(line)] == []


@pytest.mark.parametrize("path", SOURCES, ids=[str(path.relative_to(ROOT)) for path in SOURCES])
def test_messages_and_docstrings(path):
    """The names of variables are nobody's business but the code's."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    texts = [node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    assert [text for text in texts if AVOIDED.search(text)] == []


def test_names_of_tests():
    """A name states behaviour, so it needs none of these, nor 'makes no sense' where invalid says it."""
    avoided = re.compile(r"def test_(\w*_)?(told|tells|whoever|anew|make[s]?_no_sense)(_|\b)")
    files = [path for path in (ROOT / "tests").rglob("test_*.py") if path != Path(__file__)]
    assert [
        line for path in files for line in path.read_text(encoding="utf-8").splitlines() if avoided.search(line)
    ] == []
