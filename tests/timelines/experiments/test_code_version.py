"""Which code a run is of: that of the last commit that changed it, not that of the last one of data."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from timelines.experiments.code_version import REPORTING, UNKNOWN, code_version

EXPERIMENTS = Path(__file__).parents[3] / "timelines" / "experiments"


def git(folder, *words):
    who = ("-c", "user.name=a", "-c", "user.email=a@example.org")
    return subprocess.run(["git", "-C", str(folder), *who, *words], capture_output=True, text=True, check=True).stdout


def write(folder, name, text):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture
def checkout(tmp_path):
    git(tmp_path, "init", "-q")
    write(tmp_path, "operator/plan.py", "1")
    write(tmp_path, "timelines/run.py", "1")
    git(tmp_path, "add", ".")
    git(tmp_path, "commit", "-qm", "Plan")
    return tmp_path


def test_data_and_documents_are_not_code(checkout):
    before = code_version(checkout)
    assert before == git(checkout, "log", "-1", "--format=%h").strip()
    write(checkout, "timelines/results/data/frozen.json", "{}")
    write(checkout, "docs/index.md", "Read.")
    for name in REPORTING:
        write(checkout, f"timelines/experiments/{name}", "1")
    git(checkout, "add", ".")
    git(checkout, "commit", "-qm", "Keep a block")
    write(checkout, "timelines/results/data/frozen.json", "[]")
    assert code_version(checkout) == before
    write(checkout, "timelines/run.py", "2")
    git(checkout, "commit", "-qam", "Run otherwise")
    assert code_version(checkout) == git(checkout, "log", "-1", "--format=%h").strip() != before


def test_the_report_is_made_of_files_that_there_are():
    assert all((EXPERIMENTS / name).is_file() for name in REPORTING)


def test_nothing_that_runs_imports_what_only_reports():
    """Else a change of it would change runs, and not show in their version."""
    names = "|".join(name.removesuffix(".py") for name in REPORTING)
    uses = re.compile(rf"^\s*from timelines\.experiments(\.({names}) import| import .*\b({names})\b)", re.MULTILINE)
    found = {path.name for path in EXPERIMENTS.glob("*.py") if uses.search(path.read_text(encoding="utf-8"))}
    assert found - set(REPORTING) == {"__main__.py"}  # which writes the report at the end


def test_what_is_not_committed_shows(checkout):
    clean = code_version(checkout)
    write(checkout, "operator/more.py", "1")
    assert code_version(checkout) == f"{clean} and changes"


def test_without_history_the_code_is_unknown(tmp_path):
    assert code_version(tmp_path / "nowhere") == UNKNOWN
