"""Put containers back as they were before any policy, without a running operator."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.actuators.resize.pod_patch import Patch, send
from contextpolicy.actuators.resize.stored_originals import raw_of, read
from contextpolicy.actuators.resize.vetting import Vetting, VettingApi
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.occupancy import LeaseReader
from contextpolicy.cluster.pod_parsing import view
from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError, FindingsError
from contextpolicy.policy.custom_resource import FINALIZER
from contextpolicy.policy.parsing import parse

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures
    from contextpolicy.actuators.resize.vetting import Vetted
    from contextpolicy.cluster.occupancy import Occupancy
    from contextpolicy.cluster.pods import ContainerView, Cpu, PodView
    from contextpolicy.policy.spec import Policy

_ACTING, _SELECTING = ("mode", "shadow"), ("name", "selector", "container", "subtasks")


class RestoreApi(pod_patch.ResizeApi, LeaseReader, VettingApi, Protocol):
    """The calls to the API server that a restoration needs."""

    def pods(self, namespace: str | None) -> Iterable[dict[str, Any]]:
        """The pods of a namespace, or of all (None), as they are read: together they may be too large to be kept."""

    def policies(self, namespace: str | None) -> Iterable[dict[str, Any]]:
        """The ContextPolicy objects of a namespace, or of all (None), as they are read, for the same reason."""

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace a policy's finalizers; Conflict when it has changed since `version`."""


@dataclass(frozen=True, slots=True)
class Restored:
    """The outcome for one container that `policy` resized; `error` says why it could not be restored.

    `note` says why it keeps what it has, although its original is unknown. Where the containers themselves are unknown,
    `container` names their pod.
    """

    container: str
    policy: str = ""
    moved: Cpu | None = None
    original: Cpu | None = None
    error: str = ""
    note: str = ""


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
    held: bool
    """Whether the policy has our finalizer."""

    @property
    def lasting(self) -> bool:
        """Whether the entry is needed until the finalizer is gone.

        A container that a plan gave just what it had still counts as resized, as the API server records who changed a
        value last: without its entry, a repeated run would have to find out again what it had.
        """
        views = self.pod.by_name
        return self.held and any(_still_ours(views[name], cpu) for name, cpu in self.originals.items())

    @property
    def rise(self) -> int:
        """How much restoring raises the sum of the pod's limits; its containers are restored in one patch."""
        moved = {container.name: container.spec.limit or 0 for container in self.pod.containers}
        return sum((cpu.limit or 0) - moved.get(name, 0) for name, cpu in self.originals.items())


def restore(
    api: RestoreApi, namespace: str | None, occupancy: Occupancy, signatures: EntrySignatures, *, dry_run: bool
) -> Iterator[Restored | LeftAlone | Unread]:
    """Restore every container whose original is in a policy's status, those that free the most CPU first.

    As after an operator's restart, entries that it did not sign are not trusted, and removed entries are detected; a
    container without a known original is an error.

    Pods that have ended or are being deleted are left alone, as the operator does, and so are namespaces that another
    operator serves: it would resize the containers again, and what they had before would be lost.
    """
    parts: list[_Part] = []
    rest: list[Restored] = []
    try:
        holders = holders_of(policies_of(api, namespace), occupancy)
        alive = {pod.uid: pod for pod in map(view, api.pods(namespace)) if not pod.ended}
        for policy, found in _vetted(api, namespace, _vetting(api, signatures, alive.values()), free_of(holders)):
            parts += _parts(policy, found, alive)
            rest += [*_unreadable(policy, found), *_unknown(policy, found)]
    except ActuationError as error:
        yield Unread(namespace, error)
        return
    yield from _not_ours(holders)
    gone: set[str] = set()
    for part in sorted(parts, key=lambda part: part.rise):
        # Another release may have taken the namespace meanwhile: a restore may take minutes.
        holder = _holder(occupancy, part.pod.namespace)
        if isinstance(holder, ActuationError):
            yield Restored(f"{part.pod.namespace}/{part.pod.name}", part.policy, error=text_of(holder))
        elif not holder:
            yield from _restore_part(api, part, dry_run=dry_run)
        elif part.pod.namespace not in gone:
            gone.add(part.pod.namespace)
            yield LeftAlone(part.pod.namespace, holder)
    yield from rest


def settle(api: RestoreApi, namespaces: Iterable[str | None], occupancy: Occupancy) -> None:
    """Wait for the Leases of all of them (None: of the cluster) at once; those that can't be read fail later."""
    found: set[str] = set()
    for namespace in namespaces:
        with suppress(ActuationError):
            found |= {policy["metadata"]["namespace"] for policy in policies_of(api, namespace)}
    occupancy.settle(found)


def _vetting(api: RestoreApi, signatures: EntrySignatures, pods: Iterable[PodView]) -> Vetting:
    vetting = Vetting(signatures, api)
    for pod in pods:
        vetting.observe(pod)
    return vetting


def _vetted(
    api: RestoreApi, namespace: str | None, vetting: Vetting, free: Collection[str]
) -> Iterator[tuple[Mapping[str, Any], Vetted]]:
    """Each policy in the `free` namespaces with its originals, including those that were removed from its status.

    Only a policy with our finalizer can lack any: the finalizer goes once all its containers are restored. The list is
    read twice, as together the policies may be too large to be kept.
    """
    held: set[tuple[str, str]] = set()
    for body in _within(free, policies_of(api, namespace)):
        held |= vetting.held(body)
    for body in _within(free, policies_of(api, namespace)):
        resized = vetting.resized(body["metadata"]["namespace"])
        lacks = FINALIZER in _finalizers(body) and not resized <= held
        found = vetting.vet(body, _parsed(body), held) if lacks else vetting.vet(body, None, resized)
        held |= _known(found) & resized
        yield body, found


