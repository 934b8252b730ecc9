"""The policies that one operator knows: those in force with their runners, and those on their way out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from contextpolicy.cluster.pod_parsing import version_of
from contextpolicy.policies.loader import Loaded
from contextpolicy.telemetry.event_budget import EventBudget

if TYPE_CHECKING:
    from collections.abc import Mapping

    from contextpolicy.policies.policy_runner import PolicyRunner


@dataclass(slots=True)
class PolicyEntry:
    """One ContextPolicy object, with a runner once one of its versions was valid.

    `good` is its last valid version, of this `generation`; `stand_in` the promoted shadow that decides in its place;
    `reverted`, of a shadow, the promotion that the operator has undone, as the status has it.
    """

    body: Mapping[str, Any]
    loaded: Loaded = field(default_factory=Loaded)
    good: Loaded | None = None
    generation: int = 0
    stand_in: PolicyEntry | None = None
    reverted: Mapping[str, Any] | None = None
    runner: PolicyRunner | None = None
    conditions: list[dict[str, Any]] = field(default_factory=list)
    events: EventBudget = field(default_factory=EventBudget)

    @property
    def namespace(self) -> str:
        """Where the policy and its pods live."""
        return str(self.body["metadata"]["namespace"])

    @property
    def in_force(self) -> Mapping[str, Any]:
        """The object as it is carried out: with the spec of its promoted shadow, if it has one."""
        if self.stand_in is None:
            return self.body
        spec = {field: value for field, value in self.stand_in.body["spec"].items() if field not in ("shadow", "mode")}
        return {**self.body, "spec": spec}

    @property
    def age(self) -> tuple[str, str]:
        """Sort key: oldest first, ties by name."""
        return self.body["metadata"].get("creationTimestamp", ""), reference_of(self.body)


@dataclass(slots=True)
class LeavingPolicy:
    """A ContextPolicy that is being deleted, until all its containers are restored."""

    body: Mapping[str, Any]
    conditions: list[dict[str, Any]]
    events: EventBudget = field(default_factory=EventBudget)


class PolicyRegistry:
    """Entries by reference; everything on the loop's thread. A policy that is created again while it leaves, stays."""

    def __init__(self) -> None:
        self.present: dict[str, PolicyEntry] = {}
        self.leaving: dict[str, LeavingPolicy] = {}

    def find(self, reference: str) -> PolicyEntry | LeavingPolicy | None:
        """The entry, whether it stays or leaves."""
        return self.present.get(reference) or self.leaving.get(reference)

    def runner(self, reference: str) -> PolicyRunner | None:
        """What runs of the policy; None when no version of it does."""
        entry = self.present.get(reference)
        return entry.runner if entry is not None else None

    def runners(self) -> list[PolicyRunner]:
        """Everything that runs, the oldest policy first."""
        entries = sorted(self.present.values(), key=lambda entry: entry.age)
        return [entry.runner for entry in entries if entry.runner is not None]

    def namespaces(self) -> set[str]:
        """Where policies are."""
        return {entry.namespace for entry in self.present.values()}


def reference_of(body: Mapping[str, Any]) -> str:
    """The `namespace/name` of a ContextPolicy object."""
    return f"{body['metadata']['namespace']}/{body['metadata']['name']}"


def uid_of(body: Mapping[str, Any]) -> str:
    """The UID of the object: one that is deleted and made again under the same name has another."""
    return str(body["metadata"].get("uid", ""))


def is_former(body: Mapping[str, Any], present: Mapping[str, Any]) -> bool:
    """Whether the present object came under the name of this one, which kopf may show late: each has its own queue."""
    another = uid_of(body) != uid_of(present)
    return another and version_of(body["metadata"]) < version_of(present["metadata"])


def conditions_of(body: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The conditions that its status has."""
    return list((body.get("status") or {}).get("conditions") or [])
