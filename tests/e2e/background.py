"""What goes on beside a story, on threads of its own."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Self

if TYPE_CHECKING:
    from collections.abc import Callable


class Background:
    """Runs functions while a `with` holds: they return when `_stop` is set, and are waited for `patience` seconds."""

    def __init__(self, *functions: Callable[[], object], patience: float = 10.0) -> None:
        self._stop, self._patience = threading.Event(), patience
        self._threads = [threading.Thread(target=function, daemon=True) for function in functions]

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def check(self) -> None:
        """AssertionError if one of the functions has ended already: it failed, and waiting for it would be in vain."""
        assert all(thread.is_alive() for thread in self._threads), "a thread of the background has ended"

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join(self._patience)