def _known(vetted: Vetted) -> set[tuple[str, str]]:
    entries = {(uid, name) for uid, pod in vetted.stored.pods.items() for name in pod.containers}
    return entries | {(doubt.uid, doubt.name) for doubt in vetted.doubts}


def _within(namespaces: Collection[str], policies: Iterable[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    return (body for body in policies if body["metadata"]["namespace"] in namespaces)


def _parsed(body: Mapping[str, Any]) -> Policy | None:
    """What a policy says of which containers it resizes; its conditions, a tenant's, may take many seconds to read."""
    spec = body.get("spec") or {}
    tasks = [{field: task[field] for field in _SELECTING if field in task} for task in spec.get("tasks") or ()]
    try:
        return parse({**body, "spec": {"tasks": tasks, **{field: spec[field] for field in _ACTING if field in spec}}})
    except FindingsError:
        return None


def _finalizers(body: Mapping[str, Any]) -> Sequence[str]:
    return body["metadata"].get("finalizers") or ()


def policies_of(api: RestoreApi, namespace: str | None) -> Iterator[dict[str, Any]]:
    """None if the custom resource definition is gone, and with it everything that the policies stored."""
    try:
        yield from api.policies(namespace)
    except ActuationError as error:
        if error.reason != "NotFound":
            raise


def holders_of(policies: Iterable[Mapping[str, Any]], occupancy: Occupancy) -> dict[str, str | ActuationError]:
    """By namespace of these policies, the other operator that serves it, empty for none; or why it is unknown."""
    namespaces = sorted({policy["metadata"]["namespace"] for policy in policies})
    occupancy.settle(namespaces)
    return {namespace: _holder(occupancy, namespace) for namespace in namespaces}


def free_of(holders: Mapping[str, str | ActuationError]) -> set[str]:
    """The namespaces that no other operator serves."""
    return {namespace for namespace, holder in holders.items() if not holder}


def _not_ours(holders: Mapping[str, str | ActuationError]) -> Iterator[LeftAlone | Unread]:
    for namespace, holder in holders.items():
        if holder:
            yield LeftAlone(namespace, holder) if isinstance(holder, str) else Unread(namespace, holder)


def _holder(occupancy: Occupancy, namespace: str) -> str | ActuationError:
    try:
        return occupancy.served_by(namespace)
    except ActuationError as error:
        return error


def _parts(policy: Mapping[str, Any], vetted: Vetted, pods: Mapping[str, PodView]) -> Iterator[_Part]:
    """What is to be restored; nothing in pods that the status names without need."""
    reference, true = reference_of(policy), vetted.stored.pods
    readable = dict(read(reference, raw_of(policy)))
    unknown = {(doubt.uid, doubt.name): doubt.text for doubt in vetted.doubts if not doubt.settled}
    for uid in sorted(readable.keys() | true.keys()):
        pod, containers = pods.get(uid), true[uid].containers if uid in true else {}
        if pod is not None and pod.namespace == policy["metadata"]["namespace"]:
            kept = {name: cpu for name, cpu in containers.items() if name in pod.by_name}
            kept |= {name: pod.by_name[name].spec for of, name in unknown if of == uid}
            doubts = {name: unknown[uid, name] for name in kept if (uid, name) in unknown}
            yield _Part(reference, pod, kept, doubts, held=FINALIZER in _finalizers(policy))


def _unreadable(policy: Mapping[str, Any], vetted: Vetted) -> Iterator[Restored]:
    reference, stored = reference_of(policy), raw_of(policy)
    for uid in stored.keys() - dict(read(reference, stored)).keys() - vetted.stored.pods.keys():
        yield Restored(f"pod {uid}", reference, error=f"status.originals.{uid} of {reference} can't be read")


def _unknown(policy: Mapping[str, Any], vetted: Vetted) -> Iterator[Restored]:
    for container, text in vetted.unknown.items():
        yield Restored(container, reference_of(policy), note=text)


def _restore_part(api: RestoreApi, part: _Part, *, dry_run: bool) -> Iterator[Restored]:
    """The status entry is removed only after its containers are restored, so an interrupted run can be repeated."""
    pod, specs = part.pod, {container.name: container.spec for container in part.pod.containers}
    changed = {name: cpu for name, cpu in part.originals.items() if specs.get(name) != cpu}
    error = None
    if not dry_run:
        error = send(api, pod, Patch(part.policy, changed, restore=True)).error if changed else None
        error = error or (None if part.unknown or part.lasting else forget(api, part.policy, [pod.uid]))
    message = "" if error is None else text_of(error)
    for name, cpu in sorted(part.originals.items()):
        yield Restored(container_id(pod, name), part.policy, specs.get(name), cpu, part.unknown.get(name, message))


def _still_ours(container: ContainerView, original: Cpu) -> bool:
    """Whether putting back its CPU leaves a value as it is that an operator has written."""
    by, spec = container.writers, container.spec
    return (by.request == FIELD_MANAGER and spec.request == original.request) or (
        by.limit == FIELD_MANAGER and spec.limit == original.limit
    )


def forget(api: RestoreApi, policy: str, uids: Iterable[str]) -> ActuationError | None:
    """Remove entries of a policy's status; returns why that failed."""
    namespace, _, name = policy.partition("/")
    try:
        api.write_originals(namespace, name, dict.fromkeys(uids))
    except ActuationError as error:
        return error
    return None


def reference_of(policy: Mapping[str, Any]) -> str:
    """A policy's `namespace/name`."""
    return f"{policy['metadata']['namespace']}/{policy['metadata']['name']}"


def text_of(error: ActuationError) -> str:
    """Empty when the object is gone: then nothing is left to restore."""
    return "" if error.reason == "NotFound" else f"{error.reason}: {error}"
