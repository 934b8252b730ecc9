"""After a restart: which originals in a status can be trusted, and what to use in place of the others.

While the operator runs it knows them and rewrites what others change. Who changes or empties a status while no operator
runs can't sign: then the pod's owner is asked. The API server records in each pod who wrote its CPU, which shows what
an operator has resized and not put back.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize.stored_originals import StoredPod, quantities, raw_of, read, stored_in
from contextpolicy.cluster import paging
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.matches import matches
from contextpolicy.cluster.pod_templates import OwnerApi, Templates
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import API, PLURAL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures, StoredOriginals
    from contextpolicy.cluster.pods import ContainerView, PodView
    from contextpolicy.policy.spec import Policy


WAY_OUT = "replace the pod"
WAY_OUT_OF_SIGNED = f"let the release that signed it serve the namespace, or {WAY_OUT}"


class VettingApi(paging.PageReader, OwnerApi, Protocol):
    """The calls to the API server that vetting needs."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """A container whose original in the status can't be trusted, with a message for users.

    `settled` says whether its owner's template says what it had; if not, the container keeps what it has. Where the
    status has an entry then, that stays as it is: it may be true, and signed by another release.
    """

    uid: str
    name: str
    text: str
    settled: bool


@dataclass(frozen=True, slots=True)
class Vetted:
    """A status's originals, and what was found wrong with them.

    `unknown` are containers, by name for people and with the reason, whose original may be lost under a policy that
    does not act.
    """

    stored: StoredOriginals
    doubts: tuple[Doubt, ...] = ()
    unknown: Mapping[str, str] = field(default_factory=dict)

    @property
    def news(self) -> str:
        """What to report to users; empty if nothing."""
        unknown = (f"{container}: {reason}" for container, reason in self.unknown.items())
        return "; ".join([*(doubt.text for doubt in self.doubts), *unknown])


class Vetting:
    """Called on any thread but the loop's, which it would block: it may read from the API server."""

    def __init__(self, signatures: EntrySignatures, api: VettingApi) -> None:
        self._signatures, self._api = signatures, api
        self._resized: dict[str, PodView] = {}
        """By UID, the pods in which the API has CPU that an operator has set and not put back."""

    def observe(self, pod: PodView) -> None:
        """A pod is new or has changed."""
        if any(_resized(container) for container in pod.containers) and not pod.ended:
            self._resized[pod.uid] = pod
        else:
            self._resized.pop(pod.uid, None)

    def forget(self, uid: str) -> None:
        """A pod is gone."""
        self._resized.pop(uid, None)

    def resized(self, namespace: str) -> set[tuple[str, str]]:
        """By pod UID and name, the containers of a namespace with CPU that an operator has set and not put back."""
        pods = self._pods(namespace)
        return {(pod.uid, container.name) for pod in pods for container in pod.containers if _resized(container)}

    def proven(self, body: Mapping[str, Any]) -> dict[str, StoredPod]:
        """By pod UID, the entries in the status of a ContextPolicy object that the operator wrote."""
        reference = f"{body['metadata']['namespace']}/{body['metadata']['name']}"
        return self._true(reference, dict(read(reference, raw_of(body))))

    def held(self, body: Mapping[str, Any]) -> set[tuple[str, str]]:
        """By pod UID and name, the resized containers whose originals a ContextPolicy object has."""
        resized = self.resized(body["metadata"]["namespace"])
        return {(uid, name) for uid, pod in self.proven(body).items() for name in pod.containers} & resized

    def vet(
        self, body: Mapping[str, Any], policy: Policy | None, held: Collection[tuple[str, str]] | None = None
    ) -> Vetted:
        """The originals of a ContextPolicy object; `policy` is its spec, None if that is invalid.

        `held` are the containers whose originals policies of its namespace have; None means that they are to be read.

        Of what a policy lacks that does not act, only what an owner's template says otherwise counts. Without a
        template it is unknown: a last plan may have given the container just what it had.
        """
        metadata = body["metadata"]
        namespace, reference = metadata["namespace"], f"{metadata['namespace']}/{metadata['name']}"
        every, pods = dict(read(reference, raw_of(body))), self._pods(namespace)
        true = self._true(reference, every)
        templates = Templates(self._api)
        lost = self._lost(reference, _resized_by(policy, pods), true, held)
        unknown: dict[str, str] = {}
        if not _acts(policy):
            bare = [(pod, name) for pod, name in lost if pod.uid not in every and name not in templates.cpu(pod)]
            unknown = {container_id(pod, name): _unknown(pod.by_name[name]) for pod, name in bare}
            lost = [(pod, name) for pod, name in lost if _differs(pod.by_name[name], templates.cpu(pod).get(name))]
        suspects = {(pod.name, name, pod.uid): pod for pod, name in (*self._unproven(pods, raw_of(body), true), *lost)}
        doubts: list[Doubt] = []
        unproven: dict[str, str] = {}
        unsigned = every.keys() - true.keys()
        for (_, name, _), pod in sorted(suspects.items(), key=lambda suspect: suspect[0]):
            container = pod.by_name[name]
            said = every[pod.uid].containers.get(name) if pod.uid in every else None
            template = templates.cpu(pod).get(name)
            found = _found(container, template)
            if template is None or found not in (said, container.spec if said is None else said):
                text = _text(pod, container, every.get(pod.uid), found, settled=template is not None)
                doubts.append(Doubt(pod.uid, name, text, template is not None))
                if template is None and pod.uid in unsigned:
                    unproven.setdefault(pod.uid, text)
            entry = true.setdefault(pod.uid, StoredPod(pod.name, {}, agent=pod.uid in every and every[pod.uid].agent))
            entry.containers[name] = found
        known = {uid: entry for uid, entry in true.items() if uid not in unproven}
        reported = tuple(doubt for doubt in doubts if not (doubt.settled and doubt.uid in unproven))
        return Vetted(replace(stored_in(body), pods=known, unproven=unproven), reported, unknown)

    def _true(self, reference: str, every: Mapping[str, StoredPod]) -> dict[str, StoredPod]:
        return {uid: entry for uid, entry in every.items() if self._signatures.prove(reference, uid, entry)}

    def _pods(self, namespace: str) -> list[PodView]:
        return [pod for pod in list(self._resized.values()) if pod.namespace == namespace]

    def _unproven(
        self, pods: list[PodView], raw: Mapping[str, Any], true: Mapping[str, StoredPod]
    ) -> Iterator[tuple[PodView, str]]:
        """The resized containers of pods with an entry in the status that this operator did not sign."""
        for pod in pods:
            if pod.uid in raw and pod.uid not in true:
                yield from ((pod, container.name) for container in pod.containers if _resized(container))

    def _lost(
        self,
        reference: str,
        selected: Iterable[tuple[PodView, ContainerView]],
        true: Mapping[str, StoredPod],
        held: Collection[tuple[str, str]] | None,
    ) -> list[tuple[PodView, str]]:
        """The resized containers among those selected that have no entry in any policy's status."""
        lost = [
            (pod, container.name)
            for pod, container in selected
            if _resized(container) and not (pod.uid in true and container.name in true[pod.uid].containers)
        ]
        if held is None:
            held = self._others(reference) if lost else ()
        return [(pod, name) for pod, name in lost if (pod.uid, name) not in held]

    def _others(self, reference: str) -> set[tuple[str, str]]:
        """By pod UID and name, the resized containers whose originals are in other policies' statuses."""
        namespace, _, own = reference.partition("/")
        found = paging.items(self._api, f"{API}/namespaces/{namespace}/{PLURAL}")
        try:
            return {one for body in found if body["metadata"]["name"] != own for one in self.held(body)}
        except ActuationError:
            return set()


