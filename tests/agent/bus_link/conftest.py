"""An agent's place on a real bus, an operator on it, and the operator's key."""

from __future__ import annotations

import threading
import time

import pytest
from reactivex.scheduler import EventLoopScheduler

from contextpolicy.agent.bus_link import AgentBus
from contextpolicy.bus import agent_watch as agents
from contextpolicy.bus.signatures import Signer, Verifier
from tests.agent.builders import NODE
from tests.agent.bus_link.listening import KEY, Listener
from tests.bus.certificates import signing_keys
from tests.modules.robotkit.bus import Matching, client, router
from tests.waiting import PATIENCE


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
    """Sign as the operator does, so many seconds ago."""
    signer = Signer(keys)
    return lambda payload, key=KEY, ago=0: signer.sign(key, payload, time.time_ns() - ago * 10**9)


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


@pytest.fixture
def _impatient(monkeypatch):
    monkeypatch.setattr(agents, "RETURN", 0.0)
