"""Whether an operator serves a namespace, as its Lease and the API server's clock say. Pure."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any, NamedTuple

from contextpolicy.cluster.lease import ACT, read

if TYPE_CHECKING:
    from collections.abc import Mapping

UNITS = ((86400, "days"), (3600, "h"), (60, "min"))
"""Units for a time of at least two of them, with the seconds of each."""


class Service(NamedTuple):
    """`served` is None where the caller may not read the Lease.

    `silent`: the seconds for which no operator has served the namespace; None where one does, or nobody knows.
    """

    served: bool | None
    silent: int | None = None

    def sentence(self, namespace: str) -> str:
        """The warning to print; empty where an operator serves the namespace."""
        if self.served is None:
            return f"cannot tell whether an operator serves namespace {namespace}: no permission to read its Lease"
        if self.silent is None:
            return "" if self.served else f"no operator serves namespace {namespace}"
        return f"no operator has served namespace {namespace} for {_readable(self.silent)}"


def service(lease: Mapping[str, Any] | None, now: datetime) -> Service:
    """Judge a Lease as the API has it, None if there is none; `now` is by the API server's clock.

    So is the time that the API server notes when it writes, whereas that in the Lease is by the holder's clock, which
    may be wrong: it counts only where there is no other.
    """
    if lease is None:
        return Service(served=False)
    content = read(lease)
    notes = [_time(note.get("time")) for note in lease["metadata"].get("managedFields") or ()]
    written = max(filter(None, notes), default=_time(content.renewed))
    if written is None:
        return Service(served=False)
    silent = max(0, int((now - written).total_seconds()))
    if content.holder and silent <= ACT * content.seconds:
        return Service(served=True)
    return Service(served=False, silent=silent)


def _time(text: object) -> datetime | None:
    try:
        found = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return found if found.tzinfo else found.replace(tzinfo=UTC)


def _readable(seconds: int) -> str:
    return next((f"{seconds // size} {unit}" for size, unit in UNITS if seconds >= 2 * size), f"{seconds} s")
