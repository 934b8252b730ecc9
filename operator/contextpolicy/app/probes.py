"""What the kubelet asks: /healthz (is any part of us hung?) and /readyz (do we decide, or could we at once?).

Served on threads of its own and answered at once, whatever else hangs: a part that takes 5 s for once fails one probe,
not the probes of the next minute.
"""

from __future__ import annotations

import time
from threading import Event, Lock
from typing import TYPE_CHECKING, Protocol

from contextpolicy.bus.http_server import HttpHandler, HttpServer
from contextpolicy.bus.listening import EVERYWHERE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

PATIENCE = 0.5
"""Seconds that a question waits for a loop to answer; after that its delay so far is the answer."""
HUNG = 5.0
"""Seconds after which a loop that does not answer counts as hung."""


class BeatingLoop(Protocol):
    """A loop on a thread of its own."""

    def submit(self, beat: Callable[[], None]) -> object:
        """Call `beat` soon, on that thread."""


class Heartbeat:
    """Measures the delay of a loop."""

    def __init__(self, loop: BeatingLoop) -> None:
        self._loop = loop
        self._lock = Lock()
        self._beat: Event | None = None
        self._asked = 0.0

    def delay(self) -> float:
        """Seconds for which the loop has not answered; below PATIENCE when it does. Returns within PATIENCE."""
        with self._lock:
            if self._beat is None or self._beat.is_set():
                self._beat, self._asked = Event(), time.monotonic()
                self._loop.submit(self._beat.set)
            beat, asked = self._beat, self._asked
        beat.wait(PATIENCE)
        return 0.0 if beat.is_set() else time.monotonic() - asked


def serve(port: int, pages: Mapping[str, Callable[[], list[str]]]) -> HttpServer:
    """Answer until the server is closed; each page is a function that returns what is wrong, if anything is."""

    class Page(HttpHandler):
        def do_GET(self) -> None:
            """200 when nothing is wrong, else 503 and a line for each problem."""
            check = pages.get(self.path)
            problems = check() if check else []
            status = 404 if check is None else 503 if problems else 200
            self.say(status, "".join(f"{line}\n" for line in problems or ["ok"]))

    server = HttpServer((EVERYWHERE, port), Page, "health")
    server.start()
    return server
