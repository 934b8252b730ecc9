"""Put containers back as they were before any policy, and let policies go, when there is no operator to do it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize import pod_job
from contextpolicy.actuators.resize.pod_job import Job, carry_out
from contextpolicy.cluster.api import FINALIZER
from contextpolicy.cluster.claims import container_id
from contextpolicy.cluster.pods import ORIGINALS, Cpu, view
from contextpolicy.errors import ActuationError

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from contextpolicy.cluster.pods import PodView


class RestoreApi(pod_job.ResizeApi, Protocol):
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


def restore(api: RestoreApi, namespace: str | None, *, dry_run: bool) -> Iterator[Restored]:
    """Put back every container that has a note of what it was; pods that give the most CPU back come first.

    Pods that have ended, or are ending, are left alone, as the operator does.
    """
    try:
        pods = api.pods(namespace)
    except ActuationError as error:
        yield Restored(namespace or "all namespaces", error=_text(error))
        return
    noted = [view(pod) for pod in pods if ORIGINALS in (pod["metadata"].get("annotations") or {})]
    for seen in sorted((pod for pod in noted if not pod.ended), key=_rise):
        if seen.originals:
            yield from _restore_pod(api, seen, dry_run=dry_run)
        else:
            yield Restored(f"{seen.namespace}/{seen.name}", error=f"its annotation {ORIGINALS} can't be read")


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
        reference = f"{metadata['namespace']}/{metadata['name']}"
        if reference in held:
            yield Released(reference, "not all of its containers are restored")
        else:
            yield Released(reference, "" if dry_run else _take_off(api, metadata))


def _rise(pod: PodView) -> int:
    """By how much the limits of a pod rise altogether when it is put back; its containers move at once."""
    moved = {container.name: container.spec.limit or 0 for container in pod.containers}
    return sum((original.cpu.limit or 0) - moved.get(name, 0) for name, original in pod.originals.items())


def _restore_pod(api: RestoreApi, pod: PodView, *, dry_run: bool) -> Iterator[Restored]:
    wanted = {name: original.cpu for name, original in pod.originals.items()}
    specs = {container.name: container.spec for container in pod.containers}
    changed = {name: cpu for name, cpu in wanted.items() if specs.get(name) != cpu}
    job = Job("", pod, wanted, changed, originals={}, note=True, restore=True)
    error = None if dry_run else carry_out(api, job).error
    message = "" if error is None else _text(error)
    for name, original in sorted(pod.originals.items()):
        yield Restored(container_id(pod, name), original.policy, specs.get(name), original.cpu, message)


def _take_off(api: RestoreApi, metadata: Mapping[str, Any]) -> str:
    """Returns why it could not be done."""
    rest = [finalizer for finalizer in metadata["finalizers"] if finalizer != FINALIZER]
    try:
        api.set_finalizers(metadata["namespace"], metadata["name"], rest, metadata["resourceVersion"])
    except ActuationError as error:
        return _text(error)
    return ""


def _text(error: ActuationError) -> str:
    """Nothing when what was to be put back has gone in the meantime."""
    return "" if error.reason == "NotFound" else f"{error.reason}: {error}"
