"""/metrics over HTTP: clients that ask without pause delay no plan."""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from io import BytesIO
from threading import BoundedSemaphore, Lock
from typing import TYPE_CHECKING

from prometheus_client import MetricsHandler

from contextpolicy.bus.http_places import AT_ONCE
from contextpolicy.bus.http_server import HttpHandler
from contextpolicy.bus.questions import REST

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

MOST_WAITING = AT_ONCE * 3 // 4
"""Clients that wait for a page: a server's other connections are for what is answered at once, such as a probe."""


class PageTurns:
    """Turns at making a page: one at a time, each followed by REST times as long for everything else in the process.

    A page about 30 policies takes 25 ms of the interpreter; eight clients that asked without pause delayed every plan.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._lock, self._clock = Lock(), clock
        self._free_at = -math.inf

    @contextmanager
    def take(self) -> Iterator[None]:
        """Wait for a turn."""
        with self._lock:
            time.sleep(self.pause)
            began = self._clock()
            try:
                yield
            finally:
                ended = self._clock()
                self._free_at = ended + REST * (ended - began)

    @property
    def pause(self) -> float:
        """Seconds until the next turn may begin."""
        return max(0.0, self._free_at - self._clock())


class MetricsPage(HttpHandler, MetricsHandler):
    """A handler that answers with all registered metrics; the pages of a process share its turns."""

    turns = PageTurns(time.monotonic)
    waiting = BoundedSemaphore(MOST_WAITING)

    def do_GET(self) -> None:
        """Make the page in a turn, and send it after the turn: a slow client keeps no other waiting."""
        if self.waiting.acquire(blocking=False):
            self.wfile.write(self._page())
        else:
            self.say(503, "too many clients ask for metrics\n")

    def _page(self) -> bytes:
        client, self.wfile = self.wfile, BytesIO()
        try:
            with self.turns.take():
                super().do_GET()
            return self.wfile.getvalue()
        finally:
            self.wfile = client
            self.waiting.release()
