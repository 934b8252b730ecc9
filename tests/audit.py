"""`python -m tests.audit`: known weaknesses of what the operator's image installs.

pip-audit compares the locked versions with the advisories of PyPI. It needs the network: without it nothing can be
said, and that is an error here, since who asks wants to know. What is found but does no harm has its reason in KNOWN.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ROOT = Path(__file__).parents[1]
LOCKED = ROOT / "operator" / "requirements.txt"
KNOWN: dict[str, str] = {}
"""By advisory, why it does no harm here."""


def main() -> int:
    """1 when there is a finding without a reason, or a reason without a finding; 2 without answers."""
    return judge(audit(LOCKED), KNOWN)


def judge(report: str, known: Mapping[str, str]) -> int:
    """Print what the report says, and return the exit code."""
    unknown = skipped(report)
    if unknown:
        _say(f"not looked up, so nothing is known of them: {', '.join(unknown)}")
        return 2
    found = advisories(report)
    for name, advisory, fixed in found:
        _say(f"{name}: {advisory}, fixed in {fixed or 'no version yet'}: {known.get(advisory, 'NOT KNOWN')}")
    ids = {advisory for _, advisory, _ in found}
    for advisory in known.keys() - ids:
        _say(f"{advisory}: known, but no longer found: take it off the list")
    _say(f"{len(found)} advisories in {LOCKED.name}")
    return int(ids != known.keys())


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")


def audit(lock: Path) -> str:
    """pip-audit's report as JSON; it exits with 1 where it finds something."""
    command = [sys.executable, "-m", "pip_audit", "--requirement", str(lock), "--require-hashes", "--disable-pip"]
    done = subprocess.run([*command, "--format", "json"], capture_output=True, text=True, timeout=600, check=False)
    if not done.stdout.startswith("{"):
        sys.stderr.write(done.stderr)
        raise SystemExit(2)
    return done.stdout


def skipped(report: str) -> list[str]:
    """The packages that could not be looked up: without the internet pip-audit says so, and reports success."""
    return [package["name"] for package in json.loads(report)["dependencies"] if "skip_reason" in package]


def advisories(report: str) -> list[tuple[str, str, str]]:
    """Package, advisory, and the versions without it."""
    return [
        (f"{package['name']} {package['version']}", one["id"], ", ".join(one["fix_versions"]))
        for package in json.loads(report)["dependencies"]
        for one in package.get("vulns", ())
    ]


if __name__ == "__main__":
    raise SystemExit(main())
