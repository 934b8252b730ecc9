"""What goes into the operator's image: locked, hashed, and what pyproject.toml asks for."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[2]
LOCK = (ROOT / "operator" / "requirements.txt").read_text(encoding="utf-8")
ENTRIES = LOCK.replace("\\\n", "").splitlines()
WANTED = [
    Requirement(text)
    for text in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
]


@pytest.mark.parametrize("wanted", WANTED, ids=lambda wanted: wanted.name)
def test_a_dependency_is_locked_at_an_allowed_version(wanted):
    locked = dict(re.findall(r"^([a-z0-9-]+)==([^ ;]+)", LOCK, flags=re.MULTILINE))
    assert wanted.specifier.contains(locked[canonicalize_name(wanted.name)]), "make lock"


def test_every_entry_is_one_version_with_hashes():
    assert [entry for entry in ENTRIES if not re.match(r"[a-z0-9-]+==[^ ]+ .*--hash=sha256:[0-9a-f]{64}", entry)] == []


def test_lock_file_contains_no_urls():
    assert "://" not in LOCK
