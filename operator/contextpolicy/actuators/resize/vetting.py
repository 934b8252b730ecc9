"""After a restart: which originals in a status can be trusted, and what to use in place of the others.

While the operator runs it knows them and rewrites what others change. Who changes or empties a status while no operator
runs can't sign: then the pod's owner is asked. The API server records in each pod who wrote its CPU, which shows what
an operator has resized and not put back.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Protocol

from contextpolicy.actuators.resize.stored_originals import raw_of, read, stored_in
from contextpolicy.actuators.resize.suspects import Suspect, completed, doubts_about, unknown_among, unproven
from contextpolicy.cluster import paging
from contextpolicy.cluster.matches import matches
from contextpolicy.cluster.pod_templates import OwnerApi, Templates
from contextpolicy.cluster.writers import FIELD_MANAGER
from contextpolicy.errors import ActuationError
from contextpolicy.policy.custom_resource import API, PLURAL

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Mapping

    from contextpolicy.actuators.resize.stored_originals import EntrySignatures, StoredOriginals, StoredPod
    from contextpolicy.actuators.resize.suspects import Doubt
    from contextpolicy.cluster.pods import ContainerView, PodView
    from contextpolicy.policy.spec import Policy


class VettingApi(paging.PageReader, OwnerApi, Protocol):
    """The calls to the API server that vetting needs."""


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
        namespace, name = body["metadata"]["namespace"], body["metadata"]["name"]
        reference, pods = f"{namespace}/{name}", self._pods(namespace)
        every = dict(read(reference, raw_of(body)))
        true, templates = self._true(reference, every), Templates(self._api)

        def suspected(found: Iterable[tuple[PodView, ContainerView]]) -> list[Suspect]:
            return [Suspect(pod, one, every.get(pod.uid), templates.cpu(pod).get(one.name)) for pod, one in found]

        lost = suspected(self._lost(reference, _resized_by(policy, pods), true, held))
        unsigned = suspected(_unsigned(pods, raw_of(body).keys() - true.keys()))
        if _acts(policy):
            return _vetted(stored_in(body), every, true, [*unsigned, *lost])
        suspects = [*unsigned, *(one for one in lost if one.differs)]
        return replace(_vetted(stored_in(body), every, true, suspects), unknown=unknown_among(lost))

    def _true(self, reference: str, every: Mapping[str, StoredPod]) -> dict[str, StoredPod]:
        return {uid: entry for uid, entry in every.items() if self._signatures.prove(reference, uid, entry)}

    def _pods(self, namespace: str) -> list[PodView]:
        return [pod for pod in list(self._resized.values()) if pod.namespace == namespace]

    def _lost(
        self,
        reference: str,
        selected: Iterable[tuple[PodView, ContainerView]],
        true: Mapping[str, StoredPod],
        held: Collection[tuple[str, str]] | None,
    ) -> list[tuple[PodView, ContainerView]]:
        """The resized containers among those selected that have no entry in any policy's status."""
        lost = [
            (pod, container)
            for pod, container in selected
            if _resized(container) and not (pod.uid in true and container.name in true[pod.uid].containers)
        ]
        if held is None:
            held = self._others(reference) if lost else ()
        return [(pod, container) for pod, container in lost if (pod.uid, container.name) not in held]

    def _others(self, reference: str) -> set[tuple[str, str]]:
        """By pod UID and name, the resized containers whose originals are in other policies' statuses."""
        namespace, _, own = reference.partition("/")
        found = paging.items(self._api, f"{API}/namespaces/{namespace}/{PLURAL}")
        try:
            return {one for body in found if body["metadata"]["name"] != own for one in self.held(body)}
        except ActuationError:
            return set()


def _vetted(
    stored: StoredOriginals, every: Mapping[str, StoredPod], true: Mapping[str, StoredPod], found: Iterable[Suspect]
) -> Vetted:
    """The verdict on the entries of a status, of which the true ones are proven, and on the containers suspected."""
    suspects = sorted({one.place: one for one in found}.values(), key=lambda one: one.place)
    doubts = doubts_about(suspects)
    kept = unproven(doubts, every.keys() - true.keys())
    pods = {uid: entry for uid, entry in completed(true, suspects).items() if uid not in kept}
    reported = tuple(doubt for doubt in doubts if not (doubt.settled and doubt.uid in kept))
    return Vetted(replace(stored, pods=pods, unproven=kept), reported)


def _acts(policy: Policy | None) -> bool:
    return policy is not None and policy.mode.acts and policy.shadow is None


def _resized_by(policy: Policy | None, pods: list[PodView]) -> Iterator[tuple[PodView, ContainerView]]:
    """What a policy may have resized: what it selects, or anything while its spec is invalid."""
    if policy is None:
        yield from ((pod, container) for pod in pods for container in pod.containers)
    else:
        yield from ((pod, container) for _, pod, container in matches(policy, pods))


def _unsigned(pods: list[PodView], uids: Collection[str]) -> Iterator[tuple[PodView, ContainerView]]:
    """The resized containers of pods whose entries in the status this operator did not sign."""
    for pod in pods:
        if pod.uid in uids:
            yield from ((pod, container) for container in pod.containers if _resized(container))


def _resized(container: ContainerView) -> bool:
    """Whether an operator has set its CPU, and not put it back."""
    return FIELD_MANAGER in (container.writers.request, container.writers.limit)
