"""The agent as a whole, from message to files, with time as an argument."""

from __future__ import annotations

import json
from datetime import timedelta
from time import monotonic
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from reactivex.testing import TestScheduler

from contextpolicy.agent import capabilities
from contextpolicy.cluster.agent_reports import Confirmation
from tests.agent.builders import CHAT, JSON, POLICY, SLAM, SPEECH, TIMES, Tree, a_message, a_target, an_agent

GRACE = 10.0


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path / "cgroup")


@pytest.fixture
def scheduler():
    return TestScheduler()


@pytest.fixture(autouse=True)
def _able(monkeypatch):
    """A node with two processors and every capability."""
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr(capabilities, "_has_capability", lambda _: True)


@pytest.fixture
def start(tmp_path, tree, scheduler):
    """Start an agent, or another one after it."""

    def start(tree=tree):
        agent = an_agent(tree, tmp_path / "state", scheduler, grace=GRACE)
        agent.start()
        return agent

    return start


@pytest.fixture
def agent(start):
    """An agent that knows of the policy's source."""
    agent = start()
    agent.find_source(POLICY)
    return agent


def wait(scheduler, seconds):
    scheduler.advance_by(timedelta(seconds=seconds).total_seconds())


def test_a_write_that_the_watch_reports_is_answered_on_the_loop(tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9, held=True)))
    tree.set(slam, 300)
    agent.on_write(tree.limit_file(slam), monotonic())
    assert tree.limit(slam) == 300
    wait(scheduler, 0.1)
    assert tree.limit(slam) == 900


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(st.sampled_from(sorted(a_target())), JSON)
def test_invalid_fields_do_not_crash_the_agent(agent, field, value):
    message = json.loads(a_message(a_target()))
    message["targets"][0][field] = value
    agent.hear(POLICY, json.dumps(message).encode())


def test_refusals_are_logged_once_per_reason(agent, caplog):
    for _ in range(5):
        agent.hear(POLICY, b"nonsense")
        agent.hear(POLICY, a_message(a_target(cores=1.9)))
    assert agent.report()["refused"] == {"Unreadable": 5, "TooMuch": 5}
    assert len(caplog.records) == 2


def test_container_missing_on_the_node_is_skipped(tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.4), a_target("d" * 64, 0.4, task="ghost")))
    assert tree.limit(slam) == 400
    assert agent.report()["refused"] == {"NotHere": 1}


def test_a_container_of_another_pod_is_not_found_under_this_one(tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.4, uid="uid-b")))
    assert tree.limit(slam) == 500


@pytest.mark.parametrize("mode", ["DryRun", "Paused"])
def test_policy_is_undone_when_it_leaves_enforce_mode(tree, agent, slam, mode):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9), sequence=2, mode=mode))
    assert tree.limit(slam) == 500


def test_a_policy_that_is_gone_is_undone_and_may_come_back(tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.hear(POLICY, None)
    assert tree.limit(slam) == 500
    agent.hear(POLICY, a_message(a_target(SLAM, 0.8), run=2))
    assert tree.limit(slam) == 800


def test_without_a_source_plans_hold_for_the_grace_period(tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.lose_source(POLICY)
    wait(scheduler, GRACE - 0.1)
    assert tree.limit(slam) == 900
    wait(scheduler, 0.2)
    assert tree.limit(slam) == 500


def test_a_source_that_is_back_in_time_changes_nothing(tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.lose_source(POLICY)
    agent.find_source(POLICY)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    wait(scheduler, 2 * GRACE)
    assert tree.limit(slam) == 900


def test_a_source_that_is_back_but_whose_answer_is_lost_keeps_its_plan(tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.lose_source(POLICY)
    wait(scheduler, 1)
    agent.find_source(POLICY)
    wait(scheduler, 2 * GRACE)
    assert tree.limit(slam) == 900


def test_silent_source_does_not_keep_a_killed_agents_writes(start, tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    start().find_source(POLICY)
    wait(scheduler, 2 * GRACE)
    assert tree.limit(slam) == 500


def test_a_plan_that_arrives_after_its_source_is_gone_does_not_stay(tree, agent, scheduler, slam):
    agent.lose_source(POLICY)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    wait(scheduler, 2 * GRACE)
    assert tree.limit(slam) == 500


def confirm(tree, agent, group, limit):
    """The kubelet writes what the API has."""
    tree.set(group, limit)
    agent.on_other_write(tree.limit_file(group), monotonic())


def test_confirmed_limits_are_undone_without_an_operator_and_rewritten_when_it_returns(tree, agent, scheduler, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.01)))
    confirm(tree, agent, slam, 10)
    agent.lose_source(POLICY)
    wait(scheduler, GRACE - 0.1)
    assert tree.limit(slam) == 10
    wait(scheduler, GRACE)
    assert tree.limit(slam) == 500
    agent.find_source(POLICY)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.01), run=2))
    assert tree.limit(slam) == 10


