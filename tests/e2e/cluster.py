"""kubectl and helm as functions: bounded in time, errors with what the command said."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

REPOSITORY = Path(__file__).resolve().parents[2]
PATIENCE = 30.0
"""Seconds in which anything must come true; reaction times are for benchmarks, not for assertions."""


class CommandError(AssertionError):
    """A command failed; the message has all that it said."""


def run(*argv: str, stdin: str | None = None, timeout: float = 120) -> str:
    """Run a command and return what it printed."""
    done = subprocess.run(argv, input=stdin, capture_output=True, text=True, timeout=timeout, check=False)
    if done.returncode != 0:
        raise CommandError(f"{' '.join(argv)}\n{done.stdout}{done.stderr}")
    return done.stdout


def apply(*objects: dict[str, Any]) -> None:
    """kubectl apply."""
    run("kubectl", "apply", "-f", "-", stdin=json.dumps({"apiVersion": "v1", "kind": "List", "items": list(objects)}))


def get(kind: str, name: str, namespace: str) -> dict[str, Any]:
    """One object."""
    found: dict[str, Any] = json.loads(run("kubectl", "get", kind, name, "-n", namespace, "-o", "json"))
    return found


def delete(kind: str, name: str, namespace: str) -> None:
    """Delete and wait until it is gone; nothing to do when it is not there."""
    run("kubectl", "delete", kind, name, "-n", namespace, "--ignore-not-found", "--timeout=60s")


def until(what: str, condition: Callable[[], object], patience: float = PATIENCE) -> None:
    """Wait until a condition holds; `what` says what did not come true."""
    deadline = time.monotonic() + patience
    last: object = None
    while time.monotonic() < deadline:
        last = condition()
        if last is True:
            return
        time.sleep(0.02)
    raise AssertionError(f"not within {patience:g} s: {what}; last seen: {last!r}")
