from __future__ import annotations

import json
import queue
from contextlib import ExitStack, contextmanager

import pytest
import zenoh

from contextpolicy.bus.plan_message import message
from robotkit.plan import UNPLANNED, Decision, Decisions, PlanListener
from tests.modules.robotkit.bus import Matching, client, router
from tests.planning.builders import Story, a_policy, a_task, on_node
from tests.ports import free_port
from tests.waiting import PATIENCE

KEY = "contextpolicy/robot/demo/plan"


DEEP = b"[" * 100_000


def a_plan(run=1, sequence=1, *, task="slam", mode="Enforce", **changes):
    decision = {"score": 1.0, "weight": 10.0, "share": 0.5, "suspended": False, **changes}
    return json.dumps({"run": run, "sequence": sequence, "mode": mode, "tasks": {task: decision}}).encode()


UNREADABLE = [
    DEEP,
    a_plan().replace(b"0.5", b'"much"'),
    a_plan().replace(b'"run": 1', b'"run": 1e999'),
    a_plan().replace(b"0.5", b"1e999"),
    a_plan().replace(b"10.0", b'"nan"'),
    a_plan().replace(b"false", b'"false"'),
]


def test_a_task_reads_its_own_share():
    assert Decisions("slam").hear(KEY, a_plan(share=1.25)) == Decision(1.25, 10.0, suspended=False)


@pytest.mark.parametrize("scheduler", ["CFS", "Realtime"])
def test_a_share_is_cores_under_each_scheduler(scheduler):
    """7 of 19 parts of what is to divide of two cores: all but the reserve, or 95 % of each."""
    tasks = [a_task("slam", priority=7), a_task("speech", priority=12)]
    policy = a_policy(tasks=tasks, enforcement={"scheduler": scheduler}, reserve="100m")
    plan = Story(policy, on_node("slam", "speech", cores=2)).last
    heard = json.dumps(message(policy, 1, plan, (), (), {})).encode()
    assert Decisions("slam").hear(KEY, heard).share == 0.7


def test_a_late_plan_does_not_undo_a_newer_one():
    decisions = Decisions("slam")
    newest = decisions.hear(KEY, a_plan(run=2, sequence=1, share=0.9))
    assert decisions.hear(KEY, a_plan(run=2, sequence=1, share=0.1)) == newest
    assert decisions.hear(KEY, a_plan(run=1, sequence=99, share=0.1)) == newest


@pytest.mark.parametrize("after", [a_plan(sequence=2, mode="DryRun"), a_plan(sequence=2, task="arm"), None])
def test_a_plan_that_no_longer_binds_frees_the_task(after):
    decisions = Decisions("slam")
    decisions.hear(KEY, a_plan(suspended=True))
    assert decisions.hear(KEY, after) == UNPLANNED


def test_a_policy_that_does_not_name_the_task_changes_nothing():
    decisions = Decisions("slam")
    mine = decisions.hear(KEY, a_plan())
    assert decisions.hear("contextpolicy/robot/other/plan", a_plan(run=9, task="arm")) == mine


@pytest.mark.parametrize("payload", [b"", b"{", b"[]", b"7", b'{"run": 1}', *UNREADABLE])
def test_a_broken_plan_changes_nothing(payload):
    decisions = Decisions("slam")
    mine = decisions.hear(KEY, a_plan(share=0.7))
    assert decisions.hear(KEY, payload) == mine


@contextmanager
def a_source(session, plan):
    """Somebody who makes plans: answers for the one in force, and then says with a token that it does."""
    with session.declare_queryable(KEY, lambda query: query.reply(KEY, plan)):
        token = session.liveliness().declare_token(KEY)
        yield
        token.undeclare()


@contextmanager
def listening(session, heard):
    listener = PlanListener(session, "slam", heard.put, lambda work: work)
    yield
    listener.close()


def test_a_module_receives_the_plan_in_force_and_every_change():
    heard: queue.Queue[Decision] = queue.Queue()
    with (
        router() as address,
        client(address) as policy,
        client(address) as module,
        a_source(policy, a_plan(sequence=1, share=0.1)),
        listening(module, heard),
    ):
        assert heard.get(timeout=PATIENCE).share == 0.1
        policy.put(KEY, a_plan(sequence=2, share=0.2), congestion_control=zenoh.CongestionControl.BLOCK)
        assert heard.get(timeout=PATIENCE).share == 0.2
        policy.delete(KEY, congestion_control=zenoh.CongestionControl.BLOCK)
        assert heard.get(timeout=PATIENCE) == UNPLANNED


def test_a_module_queries_the_plan_of_a_later_operator():
    heard: queue.Queue[Decision] = queue.Queue()
    with router() as address, client(address) as policy, client(address) as module, listening(module, heard):
        with a_source(policy, a_plan(run=1, share=0.1)):
            assert heard.get(timeout=PATIENCE).share == 0.1
        with a_source(policy, a_plan(run=2, share=0.2)):
            assert heard.get(timeout=PATIENCE).share == 0.2


def test_a_plan_missed_during_a_router_outage_is_queried():
    """Plans are not repeated: a task would stay suspended until the next one."""
    heard: queue.Queue[Decision] = queue.Queue()
    plans = [a_plan(sequence=1, suspended=True)]
    port = free_port()
    with ExitStack() as first, ExitStack() as sessions:
        address = first.enter_context(router(port))
        policy, module = (sessions.enter_context(client(address)) for _ in range(2))
        sessions.enter_context(policy.declare_queryable(KEY, lambda query: query.reply(KEY, plans[-1])))
        token = policy.liveliness().declare_token(KEY)
        with listening(module, heard):
            assert heard.get(timeout=PATIENCE).suspended
            first.close()
            plans.append(a_plan(sequence=2))
            with router(port):
                assert not heard.get(timeout=PATIENCE).suspended
        token.undeclare()


def test_a_plan_on_a_wildcard_key_is_ignored():
    """A peer that may publish samples, but no plans, can still publish on such a key."""
    heard: queue.Queue[Decision] = queue.Queue()
    with router() as address, client(address) as policy, client(address) as module:
        listener = PlanListener(module, "slam", heard.put, lambda work: work)
        publisher = policy.declare_publisher(KEY)
        Matching(publisher).wait(expected=True)
        policy.put("*/robot/*/plan", a_plan(sequence=9, share=0.9))
        policy.put(KEY, a_plan(sequence=1, share=0.1))
        assert heard.get(timeout=PATIENCE).share == 0.1
        listener.close()
        publisher.undeclare()
