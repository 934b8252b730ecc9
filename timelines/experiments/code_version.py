"""Which version of the code a run is of."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

UNKNOWN = "unknown"
REPORTING = (
    *("report.py", "report_texts.py", "tables.py", "detail_tables.py", "pictures.py", "film.py"),
    *("rates.py", "verdicts.py", "paired.py", "doubts.py"),
)
CODE = (
    *("operator", "modules", "charts", "crds", "config", "timelines", "tests/node", "pyproject.toml"),
    ":(exclude)timelines/results",
    *(f":(exclude)timelines/experiments/{name}" for name in REPORTING),
)
"""What can change a run: not the data, which is committed while blocks are still to come, nor how it is reported."""


def code_version(repository: Path) -> str:
    """The last commit that changed the code, such as `1a2b3c4`, or `1a2b3c4 and changes` if some are not committed."""
    commit = _git(repository, "log", "-1", "--format=%h", "--", *CODE)
    changes = _git(repository, "status", "--porcelain", "--", *CODE)
    return f"{commit or UNKNOWN}{' and changes' if commit and changes else ''}"


def _git(repository: Path, *words: str) -> str:
    """What git prints; nothing where it fails, as without a history."""
    command = ["git", "-C", str(repository), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()
