"""Which of a release's Secrets have to be made or renewed, and what then is in them. Pure but for the keys' chance."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING

from contextpolicy.bus.credentials import CA, CERTIFICATE, KEY
from contextpolicy.bus.expiry import end
from contextpolicy.bus.issuing import (
    AUTHORITY_LIFETIME,
    BEGIN,
    LIFETIME,
    authority_files,
    found_authority,
    is_of,
    is_signing,
    pem,
    read_authority,
    signing_files,
    trusted,
)
from contextpolicy.bus.roles import ROLES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from datetime import datetime

    from cryptography.x509 import Certificate

    from contextpolicy.bus.issuing import Issuer

    Files = Mapping[str, bytes]

RENEW = timedelta(days=120)
"""What is left of a certificate when it is renewed: a robot may be off for months, and alerts begin at 30 days."""
SUCCEED = timedelta(days=2 * 365)
"""What is left of an authority when its heir takes its place, which is made, and trusted, a certificate's life before
that. The authority is trusted beside the new one until its end, so that clients with older files connect as before."""
FAR = timedelta(days=5 * 365)
"""How long after the end of the newest certificate the clock is still believed: robots are off for years, not more."""
HEIRS = {CERTIFICATE: "heir.crt", KEY: "heir.key"}
"""The files of the authority's heir, in the Secret of the authority."""
SHARED = ("sensor", "module")
"""The roles whose Secrets robots' namespaces get."""


@dataclass(frozen=True, order=True, slots=True)
class Place:
    """Where a Secret is."""

    namespace: str
    name: str


@dataclass(frozen=True, slots=True)
class Release:
    """What a release's Secrets are for: `names` are those of its router, `shared` the namespaces of its robots.

    `bus` says whether the router's and its clients' certificates are ours to make, `signing` the key of the plans.
    """

    namespace: str
    prefix: str
    names: Sequence[str] = ()
    shared: Sequence[str] = ()
    bus: bool = True
    signing: bool = True

    @property
    def authority(self) -> Place:
        """What signs all certificates."""
        return self._own("bus-authority")

    @property
    def key(self) -> Place:
        """What signs plans."""
        return self._own("signing")

    def roles(self) -> dict[Place, str]:
        """Each certificate's Secret, and its role."""
        own = {self._own(f"bus-{role}"): role for role in ("router", *ROLES)}
        others = [namespace for namespace in self.shared if namespace != self.namespace]
        return own | {Place(namespace, f"{self.prefix}-bus-{role}"): role for namespace in others for role in SHARED}

    def places(self) -> list[Place]:
        """All that may have to be written."""
        bus = [self.authority, *self.roles()] if self.bus else []
        return [*bus, *([self.key] if self.signing else [])]

    def _own(self, name: str) -> Place:
        return Place(self.namespace, f"{self.prefix}-{name}")


def moment(release: Release, found: Mapping[Place, Files], now: datetime, built: datetime) -> datetime:
    """The time to go by: `now`, unless the clock can't be right. Then it is the latest time that surely has been.

    That is when the program was `built`, or the newest certificate was made: nothing that is good is renewed by it.
    """
    ends = [last for place in release.roles() if (last := end(found.get(place, {}).get(CERTIFICATE, b"")))]
    if not ends:
        return max(now, built)
    last = max(ends)
    return now if built <= now and now - max(built, last) <= FAR else max(built, last - LIFETIME)


def due(release: Release, found: Mapping[Place, Files], now: datetime) -> dict[Place, Files]:
    """The files to write, in this order: an authority before what it signs. What is missing in `found` is empty."""
    changes: dict[Place, Files] = {}
    if release.signing and not is_signing(found.get(release.key, {})):
        changes[release.key] = signing_files()
    if release.bus:
        changes |= _bus(release, found, now)
    return changes


def _bus(release: Release, found: Mapping[Place, Files], now: datetime) -> dict[Place, Files]:
    old = found.get(release.authority, {})
    issuer, files = _authority(f"{release.prefix}-bus", old, now)
    changes: dict[Place, Files] = {} if files.items() <= old.items() else {release.authority: files}
    bundle = files[CA]
    for place, role in release.roles().items():
        names, own = release.names if role == "router" else (), found.get(place, {})
        if own.get(CA) != bundle or not _lasts(own, now) or not is_of(own, issuer, role, names):
            changes[place] = {CA: bundle, **issuer.issue(role, names, now)}
    return changes


def _authority(name: str, old: Files, now: datetime) -> tuple[Issuer, Files]:
    """Who signs now, and the files of the authority's Secret: its heir is in every `ca.crt` before it signs.

    An heir's files stay in the Secret after it has succeeded.
    """
    issuer, heir = read_authority(old), read_authority(_heir_in(old))
    if heir and issuer and heir.certificate == issuer.certificate:
        heir = None
    if issuer is None or _left(issuer, now) < LIFETIME or (heir and _age(heir, now) >= LIFETIME):
        issuer, heir = heir or found_authority(name, now), None
    elif heir is None and _left(issuer, now) < SUCCEED + LIFETIME:
        heir = found_authority(name, now)
    own = [one.certificate for one in (issuer, heir) if one]
    files = {CA: _bundle(own, old, issuer, now), **authority_files(issuer)}
    return issuer, files | ({HEIRS[name]: file for name, file in authority_files(heir).items()} if heir else {})


def _bundle(own: Sequence[Certificate], old: Files, issuer: Issuer, now: datetime) -> bytes:
    """An authority that has ended goes when its successor has been here for longer than any certificate lasts."""
    stay = trusted(old, now if _age(issuer, now) > LIFETIME else BEGIN)
    if all(one in stay for one in own) and stay == trusted(old, BEGIN):
        return old[CA]
    return pem([*own, *(one for one in stay if one not in own)])


def _heir_in(files: Files) -> Files:
    return {name: files[file] for name, file in HEIRS.items() if file in files}


def _age(issuer: Issuer, now: datetime) -> timedelta:
    return AUTHORITY_LIFETIME - _left(issuer, now)


def _left(issuer: Issuer, now: datetime) -> timedelta:
    return issuer.certificate.not_valid_after_utc - now


def _lasts(files: Files, now: datetime) -> bool:
    last = end(files.get(CERTIFICATE, b""))
    return last is not None and last - now >= RENEW
