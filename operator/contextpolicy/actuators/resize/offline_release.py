"""Let go of policies whose containers are restored, without a running operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from contextpolicy.actuators.resize.offline_restore import (
    forget,
    free_of,
    holders_of,
    policies_of,
    reference_of,
    text_of,
)
from contextpolicy.actuators.resize.stored_originals import raw_of, read
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping

    from contextpolicy.actuators.resize.offline_restore import RestoreApi
    from contextpolicy.actuators.resize.stored_originals import EntrySignatures
    from contextpolicy.cluster.occupancy import Occupancy


@dataclass(frozen=True, slots=True)
class Released:
    """The outcome for one policy's finalizer; `error` says why it is still there."""

    policy: str
    error: str = ""


def release(  # noqa: PLR0913 - as `restore`, and what came of it
    api: RestoreApi,
    namespace: str | None,
    occupancy: Occupancy,
    signatures: EntrySignatures,
    held: Collection[str],
    *,
    dry_run: bool,
) -> Iterator[Released]:
    """Remove the finalizer of every policy of a namespace that no other operator serves, then our entries' rest.

    The policies and namespaces in `held` have containers that are not restored yet.
    """
    try:
        holders = holders_of(filter(_has_finalizer, policies_of(api, namespace)), occupancy)
        free = free_of(holders)
        for policy in filter(_has_finalizer, policies_of(api, namespace)):
            reference, where = reference_of(policy), policy["metadata"]["namespace"]
            holder = holders.get(where)
            if isinstance(holder, ActuationError):
                yield Released(reference, f"{holder.reason}: {holder}")
            elif where in free and (reference in held or where in held):
                yield Released(reference, "not all of its containers are restored")
            elif where in free:
                yield Released(reference, "" if dry_run else _let_go(api, policy, signatures))
    except ActuationError as error:
        yield Released(namespace or "all namespaces", text_of(error))


def in_need(
    api: RestoreApi, namespace: str | None, left: Collection[str], signatures: EntrySignatures
) -> Iterator[str]:
    """The policies that still need the key: in namespaces that were left alone, or with our finalizer."""
    for policy in policies_of(api, namespace):
        kept = policy["metadata"]["namespace"] in left or _has_finalizer(policy)
        if kept and _signed(policy, signatures):
            yield reference_of(policy)


def _let_go(api: RestoreApi, policy: Mapping[str, Any], signatures: EntrySignatures) -> str:
    """Remove the finalizer, then the entries; returns why that failed, or an empty string."""
    metadata = policy["metadata"]
    rest = [finalizer for finalizer in metadata["finalizers"] if finalizer != FINALIZER]
    try:
        api.set_finalizers(metadata["namespace"], metadata["name"], rest, metadata["resourceVersion"])
    except ActuationError as error:
        return text_of(error)
    signed = _signed(policy, signatures)
    failure = forget(api, reference_of(policy), signed) if signed else None
    return "" if failure is None else text_of(failure)


def _signed(policy: Mapping[str, Any], signatures: EntrySignatures) -> list[str]:
    reference = reference_of(policy)
    return [uid for uid, entry in read(reference, raw_of(policy)) if signatures.prove(reference, uid, entry)]


def _has_finalizer(policy: Mapping[str, Any]) -> bool:
    return FINALIZER in (policy["metadata"].get("finalizers") or ())
