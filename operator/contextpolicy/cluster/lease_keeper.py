"""Takes, renews and gives back Leases, on a thread of its own."""

from __future__ import annotations

import logging
import time
from datetime import UTC, datetime
from math import inf
from threading import Condition, Thread
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.cluster import lease as leases
from contextpolicy.cluster.watching import ListWatch, ObjectWatch
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from contextpolicy.cluster.lease import Candidacy, Lease

log = logging.getLogger(__name__)

TERMINATING = "because it is being terminated"
"""How the API server refuses new objects in a namespace that is being deleted. Nobody can take a Lease there any more,
and all that is left to do is to let its policies go, so the one that serves the namespace goes on: who held the Lease
last, or, of a release that was restarted, who saw no other hold it."""


class LeaseApi(ListWatch, Protocol):
    """The calls to the API server that keeping Leases needs."""

    def lease(self, namespace: str, name: str) -> Lease:
        """GET a Lease."""

    def write_lease(self, namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        """Create or replace a Lease."""


class LeaseListener(Protocol):
    """Receives news of Leases; called on any thread."""

    def on_lease(self) -> None:
        """A Lease was read or written, so the namespaces that this operator may act in may have changed."""


def clock() -> float:
    """Seconds since boot: it can't be set, and it runs while the machine is suspended."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


class LeaseKeeper:
    """Leases of one name; reports after every look and write.

    The Lease of the namespace `watched` is watched, so that it is taken the moment its holder gives it back. Others are
    looked at when they may have run out: that is soon enough for them, and a watch for each namespace is not free.
    """

    def __init__(self, api: LeaseApi, name: str, listener: LeaseListener, watched: str = "") -> None:
        self._api, self._name, self._listener = api, name, listener
        self.interruptions = 0
        """How often a holder had to pause because a renewal came late; it only grows."""
        self._candidacies: dict[str, Candidacy] = {}
        self._news, self._stopping = Condition(), False
        path = f"/apis/coordination.k8s.io/v1/namespaces/{watched}/leases?fieldSelector=metadata.name={name}"
        self._watched = watched
        self._watch = ObjectWatch(api, path, self) if watched else None
        self._thread = Thread(target=self._run, name=f"lease {name}", daemon=True)

    def start(self) -> None:
        """Start the threads."""
        if self._watch is not None:
            self._watch.start()
        self._thread.start()

    def stop(self) -> None:
        """Stop acting, and give the held Leases back."""
        self.abandon()
        with self._news:
            held = {namespace: candidacy.resign() for namespace, candidacy in self._candidacies.items()}
        for namespace, given in held.items():
            if given is not None:
                self._give_back(namespace, given)

    def abandon(self) -> None:
        """End the threads without giving the Leases back: they expire."""
        with self._news:
            self._stopping = True
            self._news.notify()
        if self._watch is not None:
            self._watch.stop()
        if self._thread.is_alive():
            self._thread.join(timeout=1)

    def check(self) -> None:
        """RuntimeError when a thread has ended."""
        if self._watch is not None:
            self._watch.check()
        if not self._thread.is_alive():
            raise RuntimeError(f"Lease {self._name} is no longer renewed")

    def on_object(self, item: Mapping[str, Any]) -> None:
        """The watched Lease has changed."""
        found = leases.read(item)
        self._notice(lambda candidacy: candidacy.see(found, clock()))

    def on_gone(self, uid: str) -> None:
        """The watched Lease was deleted."""
        self._notice(lambda candidacy: candidacy.lose(uid, clock()))

    def on_listing(self) -> None:
        """Nothing: what the watch can't see is looked at all the same."""

    def stand(self, namespace: str, candidacy: Candidacy) -> None:
        """Campaign for the Lease of a namespace, in place of an earlier candidacy."""
        with self._news:
            self._candidacies[namespace] = candidacy
            self._news.notify()

    def leave(self, namespace: str) -> None:
        """Stop campaigning for the Lease of a namespace."""
        with self._news:
            candidacy = self._candidacies.pop(namespace, None)
            given = candidacy.resign() if candidacy else None
        if given is not None:
            self._give_back(namespace, given)

    def _run(self) -> None:
        while True:
            with self._news:
                if self._stopping:
                    return
                due, namespace = min(((c.due, n) for n, c in self._candidacies.items()), default=(inf, ""))
                wait = due - clock()
                if wait > 0:
                    self._news.wait(None if due == inf else wait)
                    continue
                candidacy = self._candidacies[namespace]
            self._step(namespace, candidacy)
            self._listener.on_lease()

    def _step(self, namespace: str, candidacy: Candidacy) -> None:
        """Look at a Lease that was never seen, else write it; after a refusal look what it is now."""
        with self._news:
            wanted = candidacy.ask(datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ"))
        sent = clock()
        try:
            if wanted is None:
                self._look(namespace, candidacy)
                return
            timeout = max(0.5, candidacy.seconds / 2)
            written = self._api.write_lease(namespace, self._name, wanted, timeout)
        except ActuationError as error:
            if wanted is not None and TERMINATING in str(error):
                self._go_on(candidacy, wanted, sent)
                return
            level = logging.DEBUG if error.reason == "Conflict" else logging.WARNING
            log.log(level, "%s: %s", self._subject(namespace), error)
            self._failed(namespace, candidacy, error)
        except Exception:
            log.exception("internal error")
            with self._news:
                candidacy.fail(clock())
        else:
            with self._news:
                if candidacy.wanted:
                    self.interruptions += candidacy.succeed(written, sent, clock())

    def _go_on(self, candidacy: Candidacy, wanted: Lease, sent: float) -> None:
        """The namespace is being deleted, and its Lease is gone."""
        with self._news:
            if candidacy.other:
                candidacy.fail(clock(), f"it is being deleted, and {candidacy.other} serves it until then")
            else:
                self.interruptions += candidacy.succeed(wanted, sent, clock())

    def _failed(self, namespace: str, candidacy: Candidacy, error: ActuationError) -> None:
        if error.reason in ("Conflict", "NotFound") and candidacy.seen:
            try:
                self._look(namespace, candidacy)
            except ActuationError as unread:
                log.warning("%s: %s", self._subject(namespace), unread)
        with self._news:
            candidacy.fail(clock(), "" if error.retriable else f"{error.reason}: {error}")

    def _look(self, namespace: str, candidacy: Candidacy) -> None:
        found = self._api.lease(namespace, self._name)
        with self._news:
            candidacy.see(found, clock())

    def _give_back(self, namespace: str, given: Lease) -> None:
        try:
            self._api.write_lease(namespace, self._name, given, timeout=1.0)
        except ActuationError as error:
            log.warning("%s could not be released: %s", self._subject(namespace), error)

    def _notice(self, news: Callable[[Candidacy], None]) -> None:
        with self._news:
            candidacy = self._candidacies.get(self._watched)
            if candidacy is not None:
                news(candidacy)
                self._news.notify()
        self._listener.on_lease()

    def _subject(self, namespace: str) -> str:
        return f"Lease {namespace}/{self._name}"
