"""Put containers back as they were before any policy, and let policies go, when there is no operator to do it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize import pod_patch
from contextpolicy.actuators.resize.originals import read
from contextpolicy.actuators.resize.pod_patch import Patch, send
from contextpolicy.cluster.api import FINALIZER
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import view
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import Cpu, PodView


class RestoreApi(pod_patch.ResizeApi, Protocol):
    """What a restoration needs of the API server."""

    def pods(self, namespace: str | None) -> list[dict[str, Any]]:
        """Pods of a namespace, or of all."""

    def policies(self, namespace: str | None) -> list[dict[str, Any]]:
        """ContextPolicy objects of a namespace, or of all."""

    def set_finalizers(self, namespace: str, name: str, finalizers: Sequence[str], version: str) -> None:
        """Replace a policy's finalizers."""


@dataclass(frozen=True, slots=True)
class Restored:
    """What became of one container that `policy` moved; `error` says why it is not as it was before.

    Where containers could not even be found out, `container` is their pod or namespace.
    """

    container: str
    policy: str = ""
    moved: Cpu | None = None
    original: Cpu | None = None
    error: str = ""


@dataclass(frozen=True, slots=True)
class Released:
    """What became of one policy's finalizer; `error` says why it still has it."""

    policy: str
    error: str = ""


@dataclass(frozen=True, slots=True)
class _Part:
    """What one policy moved in one pod."""

    policy: str
    pod: PodView
    originals: Mapping[str, Cpu]

    @property
    def rise(self) -> int:
        """By how much the limits rise altogether when it is put back; its containers move at once."""
        moved = {container.name: container.spec.limit or 0 for container in self.pod.containers}
        return sum((cpu.limit or 0) - moved.get(name, 0) for name, cpu in self.originals.items())


def restore(api: RestoreApi, namespace: str | None, *, dry_run: bool) -> Iterator[Restored]:
    """Put back every container that a policy's status has the original of; what gives the most CPU back comes first.

    Pods that have ended, or are ending, are left alone, as the operator does.
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
    """Take the finalizer off every policy but those that are `held`: some of their containers are not back yet."""
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
            kept = {name: cpu for name, cpu in originals.items() if pod.container(name) is not None}
            yield _Part(reference, pod, kept)


def _unreadable(policy: Mapping[str, Any]) -> Iterator[Restored]:
    reference, stored = _reference(policy), _stored(policy)
    for uid in stored.keys() - dict(read(reference, stored)).keys():
        yield Restored(f"pod {uid}", reference, error=f"status.originals.{uid} of {reference} can't be read")


def _restore_part(api: RestoreApi, part: _Part, *, dry_run: bool) -> Iterator[Restored]:
    """The note goes when the containers are back, so that whatever stops this can be followed by another try."""
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
    """Returns why it could not be done."""
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
    """Nothing when what was to be put back has gone in the meantime."""
    return "" if error.reason == "NotFound" else f"{error.reason}: {error}"
