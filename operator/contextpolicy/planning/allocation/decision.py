"""Who gets what at one instant: weights, their division over the nodes, and the needs that stay unmet."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from contextpolicy.planning.allocation.division import divide_nodes
from contextpolicy.planning.allocation.feasibility import shortfalls
from contextpolicy.planning.allocation.plan import Shortfall, TaskPlan
from contextpolicy.planning.allocation.weights import Obstacles, Weigher
from contextpolicy.policy.activities import Enforce
from contextpolicy.policy.dependencies import TaskTree

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from collections.abc import Set as AbstractSet

    from contextpolicy.planning.allocation.division import Division
    from contextpolicy.planning.allocation.plan import NodePlan
    from contextpolicy.planning.allocation.seating import Seating
    from contextpolicy.planning.allocation.shares import Demand
    from contextpolicy.planning.allocation.weights import Weight
    from contextpolicy.planning.restart import Remembered
    from contextpolicy.policy.spec import Context, Policy


AT_REST = "nothing is active, so priorities divide the node"


class Situation(NamedTuple):
    """What a decision is made from: scores, unmet pre-conditions, active contexts, and where the containers run.

    `kept` are the tasks that keep their state of before a restart.
    """

    scores: Mapping[str, float]
    waiting: Mapping[str, str]
    contexts: Sequence[Context]
    layout: Seating
    last: Mapping[str, NodePlan]
    kept: Mapping[str, Remembered] = {}


class Decision(NamedTuple):
    """What follows from it."""

    weights: Mapping[str, Weight]
    tasks: Mapping[str, TaskPlan]
    division: Division
    shortfalls: tuple[Shortfall, ...]
    suspended: AbstractSet[str]


class Decider:
    """Decides for one policy."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._weigher = Weigher(policy)
        self._layout: Seating | None = None
        self._claims: Mapping[str, Sequence[Demand]] = {}
        self._known: dict[str, tuple[Weight, TaskPlan]] = {}
        self._kept: Mapping[str, Remembered] = {}
        self._leaves = policy.leaves
        self._may_yield = {task.name for task in self._leaves if task.needs.enforce is Enforce.SUSPEND}
        self._places = {task.name: place for place, task in enumerate(policy.tasks)}
        tree = TaskTree(policy)
        # Innermost first: whether a group is suspended depends on the groups inside it.
        self._groups = sorted(
            (task for task in policy.tasks if task.subtasks), key=lambda task: -len(tree.ancestors(task.name))
        )

    def at_rest(self) -> Mapping[str, Weight]:
        """What the tasks of the last decision would weigh if all were active."""
        weights = self._weigher.weigh_at_rest()
        priorities = {name: self._policy.tasks[self._places[name]].priority for name in self._kept}
        return weights | {
            name: _at_rest_as_before(weights[name], priorities[name], state) for name, state in self._kept.items()
        }

    def decide(self, situation: Situation) -> Decision:
        """Decide; tasks with `enforce: Suspend` yield, the lightest first, until none of them has an unmet need.

        Then those that fit after all come back, the last to yield first: a heavier task that yielded later may have
        made room. So who runs depends on this situation only, not on earlier decisions.
        """
        self._kept = situation.kept
        yielding: dict[str, str] = {}
        decision = self._attempt(situation, yielding)
        while lightest := self._lightest_unmet(decision):
            name, need = lightest
            yielding = {**yielding, name: need}
            decision = self._attempt(situation, yielding)
        for name in reversed(yielding):
            fewer = {other: need for other, need in yielding.items() if other != name}
            again = self._attempt(situation, fewer)
            if self._lightest_unmet(again) is None:
                yielding, decision = fewer, again
        return decision

    def _attempt(self, situation: Situation, yielding: Mapping[str, str]) -> Decision:
        obstacles = Obstacles(situation.waiting, situation.layout.absent, yielding)
        weights = self._weigher.weigh(situation.scores, obstacles, situation.contexts)
        if situation.kept:
            weights |= {name: _as_before(weights[name], state) for name, state in situation.kept.items()}
        if situation.layout is not self._layout:
            self._layout, self._claims = situation.layout, {}
        division = divide_nodes(situation.layout, weights, situation.last, self.at_rest, self._claims)
        self._claims = division.claims
        suspended = self._suspended(weights, division)
        if suspended:
            division = division._replace(nodes={name: _with(n, suspended) for name, n in division.nodes.items()})
        unmet = shortfalls(self._policy, weights, suspended, situation.layout, division.nodes)
        yielded = (Shortfall(name, f"is suspended: it {need}") for name, need in yielding.items())
        tasks = self._task_plans(weights, division.shares, suspended)
        if division.resting:
            tasks |= {name: tasks[name]._replace(because=AT_REST) for name in division.resting}
        return Decision(weights, tasks, division, (*division.shortfalls, *yielded, *unmet), suspended)

    def _task_plans(
        self, weights: Mapping[str, Weight], shares: Mapping[str, int], suspended: AbstractSet[str]
    ) -> dict[str, TaskPlan]:
        """Each task's; one for which nothing has changed keeps its last, as nearly all do from plan to plan."""
        known, plans = self._known, {}
        for name, weight in weights.items():
            share, sleeps, last = shares.get(name, 0), name in suspended, known.get(name)
            if last is None or last[0] is not weight or last[1].share != share or last[1].suspended is not sleeps:
                last = known[name] = weight, TaskPlan(weight.score, weight.value, share, weight.because, sleeps)
            plans[name] = last[1]
        return plans

    def _lightest_unmet(self, decision: Decision) -> tuple[str, str] | None:
        """The lightest task that may yield and has an unmet need, with that need; ties go to the policy's first."""
        if not self._may_yield:
            return None
        unmet = [
            (decision.weights[s.task].value, self._places[s.task], s.task, s.message)
            for s in decision.shortfalls
            if s.task in self._may_yield and decision.weights[s.task].value > 0
        ]
        return min(unmet)[2:] if unmet else None

    def _suspended(self, weights: Mapping[str, Weight], division: Division) -> set[str]:
        """The suspended tasks; a parent is suspended when all its subtasks are."""
        found = {
            task.name
            for task in self._leaves
            if not weights[task.name].value
            and task.name not in division.resting
            and not (task.protected and weights[task.name].able)
        }
        if found:
            found.update(g.name for g in self._groups if weights[g.name].value == 0 and found.issuperset(g.subtasks))
        return found


def _as_before(weight: Weight, state: Remembered) -> Weight:
    value = 0.0 if state.suspended else state.weight
    because = "keeps its state from before the restart until the streams it depends on are heard"
    return weight._replace(value=value, because=because, able=not state.suspended)


def _at_rest_as_before(weight: Weight, priority: float, state: Remembered) -> Weight:
    """What keeps it from running now is not known yet: only what it had counts."""
    if state.suspended:
        return weight._replace(value=0.0, able=False)
    return weight if weight.value > 0 else weight._replace(value=priority, able=True)


def _with(node: NodePlan, suspended: AbstractSet[str]) -> NodePlan:
    here = suspended & node.shares.keys()
    return node._replace(suspended=here) if here != node.suspended else node
