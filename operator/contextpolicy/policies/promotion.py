"""Which policies are carried out as a shadow of them says, and whether that stays so."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from contextpolicy.bus.health_watch import HealthWatch
from contextpolicy.policies.registry import reference_of
from contextpolicy.policies.shadows import ShadowTrial, shadow_of, wants
from contextpolicy.policy.spec import Mode
from contextpolicy.shadow.probation import Probation
from contextpolicy.telemetry.api_text import timestamp

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    import zenoh

    from contextpolicy.bus.health_watch import TaskHealth
    from contextpolicy.policies.loader import Loaded
    from contextpolicy.policies.registry import PolicyEntry, PolicyRegistry
    from contextpolicy.policies.shadows import Shadows
    from contextpolicy.policies.status_publisher import StatusPublisher
    from contextpolicy.policy.spec import Policy
    from contextpolicy.streams.loop import Loop

LATE = 2.0
"""Seconds that a new operator waits for the shadow that the one before it had promoted, before it does without."""


class PromotionListener(Protocol):
    """Receives promotions."""

    def on_promotion(self) -> None:
        """A different spec is to be carried out from now on."""


class Promotion:
    """Everything on the loop's thread."""

    def __init__(
        self,
        loop: Loop,
        registry: PolicyRegistry,
        shadows: Shadows,
        publisher: StatusPublisher,
        listener: PromotionListener,
    ) -> None:
        self._loop, self._registry, self._shadows = loop, registry, shadows
        self._publisher, self._listener = publisher, listener
        self._awaited: dict[str, str] = {}

    def recall(self, entry: PolicyEntry) -> None:
        """The policy is new to this operator: go on where an earlier one has left it."""
        status = entry.body.get("status") or {}
        entry.reverted = (status.get("shadow") or {}).get("reverted")
        if status.get("promotedShadow"):
            reference = reference_of(entry.body)
            self._awaited[reference] = f"{entry.namespace}/{status['promotedShadow']}"
            self._loop.schedule_relative(LATE, lambda *_: self._give_up(reference))

    def arrange(self, session: zenoh.Session) -> None:
        """Policies came, went or were edited: who stands in for whom, and whose tasks are listened to."""
        present = self._registry.present
        for entry in present.values():
            entry.stand_in = None
        for entry in sorted(present.values(), key=lambda entry: entry.age):
            original = self._shadows.original(entry)
            if original is not None and original.stand_in is None and _is_promoted(entry, original):
                original.stand_in = entry
        self._awaited = {policy: shadow for policy, shadow in self._awaited.items() if shadow not in present}
        self._follow(session)

    def carried_out(self, entry: PolicyEntry) -> Loaded | None:
        """What is to run of a policy: its last valid version, a shadow as a dry run; None while there is nothing."""
        own, other = entry.good, entry.stand_in
        if own is None or own.policy is None or reference_of(entry.body) in self._awaited:
            return None
        if own.policy.shadow is not None and own.policy.mode.acts:
            return replace(own, policy=replace(own.policy, mode=Mode.DRY_RUN))
        if other is not None and other.good is not None and other.good.policy is not None:
            return replace(other.good, policy=in_place_of(own.policy, other.good.policy))
        return own

    def on_task_health(self, policy: str, task: str, health: TaskHealth) -> None:
        """A task has reported under this shadow, or under the policy that it is compared with."""
        entry, trial = self._registry.present.get(policy), self._shadows.trials.get(policy)
        if entry is None or trial is None or entry.runner is None or not trial.original.mode.acts:
            return
        own, plan = entry.runner.policy, entry.runner.planner.last
        if plan is None or own.shadow is None or task not in {leaf.name for leaf in own.leaves}:
            return
        now = self._loop.to_seconds(self._loop.now)
        if health.suspended:
            trial.probation.rest(task)
        elif not trial.promoted:
            if trial.probation.learn(task, health.misses, plan.contexts, now):
                self._publisher.report(policy)
        elif trial.probation.judge(own.shadow, task, health.misses, plan.contexts, now):
            self._take_back(policy, entry, trial, task)

    def _give_up(self, reference: str) -> None:
        if self._awaited.pop(reference, None) is not None:
            self._listener.on_promotion()

    def _follow(self, session: zenoh.Session) -> None:
        """Listen for each shadow that has something to be compared with; what is known is kept over its own edits."""
        before, self._shadows.trials = self._shadows.trials, {}
        for reference, entry in self._registry.present.items():
            original, shadow = self._shadows.original(entry), shadow_of(entry)
            if shadow is None or original is None or original.good is None or original.good.policy is None:
                continue
            known = before.get(reference)
            same = known is not None and known.original == original.good.policy
            probation = known.probation if known and same else Probation(None if known else _recalled(entry))
            probation.keep(_tasks(entry))
            watch = HealthWatch(session, shadow.health, self._loop, reference, self)
            promoted = original.stand_in is entry
            self._shadows.trials[reference] = ShadowTrial(original.good.policy, probation, watch, promoted=promoted)
            if promoted and not (known and known.promoted):
                probation.restart()
                entry.reverted = None
                self._publisher.note(reference, "Promoted", f"{original.good.policy.name} now runs with this spec")
        for trial in before.values():
            trial.watch.close()

    def _take_back(self, reference: str, entry: PolicyEntry, trial: ShadowTrial, task: str) -> None:
        before, since = trial.probation.before(task) or 0.0, trial.probation.since(task) or 0.0
        message = f"{task} has missed {since:.1%} of its inputs since the promotion, at most {before:.1%} before"
        when = timestamp(self._publisher.clock.now())
        entry.reverted = {"generation": entry.generation, "time": when, "message": message}
        for concerned in (reference, trial.original.reference):
            self._publisher.emit(concerned, "Reverted", f"{reference}: {message}")
        self._listener.on_promotion()


def in_place_of(own: Policy, shadow: Policy) -> Policy:
    """What a promoted shadow makes of the policy: all but who it is, and the context that people force on it."""
    contexts = {context.name for context in shadow.contexts}
    force = own.force if own.force is not None and own.force.context in contexts else shadow.force
    return replace(shadow, name=own.name, mode=own.mode, force=force, shadow=None)


def _is_promoted(entry: PolicyEntry, original: PolicyEntry) -> bool:
    own = original.good.policy if original.good is not None else None
    return own is not None and own.mode.acts and wants(entry)


def _tasks(entry: PolicyEntry) -> set[str]:
    policy = entry.good.policy if entry.good is not None else None
    return {leaf.name for leaf in policy.leaves} if policy is not None else set()


def _recalled(entry: PolicyEntry) -> dict[str, float]:
    """The misses before, from the status that an earlier operator wrote."""
    tasks: list[Mapping[str, Any]] = ((entry.body.get("status") or {}).get("shadow") or {}).get("tasks") or []
    return {task["name"]: task["missesBefore"] for task in tasks if task.get("missesBefore") is not None}
