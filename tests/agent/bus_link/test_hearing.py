"""What an agent hears and refuses, and what the operator learns of its node."""

from __future__ import annotations

import json
import threading

import pytest

from contextpolicy.agent.bus_link import AgentBus
from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.bus.decision_bus import agent_key, confirmed_key, plan_key
from contextpolicy.bus.plan_message import LARGEST_PLAN
from contextpolicy.cluster.agent_reports import AgentReport
from contextpolicy.streams.loop import Loop
from tests.agent.builders import NODE
from tests.agent.bus_link.listening import FAILED, KEY, POLICY, STAMP, Listener
from tests.modules.robotkit.bus import ask, client
from tests.waiting import PATIENCE


def test_a_plan_and_its_withdrawal_arrive(bus, operator, listener, sign):  # noqa: ARG001
    operator.put(KEY, b"plan", attachment=sign(b"plan"))
    listener.expect((POLICY, b"plan"))
    operator.delete(KEY, attachment=sign(None))
    listener.expect((POLICY, b"plan"), (POLICY, None))


def test_messages_on_other_keys_are_ignored(bus, operator, listener, sign):  # noqa: ARG001
    operator.put("contextpolicy/robot/delivery/applied", b"no plan")
    operator.put("robot/imu", b"no plan")
    operator.put(KEY, b"plan", attachment=sign(b"plan"))
    listener.expect((POLICY, b"plan"))


@pytest.mark.usefixtures("_impatient")
def test_operator_sees_agent_reports_and_departures(address, operator, scheduler, close, verifier):
    agent, watcher = Listener(), Listener()
    watch = AgentWatch(operator, scheduler, watcher, {NODE})
    assert watch.reports == {}
    agent.lacks = ["no kernel option"]
    with client(address) as session:
        bus = AgentBus(session, NODE, scheduler, agent, verifier)
        watcher.expect("changed")
        assert watch.reports == {NODE: AgentReport("", "no kernel option")}
        close(bus)
        watcher.expect("changed", "changed")
        assert watch.reports == {}
    close(watch)


def test_node_capabilities_can_be_queried(bus, operator):  # noqa: ARG001
    [answer] = ask(operator, agent_key(NODE))
    assert json.loads(answer) == {"missing": {"CFS": [], "Realtime": []}}


def test_forged_plans_are_refused_and_do_not_mask_a_genuine_one(bus, operator, listener, sign):  # noqa: ARG001
    good = sign(b"plan")
    operator.put(KEY, b"forged")
    operator.put(KEY, b"forged", attachment=good)
    operator.put(plan_key("kube-system", "x"), b"plan", attachment=good)
    operator.put("*/robot/delivery/plan", b"plan", attachment=good)
    operator.delete(KEY)
    operator.put(KEY, b"plan", attachment=good)
    listener.expect("Unsigned", "Forged", "Forged", "Forged", "Unsigned", (POLICY, b"plan"))


def test_too_old_a_plan_is_refused_and_reported_missed(bus, operator, listener, sign):  # noqa: ARG001
    operator.put(KEY, b"old", attachment=sign(b"old", ago=60))
    listener.expect("TooOld", (POLICY, "missed", b"old"))
    operator.put(KEY, b"forged", attachment=sign(b"old", ago=60))
    listener.expect("TooOld", (POLICY, "missed", b"old"), "Forged")


def test_oversized_plan_is_ignored(bus, operator, listener, sign):  # noqa: ARG001
    operator.put(KEY, b"x" * (LARGEST_PLAN + 1))
    operator.put(KEY, b"plan", attachment=sign(b"plan"))
    listener.expect((POLICY, b"plan"))


def test_unsigned_answer_is_refused(bus, operator, listener):  # noqa: ARG001
    def answer(query):
        query.reply(query.key_expr, b"forged")

    with operator.declare_queryable(KEY, answer), operator.liveliness().declare_token(KEY):
        listener.expect((POLICY, "found"), "Unsigned")


def test_exception_in_one_plan_does_not_lose_the_others(address, verifier):
    class Failing(Listener):
        def hear(self, policy, payload, signed):
            super().hear(policy, payload, signed)
            raise RuntimeError(policy)

    listener, loop = Failing(), Loop()
    go = threading.Event()
    with client(address) as session:
        bus = AgentBus(session, NODE, loop, listener, verifier)
        loop.schedule(lambda *_: go.wait(PATIENCE))
        for number in range(3):
            bus._put(f"robot/{number}", b"plan", 1)
        go.set()
        listener.expect(*((f"robot/{number}", b"plan") for number in range(3)))
        bus.close()
    loop.dispose()


def test_applied_plan_is_confirmed(bus, operator, sign):  # noqa: ARG001
    confirmed, heard = [], threading.Event()

    def hear(sample):
        confirmed.append(json.loads(sample.payload.to_bytes()))
        heard.set()

    with operator.declare_subscriber(confirmed_key(NODE), hear):
        while not heard.wait(0.01):
            operator.put(KEY, b"plan", attachment=sign(b"plan"))
    assert confirmed[0] == {"policy": POLICY, "stamp": list(STAMP), "failed": FAILED}
