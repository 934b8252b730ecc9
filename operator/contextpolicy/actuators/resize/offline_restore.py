"""Put containers back as they were before any policy, and remove policies' finalizers, without a running operator."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.actuators.resize.originals import read
from contextpolicy.actuators.resize.pod_patch import Patch, send
from contextpolicy.cluster.api import FINALIZER
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.pods import view
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import Cpu, PodView


class RestoreApi(pod_patch.ResizeApi, Protocol):
    """The calls to the API server that a restoration needs."""

    def pods(self, namespace: str | None) -> list[dict[str, Any]]:
        """The pods of a namespace, or of all (None)."""

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        """The ContextPolicy objects of a namespace, or of all (None)."""

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace a policy's finalizers; Conflict when it has changed since `version`."""


@dataclass(frozen=True, slots=True)
class Restored:
    """The outcome for one container that `policy` resized; `error` says why it could not be restored.

    Where the containers themselves are unknown, `container` names their pod or namespace.
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
class _Part:
    """What one policy resized in one pod."""

    policy: str
    pod: PodView
    originals: Mapping[str, Cpu]

    @property
    def rise(self) -> int:
        """How much restoring raises the sum of the pod's limits; its containers are restored in one patch."""
        moved = {container.name: container.spec.limit or 0 for container in self.pod.containers}
        return sum((cpu.limit or 0) - moved.get(name, 0) for name, cpu in self.originals.items())


def restore(api: RestoreApi, namespace: str | None, *, dry_run: bool) -> Iterator[Restored]:
    """Restore every container whose original is in a policy's status, those that free the most CPU first.

    Pods that have ended or are being deleted are left alone, as the operator does.
    """
    try:
        policies, pods = api.policies(namespace), [view(pod) for pod in api.pods(namespace)]
    except ActuationError as error:
        yield Restored(namespace or "all namespaces", error=_text(error))
        return
    alive = {pod.uid: pod for pod in pods if not pod.ended}
    for part in sorted((part for policy in policies for part in _parts(policy, alive)), key=lambda part: part.rise):
        yield from _restore_part(api, part, dry_run=dry_run)
    yield from (unread for policy in policies for unread in _unreadable(policy))


def release(api: RestoreApi, namespace: str | None, held: Collection[str], *, dry_run: bool) -> Iterator[Released]:
    """Remove the finalizer of every policy except those in `held`, which have containers that are not restored yet."""
    try:
        policies = api.policies(namespace)
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


def _parts(policy: Mapping[str, Any], pods: Mapping[str, PodView]) -> Iterator[_Part]:
    reference = _reference(policy)
    for uid, (_, originals) in read(reference, _stored(policy)):
        pod = pods.get(uid)
        if pod is not None and pod.namespace == policy["metadata"]["namespace"]:
            kept = {name: cpu for name, cpu in originals.items() if name in pod.by_name}
            yield _Part(reference, pod, kept)


def _unreadable(policy: Mapping[str, Any]) -> Iterator[Restored]:
    reference, stored = _reference(policy), _stored(policy)
    for uid in stored.keys() - dict(read(reference, stored)).keys():
        yield Restored(f"pod {uid}", reference, error=f"status.originals.{uid} of {reference} can't be read")


def _restore_part(api: RestoreApi, part: _Part, *, dry_run: bool) -> Iterator[Restored]:
    """The status entry is removed only after its containers are restored, so an interrupted run can be repeated."""
    pod, specs = part.pod, {container.name: container.spec for container in part.pod.containers}
    changed = {name: cpu for name, cpu in part.originals.items() if specs.get(name) != cpu}
    error = None
    if not dry_run:
        error = send(api, pod, Patch(part.policy, changed, restore=True)).error if changed else None
        error = error or _forget(api, part)
    message = "" if error is None else _text(error)
    for name, cpu in sorted(part.originals.items()):
        yield Restored(container_id(pod, name), part.policy, specs.get(name), cpu, message)


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


def _stored(policy: Mapping[str, Any]) -> Mapping[str, Any]:
    return (policy.get("status") or {}).get("originals") or {}


def _text(error: ActuationError) -> str:
    """Empty when the object is gone: then there is nothing to restore."""
    return "" if error.reason == "NotFound" else f"{error.reason}: {error}"
