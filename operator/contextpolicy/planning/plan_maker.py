"""From what changed to plans: what caused them, and how long the shares of each stand (minDwell)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from contextpolicy.planning.allocation.bounds import BoundedSeating
from contextpolicy.planning.allocation.decision import Decider, Situation
from contextpolicy.planning.allocation.placement import Placement
from contextpolicy.planning.allocation.plan import Plan
from contextpolicy.planning.conditions.timers import SAME_INSTANT

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from contextpolicy.planning.allocation.decision import Decision
    from contextpolicy.planning.allocation.plan import TaskPlan
    from contextpolicy.planning.allocation.seating import Seating
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.planning.conditions.scores import Scores
    from contextpolicy.planning.conditions.timers import Timers
    from contextpolicy.planning.restart import Remembered
    from contextpolicy.policy.spec import Context, Policy

Substance: TypeAlias = tuple[object, ...]
"""All of a plan that must be carried out; a new time, cause or weight alone does not count."""


class PlanMaker:
    """Makes the plans of one policy.

    A plan with a new sequence number is to be carried out; one with that of the last only shows how scores, weights and
    contexts went on, while the shares in force stand.
    """

    def __init__(self, policy: Policy, timers: Timers) -> None:
        self.last: Plan | None = None
        self.decided: Plan | None = None
        self.held_back = 0
        self.changed = False
        """Whether anything happened since the last plan that may lead to another."""
        self.weights: Mapping[str, Weight] = {}
        self.placement = Placement()
        self.kept: Mapping[str, Remembered] = {}
        """The tasks that keep their state of before a restart."""
        self._policy, self._timers = policy, timers
        self._decider = Decider(policy)
        self._seating = BoundedSeating(policy)
        self._causes: dict[object, str] = {}
        self._urgent = False
        self._in_force: Substance | None = None
        self._held: Substance | None = None
        self._dwell = _Dwell(self)

    def begin(self, source: object) -> None:
        """The first plan's cause is the start, whatever was noted until now."""
        self._causes = {source: "start"}
        self.changed = True

    def note(self, source: object, cause: str) -> None:
        """Note a change; only the latest of each source is kept, so that the cause of a plan held back stays short."""
        self._causes.pop(source, None)
        self._causes[source] = cause
        self.changed = True

    def place(self, placement: Placement) -> None:
        """Containers came or went: that can't wait for minDwell, as shares must sum to N again."""
        if placement != self.placement:
            self.placement = placement
            self._seating.place(placement)
            self.note(Placement, "containers changed")
            self._urgent = True

    def seating(self, contexts: Sequence[Context]) -> Seating:
        """Where the tasks run, within the bounds of these active contexts."""
        return self._seating.seating(contexts)

    def at_rest(self) -> Mapping[str, Weight]:
        """What the tasks would weigh now if all were active."""
        return self._decider.at_rest()

    def make(self, scores: Scores, contexts: Sequence[Context], now: float, arrived: float | None) -> Plan | None:
        """The plan of this instant; None if it shows nothing new. Until minDwell is over the shares in force stand."""
        decision, names = self._decide(scores, contexts), tuple([context.name for context in contexts])
        self.weights = decision.weights
        substance = names, decision.suspended, decision.division.nodes, decision.shortfalls
        changes, decided = substance != self._in_force, self.decided
        cause = "; ".join(dict.fromkeys(self._causes.values()))
        if changes and decided is not None and self._stands(decided, now):
            self._hold_back(substance, decided.time + self._policy.enforcement.min_dwell)
            tasks = _with_shares_of(decided, decision.tasks)
            plan = replace(decided, time=now, cause=cause, contexts=names, tasks=tasks, arrived=arrived)
            changes = False
        else:
            self._causes.clear()
            self._held = None
            sequence = changes + (decided.sequence if decided else 0)
            nodes, shortfalls = decision.division.nodes, decision.shortfalls
            plan = Plan(sequence, now, cause, names, decision.tasks, nodes, shortfalls, arrived)
        self.changed = self._urgent = False
        if changes:
            self.decided, self._in_force = plan, substance
        elif not plan.is_news_after(self.last):
            return None
        self.last = plan
        return plan

    def _stands(self, decided: Plan, now: float) -> bool:
        return not self._urgent and now < decided.time + self._policy.enforcement.min_dwell - SAME_INSTANT

    def _hold_back(self, substance: Substance, until: float) -> None:
        # Counts the different plans held back, not each sample that leads to the same one.
        self.held_back += substance != self._held
        self._held = substance
        self._timers.set(self._dwell, until)

    def _decide(self, scores: Scores, contexts: Sequence[Context]) -> Decision:
        nodes = self.decided.nodes if self.decided else {}
        layout = self._seating.seating(contexts) if self._seating.varies else self._seating.own
        return self._decider.decide(Situation(scores.of, scores.unmet, contexts, layout, nodes, self.kept))


class _Dwell:
    """The end of minDwell; the causes of the plan held back are still noted."""

    def __init__(self, maker: PlanMaker) -> None:
        self._maker = maker

    def on_due(self, now: float) -> None:  # noqa: ARG002 - the timer's signature
        """Let the planner conclude again."""
        self._maker.changed = True


def _with_shares_of(decided: Plan, tasks: Mapping[str, TaskPlan]) -> dict[str, TaskPlan]:
    """The tasks while minDwell holds a plan back: their weights of now, and the shares that stay in force."""
    return {
        name: task._replace(share=decided.tasks[name].share, suspended=decided.tasks[name].suspended)
        for name, task in tasks.items()
    }
