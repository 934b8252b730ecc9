"""Put containers back as they were before any policy, and remove policies' finalizers, without a running operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.actuators.resize.pod_patch import Patch, send
from contextpolicy.actuators.resize.stored_originals import raw_of, read
from contextpolicy.actuators.resize.vetting import Vetting
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.occupancy import LeaseReader
from contextpolicy.cluster.pods import view
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import FINALIZER

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures
    from contextpolicy.actuators.resize.vetting import Vetted
    from contextpolicy.cluster.occupancy import Occupancy
    from contextpolicy.cluster.pods import Cpu, PodView


class RestoreApi(pod_patch.ResizeApi, LeaseReader, Protocol):
    """The calls to the API server that a restoration needs."""

    def pods(self, namespace: str | None) -> Iterable[dict[str, Any]]:
        """The pods of a namespace, or of all (None), as they are read: together they may be too large to be kept."""

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        """The ContextPolicy objects of a namespace, or of all (None)."""

    def read(self, path: str) -> dict[str, Any]:
        """GET an object."""

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace a policy's finalizers; Conflict when it has changed since `version`."""


@dataclass(frozen=True, slots=True)
class Restored:
    """The outcome for one container that `policy` resized; `error` says why it could not be restored.

    Where the containers themselves are unknown, `container` names their pod.
    """

    container: str
    policy: str = ""
    moved: Cpu | None = None
    original: Cpu | None = None
    error: str = ""


@dataclass(frozen=True, slots=True)
class Released:
    """The outcome for one policy's finalizer; `error` says why it is still there."""

    policy: str
    error: str = ""


@dataclass(frozen=True, slots=True)
class LeftAlone:
    """A namespace with policies that another operator, `holder`, serves: what it has there is not touched."""

    namespace: str
    holder: str


@dataclass(frozen=True, slots=True)
class Unread:
    """A namespace (None: all of them) where it could not be found out what is to be restored."""

    namespace: str | None
    error: ActuationError


@dataclass(frozen=True, slots=True)
class _Part:
    """What one policy resized in one pod."""

    policy: str
    pod: PodView
    originals: Mapping[str, Cpu]
    unknown: Mapping[str, str]
    """Why the originals of some of its containers are unknown; the status then keeps its entry for the pod."""

    @property
    def rise(self) -> int:
        """How much restoring raises the sum of the pod's limits; its containers are restored in one patch."""
        moved = {container.name: container.spec.limit or 0 for container in self.pod.containers}
        return sum((cpu.limit or 0) - moved.get(name, 0) for name, cpu in self.originals.items())


def restore(
    api: RestoreApi, namespace: str | None, occupancy: Occupancy, signatures: EntrySignatures, *, dry_run: bool
) -> Iterator[Restored | LeftAlone | Unread]:
    """Restore every container whose original is in a policy's status, those that free the most CPU first.

    What the operator has not signed is not believed, as after its restart; a container of which nobody knows what it
    had is an error.

    Pods that have ended or are being deleted are left alone, as the operator does, and so are namespaces that another
    operator serves: it would resize the containers again, and what they had before would be lost.
    """
    try:
        policies, left = _ours(_policies(api, namespace), occupancy)
        pods = [view(pod) for pod in api.pods(namespace)]
    except ActuationError as error:
        yield Unread(namespace, error)
        return
    yield from left
    alive = {pod.uid: pod for pod in pods if not pod.ended}
    vetting = Vetting(signatures, api)
    for pod in alive.values():
        vetting.observe(pod)
    vetted = [(policy, vetting.vet(policy, None)) for policy in policies]
    parts = [part for policy, found in vetted for part in _parts(policy, found, alive)]
    gone: set[str] = set()
    for part in sorted(parts, key=lambda part: part.rise):
        # Another release may have taken the namespace meanwhile: a restore may take minutes.
        holder = _holder(occupancy, part.pod.namespace)
        if isinstance(holder, ActuationError):
            yield Restored(f"{part.pod.namespace}/{part.pod.name}", part.policy, error=_text(holder))
        elif not holder:
            yield from _restore_part(api, part, dry_run=dry_run)
        elif part.pod.namespace not in gone:
            gone.add(part.pod.namespace)
            yield LeftAlone(part.pod.namespace, holder)
    yield from (unread for policy, found in vetted for unread in _unreadable(policy, found))


