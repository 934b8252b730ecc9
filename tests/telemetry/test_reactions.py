"""Which resize is the reaction to which sample."""

from __future__ import annotations

from dataclasses import replace

import pytest

from contextpolicy.cluster.pods import Cpu
from contextpolicy.policy.spec import Scheduler
from contextpolicy.telemetry.reactions import Reactions
from tests.planning.builders import a_plan

POLICY = "lab/robot"


@pytest.fixture
def reactions():
    """The robot stands: slam and speech have the same, as no sample had it."""
    standing = Reactions()
    standing.plan(POLICY, a_plan(1, {"slam": 500, "speech": 500}), 0.0)
    return standing


def reached(reactions, container, limit, *, request=10):
    """When the samples came whose reactions these are, by stage."""
    reaching = (reactions.reach(POLICY, container, stage, Cpu(request, limit)) for stage in ("patch", "status"))
    return [reaction.arrived if reaction else None for reaction in reaching]


def test_each_stage_of_what_a_sample_changed_is_measured_once(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "slam", 900) == [7.0, 7.0]
    assert reached(reactions, "slam", 900) == [None, None]
    assert reached(reactions, "speech", 100) == [7.0, 7.0]


def test_an_unchanged_share_is_not_a_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 400, "speech": 500}, arrived=7.0), 7.5)
    assert reached(reactions, "speech", 500) == [None, None]


def test_an_older_plans_limit_is_not_a_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 700, "speech": 300}, arrived=8.0), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]
    assert reached(reactions, "slam", 700) == [8.0, 8.0]


def test_a_resized_request_is_a_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    assert reactions.reach(POLICY, "slam", "patch", Cpu(900, 1000)).arrived == 7.0


@pytest.mark.parametrize(("requested", "limit"), [(450, None), (450, 1000), (299, 300)])
def test_a_scaled_request_is_the_reaction_where_requests_are_weights(reactions, requested, limit):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5, requests={"slam": 450})
    assert reactions.reach(POLICY, "slam", "patch", Cpu(400, limit)) is None, "of an older plan"
    assert reactions.reach(POLICY, "slam", "patch", Cpu(requested, limit)).arrived == 7.0


def test_a_later_plan_keeps_pending_reactions_it_does_not_change(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 900, "speech": 50}, arrived=8.0), 7.5)
    assert reached(reactions, "slam", 900) == [7.0, 7.0]


def test_a_timers_plan_cancels_the_reactions_it_changes(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 500}, arrived=7.0), 7.5)
    reactions.plan(POLICY, a_plan(3, {"slam": 500, "speech": 500}), 7.5)
    reactions.plan(POLICY, a_plan(4, {"slam": 900, "speech": 500}), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]


def test_the_first_plan_of_a_run_may_change_nothing(reactions):
    """What the containers had is not known: an equal limit is never asked for, and an hour later it might be."""
    reactions.plan(POLICY, a_plan(1, {"slam": 900, "speech": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "slam", 900) == [None, None]


def test_a_new_containers_share_is_not_a_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 500, "speech": 500, "planner": 100}, arrived=7.0), 7.5)
    assert reached(reactions, "planner", 100) == [None, None]


def test_correcting_an_external_write_is_not_a_reaction(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    reactions.drop(POLICY, "slam")
    assert reached(reactions, "slam", 900) == [None, None]


def test_realtime_is_not_resized(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 400}, arrived=7.0, scheduler=Scheduler.REALTIME), 7.5)
    assert reached(reactions, "slam", 400) == [None, None]


def test_reactions_of_a_deleted_policy_are_forgotten(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900}, arrived=7.0), 7.5)
    reactions.forget(POLICY)
    reactions.drop(POLICY, "slam")
    assert reached(reactions, "slam", 900) == [None, None]


def ended(reactions):
    return [(reaction.arrived, at) for reaction, at in reactions.confirmed(POLICY)]


