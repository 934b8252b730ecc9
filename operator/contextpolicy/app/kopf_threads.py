"""Kopf for namespaces that come and go.

Kopf serves a fixed set of namespaces, and when it starts again it reads all policies and breaks off running handlers.
So namespaces that come get a thread of their own, and only a thread that loses one of its namespaces starts again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from contextpolicy.app.kopf_thread import KopfThread

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from contextpolicy.app.kopf_thread import KopfListener
    from contextpolicy.app.wiring import Operator

MOST = 4
"""Threads: each has connections and a loop of its own. With more namespaces to come, all start again in one."""


class KopfThreads:
    """Only one thread calls `serve` and `stop`; any may call the rest."""

    def __init__(self, operator: Operator, listener: KopfListener) -> None:
        self._operator, self._listener = operator, listener
        self._threads: tuple[KopfThread, ...] = ()

    @property
    def namespaces(self) -> frozenset[str]:
        """What is served."""
        return frozenset(namespace for one in self._threads for namespace in one.namespaces)

    @property
    def failed(self) -> bool:
        """Whether a thread has ended by itself."""
        return any(one.failed for one in self._threads)

    def serve(self, namespaces: frozenset[str]) -> None:
        """Serve these, and no others: of those that go no handler runs any more when this returns."""
        kept = tuple(one for one in self._threads if one.namespaces <= namespaces)
        new = namespaces - {namespace for one in kept for namespace in one.namespaces}
        if new and len(kept) >= MOST:
            kept, new = (), namespaces
        _end([one for one in self._threads if one not in kept])
        self._threads = (*kept, KopfThread(self._operator, new, self._listener)) if new else kept

    def stop(self) -> None:
        """End all, and wait until no handler runs any more."""
        _end(self._threads)

    def submit(self, beat: Callable[[], None]) -> None:
        """Call `beat` once each thread has answered, on one of them; at once where there is none."""
        waiting = list(self._threads)

        def pass_on() -> None:
            if waiting:
                waiting.pop().submit(pass_on)
            else:
                beat()

        pass_on()


def _end(threads: Sequence[KopfThread]) -> None:
    """All at once: each takes a while."""
    for one in threads:
        one.begin_stop()
    for one in threads:
        one.stop()
