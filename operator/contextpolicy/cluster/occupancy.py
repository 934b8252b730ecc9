"""Which namespaces are served by an operator other than the one whose work is being undone, as their Leases say."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Protocol

from contextpolicy.cluster.lease import NAMESPACE_LEASE
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from contextpolicy.cluster.lease import Lease

LOOK = 1.0
"""Seconds between two looks at Leases that may have been abandoned: an operator renews each of its own every 20 s."""
MISSING = 25
"""Seconds for which a Lease without a holder may have been deleted under a running operator: it writes a new one."""
HOLD = 60
"""Seconds for which a Lease is renewed."""
TIMEOUT = 5.0
"""Seconds to wait for the answer."""


class LeaseReader(Protocol):
    """The calls to the API server that this needs."""

    def lease(self, namespace: str, name: str) -> Lease:
        """GET a Lease."""

    def write_lease(self, namespace: str, name: str, content: Lease, timeout: float) -> Lease:
        """Replace the Lease of the same version; Conflict when it is not as it was."""


class Occupancy:
    """`release` is the release (namespace/name) in whose name we act.

    A namespace whose Lease names another release is that one's business, even if its operator is down just now; our own
    is renewed with each look, so that no release takes it while we work there. Without a release, the one that renews
    a Lease while we look serves its namespace. `wait` takes seconds; a `dry_run` writes nothing.
    """

    def __init__(
        self, api: LeaseReader, release: str, wait: Callable[[float], object], *, dry_run: bool = False
    ) -> None:
        self._api, self._release, self._wait, self._dry_run = api, release, wait, dry_run
        self._first: dict[str, Lease] = {}

    def settle(self, namespaces: Iterable[str]) -> None:
        """Look until it is known of each namespace, for as long as a Lease lasts at most.

        All of them at once: anybody may leave Leases without a holder. What can't be read is an error of `served_by`.
        """
        found: dict[str, Lease] = {}
        for namespace in set(namespaces) - self._first.keys():
            with suppress(ActuationError):
                found[namespace] = self._look(namespace)
        self._first |= found
        open_ones = {namespace for namespace, first in found.items() if self._is_open(first)}
        waited = 0.0
        while open_ones:
            self._wait(LOOK)
            waited += LOOK
            open_ones = {one for one in open_ones if not self._is_known(one) and waited <= _patience(found[one])}

    def served_by(self, namespace: str) -> str:
        """The other operator that serves a namespace at this instant, empty if there is none; ActuationError if unread.

        `settle` must have looked at the namespace before.
        """
        first, now = self._first.get(namespace), self._look(namespace)
        if first is None:
            raise ActuationError(
                "NotSettled", f"the Lease of namespace {namespace} could not be read at the start", retriable=True
            )
        if now.holder == self._release and self._release:
            now = self._renewed(namespace, now)
        if now.holder in ("", self._release):
            return ""
        renewed = (now.holder, now.renewed) != (first.holder, first.renewed)
        return now.holder if self._release or renewed else ""

    def give_back(self) -> None:
        """All is done in the namespaces that are ours: a replica that waits for one may have it at once."""
        for namespace in self._first if self._release and not self._dry_run else ():
            now = self._look(namespace)
            if now.holder == self._release:
                with suppress(ActuationError):  # it runs out by itself
                    self._api.write_lease(namespace, NAMESPACE_LEASE, replace(now, holder="", seconds=1), TIMEOUT)

    def _is_open(self, first: Lease) -> bool:
        """Whether only time can show if the holder of the Lease is alive."""
        return bool(self._release) is not bool(first.holder)

    def _is_known(self, namespace: str) -> bool:
        try:
            return bool(self._look(namespace).holder if self._release else self.served_by(namespace))
        except ActuationError:
            return False

    def _renewed(self, namespace: str, own: Lease) -> Lease:
        """Our Lease, renewed, or that of another release that was faster, or none if it was deleted."""
        if self._dry_run:
            return own
        now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        try:
            return self._api.write_lease(namespace, NAMESPACE_LEASE, replace(own, renewed=now, seconds=HOLD), TIMEOUT)
        except ActuationError as error:
            if error.reason not in ("Conflict", "NotFound"):
                raise
            return self._look(namespace)

    def _look(self, namespace: str) -> Lease:
        return self._api.lease(namespace, NAMESPACE_LEASE)


def _patience(first: Lease) -> int:
    """A Lease without a holder is not waited for as long as its duration, which means nothing then."""
    return first.seconds or MISSING if first.holder else min(first.seconds or MISSING, MISSING)