def test_a_killed_agents_writes_are_undone_unless_a_plan_comes(start, tree, scheduler, slam, speech):
    killed = start()
    killed.find_source(POLICY)
    killed.find_source("robot/other")
    killed.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    killed.hear("robot/other", a_message(a_target(SPEECH, 0.1), policy="robot/other"))
    heir = start()
    heir.find_source(POLICY)
    heir.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    wait(scheduler, 2 * GRACE)
    assert (tree.limit(slam), tree.limit(speech)) == (900, 500)


def test_a_killed_agents_writes_that_the_api_confirmed_stay(start, tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    heir = start()
    heir.find_source(POLICY)
    heir.hear(POLICY, a_message(a_target(SLAM, 0.9, limit=0.9)))
    heir.stop()
    assert tree.limit(slam) == 900


def realtime(*targets, **more):
    return a_message(*targets, scheduler="Realtime", capacity=1.9, **more)


def test_realtime_budgets_and_the_limit_of_the_suspended(tree, agent, slam, speech):
    targets = a_target(SLAM, 1.898), a_target(SPEECH, 0.002, task="speech")
    agent.hear(POLICY, realtime(*targets, suspended=("speech",)))
    assert (tree.budget(slam), tree.budget(speech)) == (949, 1)
    assert (tree.limit(slam), tree.limit(speech)) == (500, 10)
    agent.hear(POLICY, realtime(a_target(SLAM, 1.0), a_target(SPEECH, 0.9, task="speech"), sequence=2))
    assert (tree.budget(speech), tree.limit(speech)) == (450, 500)


def test_suspended_realtime_task_regains_its_original_limit(tree, agent, slam):
    tree.set(slam, 300)
    agent.hear(POLICY, realtime(a_target(SLAM, 0.002), suspended=("slam",)))
    assert tree.limit(slam) == 10
    agent.hear(POLICY, None)
    assert tree.limit(slam) == 500


def test_leaving_realtime_undoes_it(tree, agent, slam):
    agent.hear(POLICY, realtime(a_target(SLAM, 1.0)))
    agent.hear(POLICY, a_message(a_target(SLAM, 0.3), sequence=2))
    assert (tree.budget(slam), tree.budget(tree.layout.top), tree.limit(slam)) == (0, 0, 300)


def test_entering_realtime_undoes_limits(tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.3)))
    agent.hear(POLICY, realtime(a_target(SLAM, 1.0), sequence=2))
    assert (tree.budget(slam), tree.limit(slam)) == (500, 500)


def test_node_without_realtime_reports_why_and_refuses(tmp_path, start):
    bare = Tree(tmp_path / "bare", realtime=False)
    group = bare.container(SLAM)
    agent = start(bare)
    assert "CONFIG_RT_GROUP_SCHED" in agent.report()["missing"]["Realtime"][0]
    agent.hear(POLICY, realtime(a_target(SLAM, 1.0)))
    assert bare.limit(group) == 500
    assert agent.report()["refused"] == {"Incapable": 1}


def test_plan_that_the_node_is_not_capable_of_ends_the_one_before(tmp_path, start):
    bare = Tree(tmp_path / "bare", realtime=False)
    group = bare.container(SLAM)
    agent = start(bare)
    agent.find_source(POLICY)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.01, held=True)))
    said = agent.hear(POLICY, realtime(a_target(SLAM, 1.0), sequence=2))
    assert (said.failed, bare.limit(group)) == ({f"containerd://{SLAM}": "Incapable"}, 500)
    bare.set(group, 300)
    agent.on_other_write(bare.limit_file(group), monotonic())
    assert bare.limit(group) == 300