def test_an_agents_confirmation_counts_once(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 500}, arrived=7.0), 7.5)
    assert ended(reactions) == []
    reactions.confirm(POLICY, "robot", 2, 7.6)
    assert ended(reactions) == [(7.0, 7.6)]
    assert ended(reactions) == []
    assert reached(reactions, "slam", 900) == [7.0, None], "the resize follows"


def test_an_agent_may_confirm_a_plan_before_it_is_taken(reactions):
    reactions.confirm(POLICY, "robot", 3, 7.6)
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 500}, arrived=7.0), 7.5)
    assert ended(reactions) == [], "what the agent confirmed may say something else"
    reactions.plan(POLICY, a_plan(3, {"slam": 700, "speech": 500}, arrived=7.1), 7.5)
    assert ended(reactions) == [(7.1, 7.6)]


@pytest.mark.parametrize(("node", "sequence", "failed"), [("robot", 1, ()), ("other", 2, ()), ("robot", 2, ("slam",))])
def test_unconfirmed_or_failed_targets_are_not_in_force(reactions, node, sequence, failed):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 500}, arrived=7.0), 7.5)
    reactions.confirm(POLICY, node, sequence, 7.6, failed)
    assert ended(reactions) == []
    assert reached(reactions, "slam", 900) == [7.0, 7.0], "the kubelet's report counts then"


def test_a_task_that_is_left_alone_does_not_react_to_a_new_share(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 900, "speech": 10}, arrived=7.0), 7.5, {"slam"})
    reactions.confirm(POLICY, "robot", 2, 7.6)
    reactions.plan(POLICY, a_plan(3, {"slam": 990, "speech": 10}, arrived=8.0), 8.5, {"slam"})
    reactions.confirm(POLICY, "robot", 3, 8.6)
    assert len(ended(reactions)) == 2, "two tasks, at the first plan: slam came to be left alone, speech was suspended"


def test_a_task_that_is_released_reacts_even_if_its_share_moves_on(reactions):
    reactions.plan(POLICY, a_plan(2, {"slam": 500, "speech": 10}), 1.0, {"slam"})
    reactions.plan(POLICY, a_plan(3, {"slam": 500, "speech": 400}, arrived=7.0), 7.5, {"slam", "speech"})
    reactions.plan(POLICY, a_plan(4, {"slam": 500, "speech": 300}, arrived=8.0), 8.5, {"slam", "speech"})
    assert reached(reactions, "speech", 300) == [7.0, 7.0]


def test_restoring_a_released_tasks_original_is_its_reaction(reactions):
    """Under control Suspend: 700m before any policy, whatever its share."""
    reactions.plan(POLICY, a_plan(2, {"slam": 990, "speech": 10}, arrived=7.0), 7.5, ["slam"])
    reactions.plan(POLICY, a_plan(3, {"slam": 500, "speech": 500}, arrived=9.0), 9.5, ["slam", "speech"])
    assert reactions.reach(POLICY, "speech", "patch", Cpu(10, 10)) is None, "late, of the suspension"
    assert reactions.reach(POLICY, "speech", "patch", Cpu(10, 700)).arrived == 9.0
    assert reactions.reach(POLICY, "speech", "status", Cpu(None, 500)).arrived == 9.0


def moved(sequence, node):
    plan = a_plan(sequence, {"slam": 900})
    return replace(plan, nodes={node: plan.nodes["robot"]})


def test_confirmations_of_removed_nodes_are_forgotten(reactions):
    """Nodes that are virtual machines come and go under new names."""
    sizes = set()
    for number in range(2, 50):
        reactions.plan(POLICY, moved(number, f"node-{number}"), 7.5)
        reactions.confirm(POLICY, f"node-{number}", number, 7.6)
        reactions.confirm(POLICY, f"node-{number - 1}", number - 1, 7.7)
        sizes.add(len(reactions._confirmed[POLICY]))
    assert sizes == {1}
