"""Which policies are shadows of which, and the results of their trials. State without effects."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from contextpolicy.policies.registry import reference_of
from contextpolicy.telemetry.status import ShadowFacts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from contextpolicy.bus.health_watch import HealthWatch
    from contextpolicy.policies.registry import PolicyEntry, PolicyRegistry
    from contextpolicy.policy.spec import Policy, Shadow
    from contextpolicy.shadow.probation import Probation


@dataclass(slots=True)
class ShadowTrial:
    """A shadow beside `original`, the other policy's own version."""

    original: Policy
    probation: Probation
    watch: HealthWatch
    promoted: bool = False


class Shadows:
    """Everything on the loop's thread."""

    def __init__(self, registry: PolicyRegistry) -> None:
        self.trials: dict[str, ShadowTrial] = {}
        """By the shadow's reference."""
        self._registry = registry

    def original(self, entry: PolicyEntry) -> PolicyEntry | None:
        """The policy that this one shadows, if it runs."""
        shadow = shadow_of(entry)
        other = None if shadow is None else self._registry.present.get(f"{entry.namespace}/{shadow.of}")
        return other if other is not None and other.good is not None and shadow_of(other) is None else None

    def beside(self, reference: str) -> Iterator[str]:
        """The shadows whose trials compare them with this policy: their statuses change with its plans."""
        return (shadow for shadow, trial in self.trials.items() if trial.original.reference == reference)

    def facts(self, reference: str) -> ShadowFacts | None:
        """What the status of a shadow says about it; None for any other policy."""
        entry = self._registry.present.get(reference)
        original = None if entry is None else self.original(entry)
        if entry is None or original is None:
            return None
        trial, rival = self.trials.get(reference), original.stand_in
        tasks = trial.probation.tasks if trial else ()
        return ShadowFacts(
            promoted=rival is entry,
            decided=original.runner.planner.last if original.runner and rival is not entry else None,
            misses={task: (trial.probation.before(task), trial.probation.since(task)) for task in tasks if trial},
            reverted=entry.reverted,
            is_reverted=is_reverted(entry),
            rival=reference_of(rival.body) if rival is not None and rival is not entry and wants(entry) else "",
        )


def shadow_of(entry: PolicyEntry) -> Shadow | None:
    """The policy's `shadow` field, if it is a shadow."""
    return entry.good.policy.shadow if entry.good is not None and entry.good.policy is not None else None


def wants(entry: PolicyEntry) -> bool:
    """Whether a user has promoted it, and the operator has not reverted that."""
    policy = entry.good.policy if entry.good is not None else None
    return policy is not None and policy.mode.acts and not is_reverted(entry)


def is_reverted(entry: PolicyEntry) -> bool:
    """Whether the operator has reverted the promotion of this version."""
    return entry.reverted is not None and entry.reverted.get("generation") == entry.generation
