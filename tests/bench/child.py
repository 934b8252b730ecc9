"""Processes of a benchmark: a subject that answers questions, and a program that only runs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Self

from tests.node.layout import REPOSITORY

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from tests.bench.cgroup import Cgroup


@contextmanager
def program(*arguments: str, group: Cgroup | None = None, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """A Python program, in the group from its start on; killed at the end if it still runs."""
    path = f"{REPOSITORY}:{REPOSITORY / 'modules/robotkit'}"
    with subprocess.Popen(
        [sys.executable, *arguments],
        cwd=REPOSITORY,
        env={**os.environ, "PYTHONPATH": path, "PYTHONUNBUFFERED": "1", **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            if group is not None:
                group.add(process.pid)
            yield process
        finally:
            process.kill()


class Child:
    """A Python program that says when it is ready, and answers a line of JSON with a line; from `with` to its end."""

    def __init__(self, *arguments: str, environment: Mapping[str, str] | None = None) -> None:
        self._process = subprocess.Popen(
            [sys.executable, *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **(environment or {})},
        )

    def __enter__(self) -> Self:
        assert self._process.stdout is not None
        assert self._process.stdout.readline(), "it ended before it was ready"
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()

    @property
    def process(self) -> int:
        """Its id."""
        return self._process.pid

    def ask(self, **question: Any) -> Any:
        """Its answer."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(question) + "\n")
        self._process.stdin.flush()
        return json.loads(self._process.stdout.readline())
