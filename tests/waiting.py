"""Waiting for what another process or the kernel does, where nothing reports when it has."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

PATIENCE = 30.0
"""Seconds: the machine may be busy."""
PAUSE = 0.01


def until(condition: Callable[..., object]) -> None:
    """Wait until it holds; it is called without arguments, and may have defaults: the variables of a loop."""
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, "it did not come true"
        time.sleep(PAUSE)