def release(
    api: RestoreApi, namespace: str | None, occupancy: Occupancy, held: Collection[str], *, dry_run: bool
) -> Iterator[Released]:
    """Remove the finalizer of every policy of a namespace that no other operator serves.

    Those in `held` keep it: they have containers that are not restored yet.
    """
    try:
        policies, _ = _ours(_policies(api, namespace), occupancy)
    except ActuationError as error:
        yield Released(namespace or "all namespaces", _text(error))
        return
    for policy in policies:
        metadata = policy["metadata"]
        if FINALIZER not in metadata.get("finalizers", ()):
            continue
        reference = _reference(policy)
        if reference in held:
            yield Released(reference, "not all of its containers are restored")
        else:
            yield Released(reference, "" if dry_run else _take_off(api, metadata))


def _policies(api: RestoreApi, namespace: str | None) -> list[dict[str, Any]]:
    """None if their definition is gone: what they had stored went with it."""
    try:
        return api.policies(namespace)
    except ActuationError as error:
        if error.reason == "NotFound":
            return []
        raise


def _ours(
    policies: Sequence[Mapping[str, Any]], occupancy: Occupancy
) -> tuple[list[Mapping[str, Any]], list[LeftAlone]]:
    """The policies in namespaces that no other operator serves, and the other namespaces."""
    namespaces = sorted({policy["metadata"]["namespace"] for policy in policies})
    occupancy.settle(namespaces)
    holders = {namespace: occupancy.served_by(namespace) for namespace in namespaces}
    left = [LeftAlone(namespace, holder) for namespace, holder in holders.items() if holder]
    return [policy for policy in policies if not holders[policy["metadata"]["namespace"]]], left


def _holder(occupancy: Occupancy, namespace: str) -> str | ActuationError:
    try:
        return occupancy.served_by(namespace)
    except ActuationError as error:
        return error


def _parts(policy: Mapping[str, Any], vetted: Vetted, pods: Mapping[str, PodView]) -> Iterator[_Part]:
    """What is to be restored; nothing in pods that the status names without need."""
    reference, true = _reference(policy), vetted.stored.pods
    readable = dict(read(reference, raw_of(policy)))
    unknown = {(doubt.uid, doubt.name): doubt.text for doubt in vetted.doubts if not doubt.settled}
    for uid in sorted(readable.keys() | true.keys()):
        pod, containers = pods.get(uid), true[uid].containers if uid in true else {}
        if pod is not None and pod.namespace == policy["metadata"]["namespace"]:
            kept = {name: cpu for name, cpu in containers.items() if name in pod.by_name}
            kept |= {name: pod.by_name[name].spec for of, name in unknown if of == uid}
            yield _Part(reference, pod, kept, {name: unknown[uid, name] for name in kept if (uid, name) in unknown})


def _unreadable(policy: Mapping[str, Any], vetted: Vetted) -> Iterator[Restored]:
    reference, stored = _reference(policy), raw_of(policy)
    for uid in stored.keys() - dict(read(reference, stored)).keys() - vetted.stored.pods.keys():
        yield Restored(f"pod {uid}", reference, error=f"status.originals.{uid} of {reference} can't be read")


def _restore_part(api: RestoreApi, part: _Part, *, dry_run: bool) -> Iterator[Restored]:
    """The status entry is removed only after its containers are restored, so an interrupted run can be repeated."""
    pod, specs = part.pod, {container.name: container.spec for container in part.pod.containers}
    changed = {name: cpu for name, cpu in part.originals.items() if specs.get(name) != cpu}
    error = None
    if not dry_run:
        error = send(api, pod, Patch(part.policy, changed, restore=True)).error if changed else None
        error = error or (None if part.unknown else _forget(api, part))
    message = "" if error is None else _text(error)
    for name, cpu in sorted(part.originals.items()):
        yield Restored(container_id(pod, name), part.policy, specs.get(name), cpu, part.unknown.get(name, message))


def _forget(api: RestoreApi, part: _Part) -> ActuationError | None:
    namespace, _, name = part.policy.partition("/")
    try:
        api.write_originals(namespace, name, {part.pod.uid: None})
    except ActuationError as error:
        return error
    return None


def _take_off(api: RestoreApi, metadata: Mapping[str, Any]) -> str:
    """Remove the finalizer; returns why that failed, or an empty string."""
    rest = [finalizer for finalizer in metadata["finalizers"] if finalizer != FINALIZER]
    try:
        api.set_finalizers(metadata["namespace"], metadata["name"], rest, metadata["resourceVersion"])
    except ActuationError as error:
        return _text(error)
    return ""


def _reference(policy: Mapping[str, Any]) -> str:
    return f"{policy['metadata']['namespace']}/{policy['metadata']['name']}"


def _text(error: ActuationError) -> str:
    """Empty when the object is gone: then nothing is left to restore."""
    return "" if error.reason == "NotFound" else f"{error.reason}: {error}"
