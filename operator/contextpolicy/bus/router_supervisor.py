"""Restarts the router when it was killed: a kubelet does so too, but after a back-off that grows to 5 min."""

from __future__ import annotations

import logging
import os
import signal
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

log = logging.getLogger(__name__)

IN_VAIN = 10
"""How many routers in a row may be killed before they routed, until it is left to the kubelet and its pauses."""


class RouterSupervisor:
    """`start` starts a router, given how often it was started again, and returns its process id.

    `routed` says of the last one whether it ever routed.
    """

    def __init__(self, start: Callable[[int], int], routed: Callable[[], bool]) -> None:
        self._start, self._routed = start, routed
        self._lock = Lock()
        self._router: int | None = None
        self._stopping = False

    def run(self) -> int:
        """Keep a router running; returns the exit code of one that ended by itself or was asked to, 1 in vain."""
        restarts = vain = 0
        while (router := self._begin(restarts)) is not None:
            code = self._wait(router)
            if code >= 0:
                return code
            vain = 0 if self._routed() else vain + 1
            if vain >= IN_VAIN:
                log.error("the router was killed %d times in a row before it was ready", vain)
                return 1
            restarts += 1
            log.warning("the router was killed by signal %d: restarting it", -code)
        return 0

    def stop(self) -> None:
        """End the router, and then `run`: called from any thread."""
        with self._lock:
            self._stopping = True
            if self._router is not None:
                os.kill(self._router, signal.SIGTERM)

    def _begin(self, restarts: int) -> int | None:
        with self._lock:
            self._router = None if self._stopping else self._start(restarts)
            return self._router

    def _wait(self, router: int) -> int:
        """Its exit code, or minus the signal that killed it. While its id is ours, no other process gets it."""
        os.waitid(os.P_PID, router, os.WEXITED | os.WNOWAIT)
        with self._lock:
            self._router = None
            return os.waitstatus_to_exitcode(os.waitpid(router, 0)[1])
