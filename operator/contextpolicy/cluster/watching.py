"""Follow a list of objects: list once, then watch.

Kopf can watch any object too, but compares each version with the last and copies both: milliseconds of Python per
event, just when a resize makes pods change and its own answer waits to be read. `kubernetes.informer` (37.0) encodes
each event again to build a model of it (280 us for a pod where `json.loads` takes 20), and reconnects without a pause
when the server ends or refuses a watch.
"""

from __future__ import annotations

import logging
from concurrent.futures import Future
from contextlib import suppress
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, Protocol

from kubernetes.watch.watch import iter_resp_lines

from contextpolicy.cluster.nesting import loads
from contextpolicy.cluster.paging import PageReader, pages
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Mapping

    import urllib3

log = logging.getLogger(__name__)

PAUSES = (0.1, 0.2, 0.5, 1.0)
"""Seconds between attempts to reach the API server; the last one repeats."""


class ListWatch(PageReader, Protocol):
    """What a watch needs of the API server."""

    def watch(self, path: str, version: str) -> urllib3.BaseHTTPResponse:
        """The changes of a list since `version`, one JSON object per line."""


class WatchListener(Protocol):
    """Receives a list's changes."""

    def on_object(self, item: Mapping[str, Any]) -> None:
        """An object is new, was there already, or has changed."""

    def on_gone(self, uid: str) -> None:
        """An object was deleted."""

    def on_listing(self) -> None:
        """The list was read, or the server now refuses it, or no longer does."""


class ObjectWatch:
    """One list, followed on a thread of its own.

    The listener is called on that thread. `listed` is done once it has received everything that existed at the start.
    `refused` says why the server lets us see nothing, if it does not.
    """

    def __init__(self, api: ListWatch, path: str, listener: WatchListener) -> None:
        self.listed: Future[None] = Future()
        self.refused = ""
        self._api, self._path, self._listener = api, path, listener
        self._known: dict[str, str] = {}
        """UIDs by namespace and name."""
        self._version: str | None = None
        self._failures = 0
        self._stop = Event()
        self._response: urllib3.BaseHTTPResponse | None = None
        self._thread = Thread(target=self._run, name=f"watch {path}", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread, even if it is blocked on a silent server."""
        self._stop.set()
        response = self._response
        if response is not None:
            with suppress(OSError, ValueError, RuntimeError):  # the response has ended by itself already
                response.shutdown()
        self._thread.join(timeout=5)

    def __str__(self) -> str:
        """The path of the list."""
        return self._path

    def check(self) -> None:
        """RuntimeError when the thread has ended."""
        if not self._thread.is_alive():
            raise RuntimeError(f"{self._path} is no longer watched")

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                if self._version is None:
                    self._list()
                self._follow()
                self._stop.wait(PAUSES[0])  # don't hammer a server or proxy that ends every watch at once
            except Exception as error:  # noqa: BLE001 - whatever an answer is, everything is listed again
                self._rest(error)

    def _list(self) -> None:
        """All pages show one moment, from which the watch starts; without it (410) the list is read again."""
        listed: set[str] = set()
        for page in pages(self._api, self._path):
            for item in page["items"]:
                listed.add(_key(item))
                self._show(item)
            self._version = page["metadata"]["resourceVersion"]
        for key in self._known.keys() - listed:
            self._listener.on_gone(self._known.pop(key))
        if self._failures:
            log.info("%s: watch re-established", self._path)
        self._failures = 0
        self._note_refusal("")
        if not self.listed.done():
            self.listed.set_result(None)
            self._listener.on_listing()

    def _follow(self) -> None:
        """Watch until the server ends it, as it does every few minutes; the next one resumes from the last version."""
        with self._api.watch(self._path, self._version or "") as response:
            self._response = response
            if not self._stop.is_set():
                for line in iter_resp_lines(response):  # type: ignore[no-untyped-call]
                    self._take(loads(line))

    def _take(self, event: Mapping[str, Any]) -> None:
        item = event["object"]
        if event["type"] == "ERROR":
            raise ActuationError(str(item.get("reason")), str(item.get("message")), retriable=True)
        if event["type"] == "DELETED":
            uid = item["metadata"]["uid"]
            for gone in {uid, self._known.pop(_key(item), uid)}:
                self._listener.on_gone(gone)
        elif event["type"] != "BOOKMARK":
            self._show(item)
        self._version = item["metadata"]["resourceVersion"]

    def _show(self, item: Mapping[str, Any]) -> None:
        """A name has one object at a time: another UID means that the one before is gone, which nobody may report.

        The server's cache has objects by name too. When it lost its own watch, it may show a deletion and what was
        created under the name afterwards as one modification.
        """
        key, uid = _key(item), item["metadata"]["uid"]
        before = self._known.get(key, uid)
        self._known[key] = uid
        if before != uid:
            log.info("%s: %s was deleted and re-created; the watch did not report its deletion", self._path, key)
            self._listener.on_gone(before)
        self._listener.on_object(item)

    def _rest(self, error: Exception) -> None:
        """After any error, list again: versions may have moved on (410) or back (a restored backup)."""
        self._version = None
        if self._stop.is_set():
            return
        if self._failures == 0:
            log.warning("%s: watch failed, retrying: %s", self._path, error)
        if isinstance(error, ActuationError) and error.reason == "Forbidden":
            self._note_refusal(str(error))
        self._stop.wait(PAUSES[min(self._failures, len(PAUSES) - 1)])
        self._failures += 1

    def _note_refusal(self, why: str) -> None:
        if self.refused != why:
            self.refused = why
            self._listener.on_listing()


def _key(item: Mapping[str, Any]) -> str:
    metadata = item["metadata"]
    return f"{metadata.get('namespace', '')}/{metadata['name']}"