def test_processors_that_are_switched_on_later_count(tree, agent, slam, monkeypatch):
    assert agent.hear(POLICY, a_message(a_target(SLAM, 0.9), capacity=4.0)) is None
    monkeypatch.setattr("os.cpu_count", lambda: 4)
    assert agent.hear(POLICY, a_message(a_target(SLAM, 0.9), capacity=4.0)).failed == {}
    assert (tree.limit(slam), agent.report()["processors"]) == (900, 4)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert agent.hear(POLICY, a_message(a_target(SLAM, 0.8), capacity=4.0, sequence=2)).failed == {}


def test_agent_may_start_before_the_kubelet(tmp_path, start):
    mount = tmp_path / "late"
    (mount / "cpu").mkdir(parents=True)
    agent = start(SimpleNamespace(mount=mount, logs=tmp_path / "late-pods"))
    assert "kubelet" in agent.report()["missing"]["CFS"][0]
    late = Tree(mount)
    group = late.container(SLAM)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    assert late.limit(group) == 900


@pytest.mark.parametrize("namespace", ["kube-system", None], ids=["of another namespace", "of no pod that is here"])
def test_a_policy_reaches_no_container_outside_its_namespace(tree, agent, slam, speech, namespace):
    if namespace:
        tree.pod("uid-a", namespace)
    else:
        (tree.logs / "robot_pod_uid-a").rmdir()
    said = agent.hear(POLICY, a_message(a_target(SLAM, 0.01), a_target(SPEECH, 0.3, task="speech")))
    assert (tree.limit(slam), tree.limit(speech)) == (500, 300)
    assert (agent.report()["refused"], said.failed) == ({"Foreign": 1}, {f"containerd://{SLAM}": "Foreign"})


def test_pod_created_after_the_first_plan_is_found(tree, agent, slam):
    agent.hear(POLICY, a_message(a_target(SLAM, 0.4)))
    later = tree.container(CHAT)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.4), a_target(CHAT, 0.2, task="chat"), sequence=2))
    assert (tree.limit(slam), tree.limit(later)) == (400, 200)


def test_a_plan_that_is_carried_out_is_confirmed_and_a_refused_one_is_not(agent, slam):  # noqa: ARG001
    assert agent.hear(POLICY, a_message(a_target(SLAM, 0.4))) == Confirmation(POLICY, (1, 1, 0))
    assert agent.hear(POLICY, a_message(a_target(SLAM, 0.4))) == Confirmation(POLICY, (1, 1, 0))
    assert agent.hear(POLICY, a_message(a_target(SLAM, 64), sequence=2)) is None


def test_policies_that_swap_containers_are_carried_out_when_the_first_repeats_its_plan(tree, agent, slam, speech):
    """The operator publishes first to one, then to the other, and to the first once more."""
    other = "robot/other"
    mine, theirs = a_target(SLAM, 0.2), a_target(SPEECH, 0.3, task="speech")
    agent.find_source(other)
    agent.hear(POLICY, a_message(mine))
    agent.hear(other, a_message(theirs, policy=other))
    assert agent.hear(POLICY, a_message(theirs, sequence=2)) is None
    assert agent.hear(other, a_message(mine, policy=other, sequence=2)).failed == {}
    assert agent.hear(POLICY, a_message(theirs, sequence=2, edition=1)).failed == {}
    assert (tree.limit(slam), tree.limit(speech)) == (200, 300)
    assert agent.report()["refused"] == {"Owned": 1}


def test_a_withdrawal_that_is_repeated_later_undoes_nothing(tree, agent, slam):
    withdrawn = next(TIMES)
    agent.hear(POLICY, None, withdrawn)
    agent.hear(POLICY, a_message(a_target(SLAM, 0.9)))
    agent.hear(POLICY, None, withdrawn)
    assert tree.limit(slam) == 900
    assert agent.report()["refused"] == {"Outdated": 1}
