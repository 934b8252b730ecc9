"""The version: pyproject.toml has it, and `python -m charts.release.version X.Y.Z` updates its copies."""

from __future__ import annotations

import datetime as dt
import re
import sys
from typing import TYPE_CHECKING

from tests.node.layout import REPOSITORY

if TYPE_CHECKING:
    from pathlib import Path

FORM = r"\d+\.\d+\.\d+(?:-[0-9A-Za-z.-]+)?"
PROJECT, CHART, TAG = rf'^version = "({FORM})"$', rf"^(?:version|appVersion): ({FORM})$", rf"\bv({FORM})$"
PLACES = {
    "pyproject.toml": PROJECT,
    "modules/robotkit/pyproject.toml": PROJECT,
    "charts/contextpolicy/Chart.yaml": CHART,
    "charts/robot/Chart.yaml": CHART,
    "config/gitops/argocd/applications.yaml": TAG,
    "config/gitops/flux/operator.yaml": TAG,
    "config/ros2-node/node.yaml": rf"contextpolicy-host:({FORM})",
    "docs/how-to/install.md": rf"contextpolicy:({FORM})",
    "docs/tutorials/pods.yaml": rf"contextpolicy:({FORM})",
}
"""Which files have the version, and how to find it there."""
UNRELEASED = "## Unreleased\n"


def versions(root: Path) -> dict[str, list[str]]:
    """Return every mention of the version, by file."""
    return {place: re.findall(form, (root / place).read_text(), re.MULTILINE) for place, form in PLACES.items()}


def change(root: Path, version: str, date: dt.date) -> None:
    """Write a version to every place, and make what is unreleased its section of the changelog."""
    for place, form in PLACES.items():
        text = (root / place).read_text()
        (root / place).write_text(re.sub(form, lambda found: _with(found, version), text, flags=re.MULTILINE))
    changelog = root / "CHANGELOG.md"
    section = f"{UNRELEASED}\n## {version} - {date.isoformat()}\n"
    changelog.write_text(changelog.read_text().replace(UNRELEASED, section, 1))


def _with(found: re.Match[str], version: str) -> str:
    return found[0].replace(found[1], version)


def main() -> int:
    """Change the version of this work tree."""
    version = sys.argv[1] if len(sys.argv) == 2 else ""
    if not re.fullmatch(FORM, version):
        sys.stderr.write(f"error: invalid value {version!r}: expected a version such as 0.2.0 or 0.2.0-rc.1\n")
        return 2
    change(REPOSITORY, version, dt.datetime.now(tz=dt.UTC).date())
    return 0


if __name__ == "__main__":
    sys.exit(main())
