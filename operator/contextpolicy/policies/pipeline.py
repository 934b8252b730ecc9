"""The whole path of one policy as one Rx pipeline, from samples to everything that acts on a plan or reports it.

    samples, placements -> merge -> plan -> drop equal plans -> pace +-> message to agents
                                     |                               +-> head start +-> follow agents -> actuator
                                     |                                              +-> bus, metrics, log, status
                                     +-> updates of the plan in force -> pace -> bus, metrics, status
                                     +-> changes of contexts -> head start -> events

Everything runs on the loop's thread. Nothing polls: without samples and due timers there is no work. An output that
fails keeps nothing from the others, and gets what it failed at again.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

from reactivex import merge
from reactivex import operators as ops
from reactivex.disposable import CompositeDisposable

from contextpolicy.actuators.following import follow_agents
from contextpolicy.bus.head_start import head_start
from contextpolicy.streams.pacing import pace
from contextpolicy.streams.persisting import persist
from contextpolicy.streams.sharing import share_on_loop

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from reactivex import Observable
    from reactivex.abc import DisposableBase, SchedulerBase

    from contextpolicy.actuators.following import NodePlans
    from contextpolicy.planning.allocation.plan import Plan
    from contextpolicy.planning.inputs import Input
    from contextpolicy.planning.planner import Planner

PLAN_INTERVAL = 0.005
"""Seconds between two plans made by samples; of those in between only the newest is carried out. The first of a storm
does not wait. A limit takes longer to be in force, and an order that is overtaken costs more than deciding."""

UPDATE_INTERVAL = 0.5
"""Seconds between messages that only update weights and scores: a score that follows a sensor changes with every
sample, and every message also has a status made."""


class Outputs(Protocol):
    """Who acts on plans, in this order, and who reports them."""

    @property
    def is_placed(self) -> bool:
        """Whether it is known where the containers run: a plan made before would claim none, and put all back."""

    def instructs_agents(self, plan: Plan) -> bool:
        """Whether agents act on the plan's message."""

    def followed(self) -> frozenset[str]:
        """The nodes where the actuator follows an agent."""

    def not_set(self) -> Mapping[str, str]:
        """The containers that agents could not set."""

    def is_decision(self, plan: Plan) -> bool:
        """Whether the plan is the one with which the shares in force began."""

    def is_update(self, plan: Plan) -> bool:
        """Whether the plan shows new weights, scores or contexts of the one that was published last."""

    def instruct_agents(self, plan: Plan) -> None:
        """Publish the plan if agents act on it."""

    def order(self, nodes: NodePlans) -> None:
        """Have the actuator carry out the plans of these nodes."""

    def publish_moves(self, nodes: NodePlans) -> None:
        """Publish the plan in force again if containers came or went without a new one."""

    def report(self, plan: Plan) -> None:
        """Publish the plan if that was not done, and report it."""

    def show(self, plan: Plan) -> None:
        """Publish and report such an update."""

    def report_contexts(self, plan: Plan) -> None:
        """Report which contexts began or ceased to hold."""


class Inputs(NamedTuple):
    """What a pipeline starts from; `moves` are node plans to be ordered again, because containers came or went.

    `settled` is for how many seconds a plan has to stay the same before the API follows an agent.
    """

    samples: Observable[Input]
    placements: Observable[Input]
    clock: Observable[Input]
    moves: Observable[NodePlans]
    settled: float


def connect(
    inputs: Inputs,
    planner: Planner,
    plan: Callable[[Observable[Input]], Observable[Plan]],
    outputs: Outputs,
    scheduler: SchedulerBase,
) -> DisposableBase:
    """Start a policy's pipeline; disposing of the result ends it, with all that waits in it.

    `plan` is the operator that scans inputs with the `planner`.
    """

    def newest(plan: Plan) -> Plan:
        return planner.decided or plan

    def newest_nodes(plan: Plan) -> NodePlans:
        return (planner.decided or plan).nodes

    plans = merge(inputs.samples, inputs.placements, inputs.clock).pipe(
        plan, ops.skip_while(lambda _: not outputs.is_placed), share_on_loop
    )
    decisions = plans.pipe(
        ops.map(newest),
        ops.distinct_until_changed(_sequence),
        pace(PLAN_INTERVAL, scheduler, at_once=_is_no_reaction),
        share_on_loop,
    )
    carried_out = decisions.pipe(head_start(scheduler, outputs.instructs_agents), share_on_loop)
    # What is newest when the head start is over: a plan that was overtaken meanwhile is not ordered.
    nodes = carried_out.pipe(ops.map(newest_nodes))
    follow = follow_agents(scheduler, inputs.settled, outputs.followed, outputs.not_set)
    orders = merge(nodes, inputs.moves).pipe(follow)
    # Each decision restarts the interval of the updates: its message has them all.
    messages = merge(decisions, plans.pipe(ops.filter(outputs.is_update)))
    paced = pace(UPDATE_INTERVAL, scheduler, at_once=outputs.is_decision)
    updates = messages.pipe(paced, ops.filter(outputs.is_update))
    contexts = plans.pipe(ops.distinct_until_changed(_contexts), head_start(scheduler, outputs.instructs_agents))
    return CompositeDisposable(
        persist(decisions, outputs.instruct_agents, scheduler),
        persist(orders, outputs.order, scheduler),
        persist(inputs.moves, outputs.publish_moves, scheduler),
        persist(carried_out, outputs.report, scheduler),
        persist(updates, outputs.show, scheduler),
        persist(contexts, outputs.report_contexts, scheduler),
    )


def _sequence(plan: Plan) -> int:
    return plan.sequence


def _contexts(plan: Plan) -> tuple[str, ...]:
    return plan.contexts


def _is_no_reaction(plan: Plan) -> bool:
    """Timers and placements make few plans, and these can't be overtaken by the next sample's."""
    return plan.arrived is None
