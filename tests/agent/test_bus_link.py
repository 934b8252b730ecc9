"""The agent's place on a real bus."""

from __future__ import annotations

import json
import threading
import time
from typing import TYPE_CHECKING

import pytest
from reactivex import Subject
from reactivex.scheduler import EventLoopScheduler

from contextpolicy.agent.bus_link import AgentBus
from contextpolicy.bus import agent_watch as agents
from contextpolicy.bus.agent_watch import AgentWatch
from contextpolicy.bus.decision_bus import agent_key, confirmed_key, plan_key
from contextpolicy.bus.signatures import Signer, Verifier
from contextpolicy.cluster.agent_reports import AgentReport, Confirmation
from contextpolicy.streams.loop import Loop
from tests.agent.builders import NODE
from tests.bus.certificates import signing_keys
from tests.modules.robotkit.bus import Matching, ask, client, router
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    import zenoh

KEY, POLICY = plan_key("robot", "delivery"), "robot/delivery"
STAMP, FAILED = (1, 2, 3), {"containerd://a": "Busy"}


class Listener:
    """Notes what it hears."""

    def __init__(self):
        self.events, self._changed = [], threading.Condition()
        self.late: Subject[Confirmation] = Subject()
        self.lacks = []

    def hear(self, policy, payload, signed):  # noqa: ARG002
        self._note((policy, payload))
        return Confirmation(policy, STAMP, FAILED) if payload else None

    def refuse(self, error):
        self._note(error.reason)

    def find_source(self, policy):
        self._note((policy, "found"))

    def lose_source(self, policy):
        self._note((policy, "lost"))

    def usage(self):
        return {"at": 1.0, "containers": {}}

    def report(self):
        return {"missing": {"CFS": [], "Realtime": self.lacks}}

    def changed(self):
        self._note("changed")

    def expect(self, *events):
        with self._changed:
            assert self._changed.wait_for(lambda: self.events == list(events), PATIENCE), self.events

    def _note(self, event):
        with self._changed:
            self.events.append(event)
            self._changed.notify_all()


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """An agent on a busy machine has time to answer: who asks again hears of the same change twice."""
    monkeypatch.setattr(agents, "PATIENCE", PATIENCE)


@pytest.fixture
def address():
    with router() as address:
        yield address


@pytest.fixture
def operator(address):
    with client(address) as session:
        yield session


@pytest.fixture
def scheduler():
    loop = EventLoopScheduler()
    yield loop
    loop.dispose()


@pytest.fixture
def close(scheduler):
    """Close, and wait until the loop is done with the session."""

    def close(what):
        done = threading.Event()
        what.close()
        scheduler.schedule(lambda *_: done.set())
        assert done.wait(PATIENCE)

    return close


@pytest.fixture
def listener():
    return Listener()


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    return signing_keys(tmp_path_factory.mktemp("keys"))


@pytest.fixture(scope="module")
def verifier(keys):
    return Verifier(keys)


@pytest.fixture(scope="module")
def sign(keys):
    """Sign as the operator does."""
    signer = Signer(keys)
    return lambda payload, key=KEY: signer.sign(key, payload, time.time_ns())


@pytest.fixture
def join(scheduler, listener, verifier):
    """Have an agent join the bus."""
    return lambda session: AgentBus(session, NODE, scheduler, listener, verifier)


@pytest.fixture
def bus(address, operator, join, close):
    """An agent that the operator's plans reach."""
    with client(address) as session, operator.declare_publisher(KEY) as plans:
        bus = join(session)
        Matching(plans).wait(expected=True)
        yield bus
        close(bus)


def test_a_plan_and_its_withdrawal_arrive(bus, operator, listener, sign):  # noqa: ARG001
    operator.put(KEY, b"plan", attachment=sign(b"plan"))
    listener.expect((POLICY, b"plan"))
    operator.delete(KEY, attachment=sign(None))
    listener.expect((POLICY, b"plan"), (POLICY, None))


