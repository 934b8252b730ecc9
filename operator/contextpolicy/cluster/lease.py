"""A Lease (coordination.k8s.io) as one candidate sees it: who holds it, when to take it, how long we may act. Pure.

The client library's own election (`kubernetes.leaderelection`, 37.0) is not used: it measures with the wall clock,
which robots set while they run, asks the API server over and over instead of watching, never gives a Lease back, and
does not stop acting before another may start.

Times are seconds of one clock of this machine that never steps. Clocks are never compared across machines: a candidate
takes a Lease over when it has seen no renewal for as long as the holder asked for, counted from when it saw the last
one, which is later than when the holder sent it. The holder acts for only a part of that time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

NAMESPACE_LEASE = "contextpolicy"
"""The Lease in each namespace that says which release serves it."""
RENEW = 1 / 3
"""The part of a Lease's duration after which its holder renews it."""
ACT = 0.8
"""The part of its duration, from when the last renewal was sent, in which its holder acts. The rest is for requests
that are on their way then: they arrive before anybody else starts."""
AGAIN = 0.2
"""Seconds after which a request that failed is sent again."""
REFUSED = 5.0
"""Seconds after which a refused request is retried: no event says when a right or a namespace appears."""
LONGEST = 60
"""Seconds that a holder may ask for at most: whatever a Lease says, it is not waited for any longer."""


class OwnPod(NamedTuple):
    """The pod that this process runs in."""

    name: str
    uid: str


@dataclass(frozen=True, slots=True)
class Lease:
    """As the API server has it; `version` is empty when it has none, `holder` when it is free.

    `uid` is the object's: one that is deleted and made again has another.

    Kubernetes deletes a Lease with the `pod` of its holder. So it is free as soon as that is gone, also when the holder
    could not give it back: `helm uninstall` takes its rights away before it ends.
    """

    holder: str = ""
    seconds: int = 0
    renewed: str = ""
    acquired: str = ""
    transitions: int = 0
    version: str = ""
    pod: OwnPod | None = None
    uid: str = ""


def read(item: Mapping[str, Any]) -> Lease:
    """Read a Lease; invalid fields count as missing."""
    spec = item.get("spec") or {}
    return Lease(
        holder=str(spec.get("holderIdentity") or ""),
        seconds=min(LONGEST, _natural(spec.get("leaseDurationSeconds"))),
        renewed=str(spec.get("renewTime") or ""),
        acquired=str(spec.get("acquireTime") or ""),
        transitions=_natural(spec.get("leaseTransitions")),
        version=str(item["metadata"]["resourceVersion"]),
        pod=_pod(item["metadata"].get("ownerReferences") or ()),
        uid=str(item["metadata"].get("uid") or ""),
    )


def write(lease: Lease, namespace: str, name: str) -> dict[str, Any]:
    """The object to create, or to replace the one of the same version with."""
    spec = {
        "holderIdentity": lease.holder or None,
        "leaseDurationSeconds": lease.seconds,
        "renewTime": lease.renewed or None,
        "acquireTime": lease.acquired or None,
        "leaseTransitions": lease.transitions,
    }
    version = {"resourceVersion": lease.version} if lease.version else {}
    owner = {"ownerReferences": [{"apiVersion": "v1", "kind": "Pod", **lease.pod._asdict()}]} if lease.pod else {}
    metadata = {"name": name, "namespace": namespace, **version, **owner}
    return {"apiVersion": "coordination.k8s.io/v1", "kind": "Lease", "metadata": metadata, "spec": spec}


