"""Every file of expectations holds for its policy, by the command in its first lines."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from contextpolicy.cli import main

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "config/expectations").glob("*.yaml"))


def command(path):
    text = path.read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("# contextpolicy simulate"))
    return shlex.split(line.removeprefix("# contextpolicy").replace("<this file>", str(path)))


def test_expectation_files_are_found():
    assert {"delivery-robot", "hot-node", "starving-node"} <= {path.stem for path in FILES}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_policy_does_what_is_expected(path, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    assert main(command(path)) == 0, capsys.readouterr().err
    assert capsys.readouterr().err.rstrip().endswith("as expected")
