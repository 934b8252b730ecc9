"""What is released: the files of a commit, its version and its notes. A dirty work tree changes nothing."""

from __future__ import annotations

import io
import re
import subprocess
import tarfile
import tempfile
import tomllib
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tests.node.layout import REPOSITORY
from tests.node.shell import run

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass(frozen=True)
class Commit:
    """A commit's files in a folder; `epoch` is when it was committed, the only time that a release knows."""

    identifier: str
    epoch: int
    folder: Path

    @property
    def version(self) -> str:
        """The version, which pyproject.toml has for everybody."""
        project = tomllib.loads((self.folder / "pyproject.toml").read_text())["project"]
        return str(project["version"])

    def notes(self) -> str:
        """The version's section of the changelog."""
        return notes((self.folder / "CHANGELOG.md").read_text(), self.version)


@contextmanager
def exported() -> Iterator[Commit]:
    """Give the last commit's files in a folder that lasts as long as they are needed."""
    git = ("git", "-C", str(REPOSITORY))
    identifier, epoch = run([*git, "log", "-1", "--format=%H %ct"]).split()
    archive = subprocess.run([*git, "archive", identifier], capture_output=True, timeout=60, check=True).stdout
    with tempfile.TemporaryDirectory(prefix="contextpolicy-release-") as folder:
        with tarfile.open(fileobj=io.BytesIO(archive)) as tar:
            tar.extractall(folder, filter="data")
        yield Commit(identifier, int(epoch), Path(folder))


def notes(changelog: str, version: str) -> str:
    """Return a version's section of a changelog; before the version has one, that of what is unreleased."""
    sections: dict[str, str] = dict(
        re.findall(r"^## \[?([^\s\]]+).*?\n(.*?)(?=^## |\Z)", changelog, re.MULTILINE | re.DOTALL)
    )
    text = sections.get(version, sections.get("Unreleased", "")).strip()
    return f"# contextpolicy {version}\n\n{text}\n"
