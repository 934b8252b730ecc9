"""Containers that an operator has resized and whose originals no status proves: what counts for them, and why. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.actuators.resize.stored_originals import StoredPod, quantities
from contextpolicy.cluster.container_names import container_id
from contextpolicy.cluster.pods import Cpu
from contextpolicy.cluster.writers import FIELD_MANAGER

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping

    from contextpolicy.cluster.pods import ContainerView, PodView

WAY_OUT = "replace the pod"
WAY_OUT_OF_SIGNED = f"let the release that signed it serve the namespace, or {WAY_OUT}"


@dataclass(frozen=True, slots=True)
class Suspect:
    """A resized container; `entry` is what the status has of its pod, `template` what the pod's owner says it had."""

    pod: PodView
    container: ContainerView
    entry: StoredPod | None
    template: Cpu | None

    @property
    def place(self) -> tuple[str, str, str]:
        """Identifies the container, and sorts it for people."""
        return self.pod.name, self.container.name, self.pod.uid

    @property
    def stored(self) -> Cpu | None:
        """Its original by the status."""
        return self.entry.containers.get(self.container.name) if self.entry else None

    @property
    def original(self) -> Cpu:
        """What counts: what we did not write is unchanged, the rest comes from its template, if any."""
        spec, by, template = self.container.spec, self.container.writers, self.template
        request = template.request if template and by.request == FIELD_MANAGER else None
        limit = template.limit if template and by.limit == FIELD_MANAGER else None
        return Cpu(spec.request if request is None else request, spec.limit if limit is None else limit)

    @property
    def differs(self) -> bool:
        """Whether its CPU differs from that of its template."""
        return self.template is not None and self.original != self.container.spec

    @property
    def doubtful(self) -> bool:
        """Whether its template does not confirm its entry, nor excuse a missing one."""
        stored = self.container.spec if self.stored is None else self.stored
        return self.template is None or self.original != stored


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


def doubts_about(suspects: Iterable[Suspect]) -> list[Doubt]:
    """Those that are doubtful."""
    return [
        Doubt(one.pod.uid, one.container.name, _text(one), settled=one.template is not None)
        for one in suspects
        if one.doubtful
    ]


def unproven(doubts: Iterable[Doubt], unsigned: Collection[str]) -> dict[str, str]:
    """The pods, by UID, whose entries can neither be proven nor disproven, with the reason; `unsigned` have entries."""
    reasons: dict[str, str] = {}
    for doubt in doubts:
        if not doubt.settled and doubt.uid in unsigned:
            reasons.setdefault(doubt.uid, doubt.text)
    return reasons


def completed(true: Mapping[str, StoredPod], suspects: Iterable[Suspect]) -> dict[str, StoredPod]:
    """The true entries, by pod UID, and what counts for the suspects."""
    entries = dict(true)
    for one in suspects:
        agent = one.entry is not None and one.entry.agent
        entry = entries.get(one.pod.uid, StoredPod(one.pod.name, {}, agent=agent))
        originals = {**entry.containers, one.container.name: one.original}
        entries[one.pod.uid] = entry._replace(containers=originals)
    return entries


def unknown_among(suspects: Iterable[Suspect]) -> dict[str, str]:
    """By name for people, the containers of which nothing says what they had, with the reason."""
    return {
        container_id(one.pod, one.container.name): (
            "an operator resized it, and no status.originals has an entry for it; "
            f"no owner of the pod states its original, so it keeps {_amounts(one.container.spec)}"
        )
        for one in suspects
        if one.entry is None and one.template is None
    }


def _text(suspect: Suspect) -> str:
    entry, owner, said = suspect.entry, suspect.pod.owner, suspect.stored
    stored = f"has {_amounts(said)}, {_signed_by(entry)}" if said else "no longer has an entry"
    if suspect.template is not None and owner is not None:
        rest = f"using {_amounts(suspect.original)} from {owner.kind} {owner.name}"
    else:
        rest = f"no owner of the pod states its original CPU, so it keeps {_amounts(suspect.original)}"
        if entry:
            rest += f", and the entry stays; {WAY_OUT_OF_SIGNED if entry.signature else WAY_OUT}"
    return f"{container_id(suspect.pod, suspect.container.name)}: status.originals {stored}; {rest}"


def _signed_by(entry: StoredPod | None) -> str:
    return "signed with another key than this release's" if entry and entry.signature else "not signed by the operator"


def _amounts(cpu: Cpu) -> str:
    return ", ".join(f"{kind} {amount}" for kind, amount in quantities(cpu).items()) or "no CPU"
