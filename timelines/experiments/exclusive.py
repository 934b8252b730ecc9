"""One call at a time: two on one machine would take each other's processors, and neither would notice."""

from __future__ import annotations

import fcntl
import tempfile
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from timelines.demo.deploy import DeployError

if TYPE_CHECKING:
    from collections.abc import Iterator

LOCK = Path(tempfile.gettempdir()) / "contextpolicy-experiments.lock"
"""Belongs to the machine, as its node and its processors do, and not to one checkout."""


@contextmanager
def exclusively() -> Iterator[None]:
    """Keep other calls off this machine while the block runs; DeployError if there is one already."""
    with LOCK.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise DeployError(f"{LOCK}: other experiments run on this machine: wait for them, or end them") from None
        yield