def _acts(policy: Policy | None) -> bool:
    return policy is not None and policy.mode.acts and policy.shadow is None


def _resized_by(policy: Policy | None, pods: list[PodView]) -> Iterator[tuple[PodView, ContainerView]]:
    """What a policy may have resized: what it selects, or anything while its spec is invalid."""
    if policy is None:
        yield from ((pod, container) for pod in pods for container in pod.containers)
    else:
        yield from ((pod, container) for _, pod, container in matches(policy, pods))


def _resized(container: ContainerView) -> bool:
    """Whether an operator has set its CPU, and not put it back."""
    return FIELD_MANAGER in (container.writers.request, container.writers.limit)


def _differs(container: ContainerView, template: Cpu | None) -> bool:
    """Whether the container's CPU differs from that of its template."""
    return template is not None and _found(container, template) != container.spec


def _found(container: ContainerView, template: Cpu | None) -> Cpu:
    """The container's original: what we did not write is unchanged, the rest comes from its template, if any."""
    spec, by = container.spec, container.writers
    request = template.request if template and by.request == FIELD_MANAGER else None
    limit = template.limit if template and by.limit == FIELD_MANAGER else None
    return Cpu(spec.request if request is None else request, spec.limit if limit is None else limit)


def _text(pod: PodView, container: ContainerView, entry: StoredPod | None, found: Cpu, *, settled: bool) -> str:
    said = entry.containers.get(container.name) if entry else None
    stored = f"has {_amounts(said)}, {_signed_by(entry)}" if said else "no longer has an entry"
    if settled and pod.owner is not None:
        rest = f"using {_amounts(found)} from {pod.owner.kind} {pod.owner.name}"
    else:
        rest = f"no owner of the pod states its original CPU, so it keeps {_amounts(found)}"
        if entry:
            rest += f", and the entry stays; {WAY_OUT_OF_SIGNED if entry.signature else WAY_OUT}"
    return f"{container_id(pod, container.name)}: status.originals {stored}; {rest}"


def _unknown(container: ContainerView) -> str:
    return (
        "an operator resized it, and no status.originals has an entry for it; "
        f"no owner of the pod states its original, so it keeps {_amounts(container.spec)}"
    )


def _signed_by(entry: StoredPod | None) -> str:
    return "signed with another key than this release's" if entry and entry.signature else "not signed by the operator"


def _amounts(cpu: Cpu) -> str:
    return ", ".join(f"{kind} {amount}" for kind, amount in quantities(cpu).items()) or "no CPU"
