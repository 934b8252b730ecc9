"""The version stands in one place, and copies of it are found."""

from __future__ import annotations

import datetime as dt
import shutil

import pytest

from charts.release import source, version
from tests.node.layout import REPOSITORY

DATE = dt.date(2027, 1, 31)
CHANGELOG = "# Changelog\n\n## Unreleased\n\n### Added\n\n- New.\n\n## 0.1.0 - 2026-12-01\n\n### Added\n\n- Old.\n"


@pytest.fixture
def tree(tmp_path):
    for place in version.PLACES:
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(REPOSITORY / place, tmp_path / place)
    (tmp_path / "CHANGELOG.md").write_text(CHANGELOG)
    return tmp_path


def test_every_file_has_the_same_version():
    found = version.versions(REPOSITORY)
    assert [place for place, mentions in found.items() if not mentions] == []
    assert {mention for mentions in found.values() for mention in mentions} == set(found["pyproject.toml"])


def test_new_version_is_written_to_every_file(tree):
    version.change(tree, "0.2.0-rc.1", DATE)
    assert {mention for mentions in version.versions(tree).values() for mention in mentions} == {"0.2.0-rc.1"}
    assert [len(mentions) for mentions in version.versions(tree).values()] == [
        len(mentions) for mentions in version.versions(REPOSITORY).values()
    ]


def test_unreleased_changes_become_the_versions_section(tree):
    version.change(tree, "0.2.0", DATE)
    changelog = (tree / "CHANGELOG.md").read_text()
    assert "## Unreleased\n\n## 0.2.0 - 2027-01-31\n\n### Added\n\n- New.\n" in changelog
    assert source.notes(changelog, "0.2.0") == "# contextpolicy 0.2.0\n\n### Added\n\n- New.\n"


@pytest.mark.parametrize(("wanted", "expected"), [("0.1.0", "- Old."), ("0.3.0", "- New.")])
def test_notes_fall_back_to_unreleased_changes(wanted, expected):
    assert source.notes(CHANGELOG, wanted) == f"# contextpolicy {wanted}\n\n### Added\n\n{expected}\n"