class Candidacy:
    """One candidate for one Lease: `identity` is what it calls itself, `seconds` how long it holds it at a time.

    Two processes with one identity must never run at the same time: a Lease in our name is ours at once. `pod` is the
    one that we run in, if the Lease is to be deleted with it.
    """

    def __init__(self, identity: str, seconds: int, pod: OwnPod | None = None) -> None:
        self.identity, self.seconds, self.pod = identity, seconds, pod
        self.acts_until = -inf
        """Until when we may act; it moves with each renewal."""
        self.lost = False
        """Another holds the Lease that we held: whatever we know about the cluster may be wrong by now."""
        self.refused = ""
        """Why we may not even run for it, if so: no right, or no such namespace."""
        self.failures = 0
        """Writes that have failed since one succeeded."""
        self.wanted = True
        self.other = ""
        """Who else held it when it was last there: a Lease goes with its namespace, and then nobody can take it."""
        self.follows = False
        """Another holds the Lease and is alive: since we first looked, it has taken or renewed it."""
        self._seen: Lease | None = None
        self._seen_at = -inf
        self._due = -inf

    @property
    def held(self) -> bool:
        """Whether the Lease is in our name, as far as we know; `acts_until` says whether it still counts."""
        return self._seen is not None and self._seen.holder == self.identity and self.acts_until > -inf

    @property
    def holder(self) -> str:
        """The holder, as far as we know; empty when it is free."""
        return self._seen.holder if self._seen else ""

    @property
    def due(self) -> float:
        """When to write: to renew the Lease, to take it over, or to try again."""
        return self._due if self.wanted and not self.lost else inf

    def see(self, lease: Lease, now: float) -> None:
        """Take the Lease as the API server has it, or as it has none."""
        before = self._seen
        if before is not None and not _is_news(lease.version, before.version):
            return
        self._seen = lease
        if lease.version:
            self.other = "" if lease.holder == self.identity else lease.holder
        if lease.holder != self.identity and self.acts_until > -inf:
            self.lost, self.acts_until = True, -inf
        if before is None or (before.holder, before.renewed) != (lease.holder, lease.renewed):
            self._seen_at = now
            self.follows = before is not None and lease.holder not in ("", self.identity)
        if lease.holder not in ("", self.identity):
            self._due = self._seen_at + lease.seconds
        elif not self.held:
            self._due = now

    def lose(self, uid: str, now: float) -> None:
        """The Lease of this UID was deleted; the one that we know may have come after it."""
        if self._seen is None or self._seen.uid in ("", uid):
            self.see(Lease(), now)

    @property
    def seen(self) -> bool:
        """Whether we know its holder, or that it is free."""
        return self._seen is not None

    def ask(self, wall: str) -> Lease | None:
        """The Lease to write now, None before the first look at it; `wall` is the time as people read it, for them."""
        if self._seen is None:
            return None
        held = self._seen.holder == self.identity
        return replace(
            self._seen,
            holder=self.identity,
            pod=self.pod,
            seconds=self.seconds,
            renewed=wall,
            acquired=self._seen.acquired if held else wall,
            transitions=self._seen.transitions + (0 if held else 1),
        )

    def succeed(self, written: Lease, sent: float, now: float) -> bool:
        """The API server took what was sent at `sent`, as it has it now.

        Returns whether that came too late for us to act without a pause, though no other replica held it meanwhile.
        """
        if self.lost:
            return False
        paused = -inf < self.acts_until < now
        self._seen, self._seen_at, self.refused, self.follows = written, sent, "", False
        self.failures = 0
        self.acts_until = sent + ACT * self.seconds
        self._due = sent + RENEW * self.seconds
        return paused

    def fail(self, now: float, refused: str = "") -> None:
        """The write failed, or its answer was lost; the current Lease is passed to `see`, if it can be read.

        `refused` says why retrying soon is pointless.
        """
        self.refused = refused
        self.failures += self.seen  # what can't even be read says nothing of this Lease: the API may be away
        if refused:
            self._due = now + REFUSED
        elif self._seen is None or self._seen.holder in ("", self.identity) or self._due <= now:
            self._due = now + AGAIN

    def resign(self) -> Lease | None:
        """Stop acting and campaigning; returns the Lease to write, None when there is none to give back."""
        mine, self.wanted, self.acts_until = self.held and not self.lost, False, -inf
        return replace(self._seen, holder="", seconds=1) if mine and self._seen else None


def _is_news(version: str, known: str) -> bool:
    """Versions count up; the watch may report an older one than the answer to our own write."""
    return version != known if not (version and known) else int(version) > int(known)


def _pod(owners: Iterable[Mapping[str, Any]]) -> OwnPod | None:
    return next((OwnPod(one["name"], one["uid"]) for one in owners if one["kind"] == "Pod"), None)


def _natural(value: object) -> int:
    return value if isinstance(value, int) and value > 0 else 0
