"""The chart as a package. Helm keeps the files' times, which are the commit's: the package is always the same."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.node import build
from tests.node.shell import run

if TYPE_CHECKING:
    from pathlib import Path

    from charts.release.source import Commit


def package(commit: Commit, folder: Path) -> Path:
    """Package the operator's chart under the commit's version."""
    chart, version = commit.folder / "charts" / "contextpolicy", commit.version
    helm = str(build.build(build.HELM) / "helm")
    run([helm, "package", str(chart), "--version", version, "--app-version", version, "--destination", str(folder)])
    return folder / f"contextpolicy-{version}.tgz"
