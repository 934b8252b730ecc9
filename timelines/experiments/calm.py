"""Waits until a machine is quiet enough to be measured on."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING

from timelines.demo.deploy import DeployError
from timelines.experiments.cpu_account import machine_seconds

if TYPE_CHECKING:
    from collections.abc import Callable

QUIET = 0.2
"""Part of all processors that may be busy before a run: Kubernetes, and a robot whose modules wait."""
CORES = os.cpu_count() or 1
LOOK = 2.0
"""Seconds over which that is taken."""
PATIENCE = 180.0


class DisturbedError(DeployError):
    """A machine that was not as quiet or as fast as a run needs, whatever the run was of."""


def wait_until_calm(
    busy: Callable[[], float] = machine_seconds,
    sleep: Callable[[float], None] = time.sleep,
    cores: int = CORES,
) -> float:
    """Wait until the machine is quiet, and return the part of it that was busy; DisturbedError if it never is.

    The kernel does not report when it becomes idle, so this looks, for at most PATIENCE seconds.
    """
    part = 1.0
    for _ in range(round(PATIENCE / LOOK)):
        before = busy()
        sleep(LOOK)
        part = (busy() - before) / (LOOK * cores)
        if part <= QUIET:
            return round(part, 3)
    raise DisturbedError(
        f"the machine was {part:.0%} busy after {PATIENCE:g} s of waiting: stop everything else that runs on it"
    )
