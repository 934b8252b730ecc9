"""Who acts: one replica of a release, and one release in a namespace.

The replicas of a release (the chart's `operator.replicas`) campaign for its Lease. The holder campaigns, in the
release's name, for the Lease `contextpolicy` of each namespace that it serves. So two releases exclude each other
namespace by namespace, and a standby that takes over does not have to wait for the namespaces.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from contextpolicy.cluster.lease import NAMESPACE_LEASE, Candidacy
from contextpolicy.cluster.lease_keeper import LeaseKeeper, clock

if TYPE_CHECKING:
    from collections.abc import Iterable

    from contextpolicy.app.settings import Settings
    from contextpolicy.cluster.lease_keeper import LeaseApi, LeaseListener

log = logging.getLogger(__name__)

NAMESPACE_SECONDS = 60
"""How long a release holds a namespace at a time. It does not give it back at its end: the next replica goes on, and
after an uninstallation a Job puts containers back, and gives it back then. So only a release that ends without its Job
keeps others waiting for that long, and there are three writes a minute."""

MOST_FAILURES = 5
"""Writes in a row, within about a second, after which a free Lease counts as one that we do not get for now. Anyone who
may write it can change it before each of them; the other namespaces must not wait for that."""


class Leadership:
    """What this replica may do; calls the listener whenever that may have changed."""

    def __init__(self, api: LeaseApi, settings: Settings, listener: LeaseListener) -> None:
        self._replica, self._keeper = _run_for_release(api, settings, listener)
        self._release = "/".join(settings.lease or (settings.identity,))
        self._claims: dict[str, Candidacy] = {}
        self._reported: dict[str, str] = {}
        self._claiming = LeaseKeeper(api, NAMESPACE_LEASE, listener)
        self._claiming_started = False

    def start(self) -> None:
        """Campaign for the release's Lease, if it has one."""
        if self._keeper is not None:
            self._keeper.start()

    def stop(self) -> None:
        """Give the release's Lease back; call it when nothing acts any more."""
        if self._claiming_started:
            self._claiming.abandon()
        if self._keeper is not None:
            self._keeper.stop()

    def check(self) -> None:
        """RuntimeError when a thread has ended."""
        if self._keeper is not None:
            self._keeper.check()
        if self._claiming_started:
            self._claiming.check()

    @property
    def leads(self) -> bool:
        """Whether this replica acts for its release now. It may be False for a moment and True again."""
        return self._replica is None or clock() < self._replica.acts_until

    @property
    def follows(self) -> bool:
        """Whether another replica leads, and we would notice if it did not.

        One that has not renewed its Lease since we look may be dead: then none decides until the Lease has expired.
        """
        return self._replica is not None and self._replica.follows

    @property
    def deposed(self) -> bool:
        """Whether another replica may have led since we did: all that we know may be wrong."""
        return self._replica is not None and self._replica.lost

    @property
    def interruptions(self) -> int:
        """How often we had to pause because a renewal came late; it only grows."""
        return self._claiming.interruptions + (self._keeper.interruptions if self._keeper is not None else 0)

    def may_act(self, namespace: str) -> bool:
        """Whether we may act in a namespace at this instant."""
        claim = self._claims.get(namespace)
        return claim is not None and clock() < claim.acts_until and self.leads

    def serve(self, namespaces: Iterable[str]) -> None:
        """Campaign for the Leases of these namespaces, and no others; only for a replica that leads."""
        wanted = set(namespaces)
        if not self._claiming_started:
            self._claiming_started = True
            self._claiming.start()
        for namespace in self._claims.keys() - wanted:
            del self._claims[namespace]
            self._claiming.leave(namespace)
            self._reported.pop(namespace, None)
        for namespace in sorted(wanted):
            claim = self._claims.get(namespace)
            if claim is None or claim.lost:
                self._claims[namespace] = again = Candidacy(self._release, NAMESPACE_SECONDS)
                again.other = claim.other if claim is not None else ""
                self._claiming.stand(namespace, again)

    @property
    def served(self) -> frozenset[str] | None:
        """The namespaces that this release serves; None while that is unknown of any."""
        claims = dict(self._claims)
        for namespace, claim in claims.items():
            self._tell_other(namespace, claim)
        if not all(claim.held or claim.holder or claim.lost or _unobtainable(claim) for claim in claims.values()):
            return None
        return frozenset(namespace for namespace, claim in claims.items() if claim.held)

    def _tell_other(self, namespace: str, claim: Candidacy) -> None:
        """Log once why a namespace is not served: which release serves it, or what is missing."""
        reason = ""
        if why := _unobtainable(claim):
            reason = f"namespace {namespace} can't be served: {why}"
        elif claim.holder not in ("", self._release):
            reason = f"namespace {namespace} is served by {claim.holder}: leaving it alone until that release stops"
        if reason != self._reported.get(namespace, ""):
            self._reported[namespace] = reason
            if reason:
                log.warning("%s", reason)


def _unobtainable(claim: Candidacy) -> str:
    """Why we will not get a Lease soon, although nobody holds it; empty while we may."""
    contested = claim.failures >= MOST_FAILURES and not (claim.held or claim.holder)
    return claim.refused or ("each attempt to take its Lease failed" if contested else "")


def _run_for_release(
    api: LeaseApi, settings: Settings, listener: LeaseListener
) -> tuple[Candidacy | None, LeaseKeeper | None]:
    if settings.lease is None:
        return None, None
    namespace, name = settings.lease
    candidacy = Candidacy(settings.identity, settings.lease_seconds, settings.lease_pod)
    keeper = LeaseKeeper(api, name, listener, watched=namespace)
    keeper.stand(namespace, candidacy)
    return candidacy, keeper