def test_a_source_is_asked_for_its_plan_and_missed_when_it_is_gone(bus, operator, listener, sign):  # noqa: ARG001
    def answer(query):
        query.reply(query.key_expr, b"in force", attachment=sign(b"in force"))

    with operator.declare_queryable(KEY, answer):
        token = operator.liveliness().declare_token(KEY)
        listener.expect((POLICY, "found"), (POLICY, b"in force"))
        token.undeclare()
        listener.expect((POLICY, "found"), (POLICY, b"in force"), (POLICY, "lost"))


def test_what_is_not_a_plan_is_not_heard(bus, operator, listener, sign):  # noqa: ARG001
    operator.put("contextpolicy/robot/delivery/applied", b"no plan")
    operator.put("robot/imu", b"no plan")
    operator.put(KEY, b"plan", attachment=sign(b"plan"))
    listener.expect((POLICY, b"plan"))


@pytest.fixture
def _impatient(monkeypatch):
    monkeypatch.setattr(agents, "RETURN", 0.0)


@pytest.mark.usefixtures("_impatient")
def test_the_operator_learns_what_the_node_lacks_and_when_its_agent_is_gone(
    address, operator, scheduler, close, verifier
):
    agent, watcher = Listener(), Listener()
    watch = AgentWatch(operator, scheduler, watcher.changed)
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


def test_an_agent_that_did_not_answer_in_time_is_asked_again(address, operator, scheduler, close, monkeypatch):
    monkeypatch.setattr(agents, "PATIENCE", 0.05)
    monkeypatch.setattr(agents, "PAUSE", 0.01)
    held: list[zenoh.Query] = []
    watcher = Listener()
    watch = AgentWatch(operator, scheduler, watcher.changed)
    with client(address) as session:

        def answer(query):
            if not held:
                held.append(query)
                return
            with query:
                query.reply(query.key_expr, json.dumps(Listener().report()).encode())

        queryable = session.declare_queryable(agent_key(NODE), answer)
        token = session.liveliness().declare_token(agent_key(NODE))
        watcher.expect("changed", "changed")
        assert watch.reports == {NODE: AgentReport("", "")}
        held.pop().drop()
        token.undeclare()
        queryable.undeclare()
    close(watch)


def test_anybody_may_ask_what_the_node_can_do(bus, operator):  # noqa: ARG001
    [answer] = ask(operator, agent_key(NODE))
    assert json.loads(answer) == {"missing": {"CFS": [], "Realtime": []}}


def test_forged_plans_are_refused_and_hide_no_real_one(bus, operator, listener, sign):  # noqa: ARG001
    good = sign(b"plan")
    operator.put(KEY, b"forged")
    operator.put(KEY, b"forged", attachment=good)
    operator.put(plan_key("kube-system", "x"), b"plan", attachment=good)
    operator.put("*/robot/delivery/plan", b"plan", attachment=good)
    operator.delete(KEY)
    operator.put(KEY, b"plan", attachment=good)
    listener.expect("Unsigned", "Forged", "Forged", "Forged", "Unsigned", (POLICY, b"plan"))


def test_an_answer_is_checked_as_a_plan_is(bus, operator, listener):  # noqa: ARG001
    def answer(query):
        query.reply(query.key_expr, b"forged")

    with operator.declare_queryable(KEY, answer), operator.liveliness().declare_token(KEY):
        listener.expect((POLICY, "found"), "Unsigned")


def test_of_plans_that_wait_the_one_signed_last_counts(bus, scheduler, listener):
    """Saying an older plan again must not take the place of a newer one."""
    go = threading.Event()
    scheduler.schedule(lambda *_: go.wait(PATIENCE))
    bus._put(POLICY, b"newer", 2)
    bus._put(POLICY, b"older", 1)
    go.set()
    listener.expect((POLICY, b"newer"))


def test_what_goes_wrong_with_one_policys_plan_loses_no_others(address, verifier):
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


def test_what_is_carried_out_is_confirmed(bus, operator, sign):  # noqa: ARG001
    confirmed, heard = [], threading.Event()

    def hear(sample):
        confirmed.append(json.loads(sample.payload.to_bytes()))
        heard.set()

    with operator.declare_subscriber(confirmed_key(NODE), hear):
        while not heard.wait(0.01):
            operator.put(KEY, b"plan", attachment=sign(b"plan"))
    assert confirmed[0] == {"policy": POLICY, "stamp": list(STAMP), "failed": FAILED}
