"""What each role can and can't do, with real clients at a real router, and who is not let in at all."""

from __future__ import annotations

import json
import time
from contextlib import ExitStack, suppress
from queue import Empty, Queue
from threading import Event

import pytest
import zenoh
import zenoh.ext

from contextpolicy.bus.credentials import client_settings
from contextpolicy.bus.session import _config, open_client, open_router, open_visitor
from tests.bus.certificates import ROLES, Authority
from tests.bus.client import client_of
from tests.modules.robotkit.bus import Matching, ask
from tests.ports import free_port
from tests.waiting import PATIENCE, until

PLAN, SAMPLE, NODE = "contextpolicy/robot/delivery/plan", "robot/imu", "contextpolicy/agents/node-1"
WILD = ["*/robot/delivery/plan", "**", "**/plan", "contextpolicy/**", "*/*/*/plan", "context$*/robot/delivery/plan"]
NEVER = 0.3
ATTEMPT = 0.7


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("authority"))


@pytest.fixture(scope="module")
def users(authority):
    """A router that asks for passwords."""
    directory = authority.issue("router", name="router-with-users")
    (directory / "users.txt").write_text("".join(f"{role}:secret-of-{role}\n" for role in ROLES))
    return directory


@pytest.fixture(scope="module", params=["certificates", "passwords"])
def bus(request, authority, users):
    """A router, and a way to connect to it in a role."""
    directory = authority.issue("router") if request.param == "certificates" else users
    endpoint = f"tls/127.0.0.1:{free_port()}"
    identify = authority.issue if request.param == "certificates" else lambda role: with_password(authority, role)
    with open_router([endpoint], directory), ExitStack() as sessions:
        yield Bus(endpoint, {role: identify(role) for role in ROLES}, sessions)


class Bus:
    """Connects in a role; the same session for the same role and name."""

    def __init__(self, endpoint, credentials, sessions):
        self.settings = {"mode": "client", "connect/endpoints": [endpoint], **client_settings(credentials["sensor"])}
        self._endpoint, self._credentials, self._sessions = endpoint, credentials, sessions
        self._known: dict[tuple[str, str], zenoh.Session] = {}

    def __call__(self, role, who="first"):
        if (role, who) not in self._known:
            session = client_of(self._endpoint, self._credentials[role])
            self._known[role, who] = self._sessions.enter_context(session)
        return self._known[role, who]


def with_password(authority, role, password=""):
    directory = authority.trust(f"{role}-with-{password or 'password'}")
    (directory / "username").write_text(role)
    (directory / "password").write_text(password or f"secret-of-{role}\n")
    return directory


class Heard:
    """What a subscriber hears."""

    def __init__(self, session, key):
        self.queue: Queue[str] = Queue()
        self.said: set[str] = set()
        self.subscriber = session.declare_subscriber(key, lambda sample: self.queue.put(sample.payload.to_string()))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.subscriber.undeclare()

    def until(self, session, key, text):
        """Say it until it is heard: a subscription takes a moment to reach the router, and a busy one drops some."""
        self.said.add(text)
        for _ in range(30):
            say(session, key, text)
            with suppress(Empty):
                while (heard := self.next(timeout=1.0)) != text:
                    assert heard in self.said
                return
        raise AssertionError(f"{text} was never heard")

    def next(self, timeout=PATIENCE):
        return self.queue.get(timeout=timeout)

    def nothing(self):
        """Nothing but what was said to it."""
        heard = set()
        with suppress(Empty):
            while True:
                heard.add(self.next(timeout=NEVER))
        assert heard <= self.said


def say(session, key, text):
    """As soon as somebody listens, or the router does not say who does."""
    with session.declare_publisher(key) as publisher:
        Matching(publisher).wait(expected=True)
        publisher.put(text)


@pytest.mark.parametrize("listener", ["module", "operator"])
@pytest.mark.parametrize("speaker", ["sensor", "module"])
def test_samples_are_heard(bus, speaker, listener):
    with Heard(bus(listener), SAMPLE) as heard:
        heard.until(bus(speaker), SAMPLE, "sample")


def test_latched_samples_are_heard_by_who_comes_later(bus):
    """As rmw_zenoh keeps them for topics such as /tf_static."""
    cache = zenoh.ext.CacheConfig(max_samples=1)
    driver = zenoh.open(_config({**bus.settings, "timestamping/enabled": True}))
    latched = zenoh.ext.declare_advanced_publisher(driver, "robot/map", cache=cache, publisher_detection=True)
    latched.put("map")
    heard: Queue[str] = Queue()
    history = zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=1)
    late = zenoh.ext.declare_advanced_subscriber(
        bus("operator"), "robot/map", lambda sample: heard.put(sample.payload.to_string()), history=history
    )
    assert heard.get(timeout=PATIENCE) == "map"
    late.undeclare()
    driver.close()


@pytest.mark.parametrize("listener", ["module", "agent", "viewer"])
def test_plans_are_heard_and_answered(bus, listener):
    operator = bus("operator")
    with Heard(bus(listener), "contextpolicy/*/*/plan") as heard:
        heard.until(operator, PLAN, "plan")
    with operator.declare_queryable(PLAN, lambda query: query.reply(PLAN, "in force")):
        assert ask(bus(listener), PLAN) == ["in force"]


def test_a_module_answers_for_itself(bus):
    key = "robot/slam/profile"
    with bus("module").declare_queryable(key, lambda query: query.reply(key, "profile")):
        assert ask(bus("operator"), key) == ["profile"]


@pytest.mark.parametrize("key", [PLAN, "*/robot/delivery/plan"])
@pytest.mark.parametrize("role", ["sensor", "module", "viewer", "agent"])
def test_nobody_but_the_operator_answers_for_plans(bus, role, key):
    forged = bus(role, "forger").declare_queryable("**", lambda query: query.reply(key, "forged"))
    with bus("operator").declare_queryable(PLAN, lambda query: query.reply(PLAN, "plan")):
        answers = ask(bus("agent"), PLAN)
    forged.undeclare()
    assert answers == ["plan"]


@pytest.mark.parametrize("key", [PLAN, *WILD])
@pytest.mark.parametrize("role", ["sensor", "module", "agent", "viewer"])
def test_nobody_but_the_operator_reaches_an_agent_with_a_plan(bus, role, key):
    with Heard(bus("agent"), "contextpolicy/*/*/plan") as heard:
        heard.until(bus("operator"), PLAN, "plan")
        bus(role, "forger").put(key, "forged")
        bus(role, "forger").delete(PLAN)
        heard.until(bus("operator"), PLAN, "next")
        heard.nothing()


@pytest.mark.parametrize("role", ["sensor", "module", "viewer"])
def test_nobody_but_agents_speaks_for_nodes(bus, role):
    with Heard(bus("operator"), "contextpolicy/agents/*/confirmed") as heard:
        bus(role).put(f"{NODE}/confirmed", "forged")
        heard.until(bus("agent"), f"{NODE}/confirmed", "confirmed")
        heard.nothing()


@pytest.mark.parametrize(("role", "key"), [("sensor", "**"), ("agent", "robot/**"), ("viewer", "robot/**")])
def test_who_need_not_hear_samples_does_not(bus, role, key):
    with Heard(bus(role), key) as overheard, Heard(bus("module"), SAMPLE) as heard:
        heard.until(bus("module"), SAMPLE, "sample")
        overheard.nothing()


@pytest.mark.parametrize("role", ["sensor", "module", "viewer", "agent"])
def test_nobody_but_the_operator_seems_to_make_plans(bus, role):
    tokens: Queue[str] = Queue()
    real = f"contextpolicy/robot/of-{role}/plan"
    listener = (
        bus("agent")
        .liveliness()
        .declare_subscriber("contextpolicy/*/*/plan", lambda token: tokens.put(str(token.key_expr)), history=True)
    )
    forged = [bus(role, "forger").liveliness().declare_token(key) for key in (PLAN, *WILD)]
    token = bus("operator").liveliness().declare_token(real)
    heard = set(iter(lambda: tokens.get(timeout=PATIENCE), real))
    time.sleep(NEVER)
    heard |= {tokens.get_nowait() for _ in range(tokens.qsize())}
    assert not heard & {PLAN, *WILD}
    for declared in (*forged, token, listener):
        declared.undeclare()


def test_operator_and_agents_know_of_each_other(bus):
    tokens: Queue[zenoh.SampleKind] = Queue()
    listener = (
        bus("operator")
        .liveliness()
        .declare_subscriber("contextpolicy/agents/*", lambda token: tokens.put(token.kind), history=True)
    )
    token = bus("agent").liveliness().declare_token(NODE)
    assert tokens.get(timeout=PATIENCE) == zenoh.SampleKind.PUT
    with bus("agent").declare_queryable(NODE, lambda query: query.reply(NODE, "report")):
        assert ask(bus("operator"), "contextpolicy/agents/*") == ["report"]
    token.undeclare()
    assert tokens.get(timeout=PATIENCE) == zenoh.SampleKind.DELETE
    listener.undeclare()


# who is not let in


@pytest.fixture(scope="module")
def closed(authority):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], authority.issue("router", name="closed")):
        yield endpoint


def refused(endpoint, credentials):
    with pytest.raises(zenoh.ZError):
        open_visitor([endpoint], patience=ATTEMPT, credentials=credentials)


def test_without_a_certificate_nobody_is_let_in(authority, closed):
    refused(closed, authority.trust("anonymous"))
    refused(closed.replace("tls/", "tcp/"), None)


def test_a_password_is_no_certificate(authority, closed):
    refused(closed, with_password(authority, "operator"))


def test_an_expired_certificate_is_not_let_in(authority, closed):
    refused(closed, authority.issue("operator", name="expired", seconds=-1))


def test_a_certificate_of_another_authority_is_not_let_in(authority, closed, tmp_path):
    foreign = Authority(tmp_path).issue("operator")
    (foreign / "ca.crt").write_bytes((authority.trust("anonymous") / "ca.crt").read_bytes())
    refused(closed, foreign)


def test_a_client_does_not_talk_to_another_authoritys_router(closed, tmp_path):
    refused(closed, Authority(tmp_path).issue("operator"))


@pytest.mark.parametrize("password", ["wrong", None], ids=["wrong", "none"])
def test_without_the_password_nobody_is_let_in(authority, users, password):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    stranger = with_password(authority, "operator", password) if password else authority.trust("anonymous")
    with open_router([endpoint], users):
        refused(endpoint, stranger)


def test_an_unknown_role_is_let_in_and_can_do_nothing(authority, closed):
    stranger = authority.issue("admin")
    with (
        open_visitor([closed], patience=PATIENCE, credentials=stranger) as session,
        open_visitor([closed], patience=PATIENCE, credentials=stranger) as listener,
        open_visitor([closed], patience=PATIENCE, credentials=authority.issue("operator")) as operator,
        Heard(listener, "**") as overheard,
        Heard(operator, SAMPLE) as heard,
        open_visitor([closed], patience=PATIENCE, credentials=authority.issue("sensor")) as sensor,
    ):
        session.put(SAMPLE, "forged")
        heard.until(sensor, SAMPLE, "sample")
        heard.nothing()
        overheard.nothing()


def test_sensors_can_be_kept_to_their_keys(authority):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with (
        open_router([endpoint], authority.issue("router"), ["robot/**"]),
        client_of(endpoint, authority.issue("operator")) as operator,
        client_of(endpoint, authority.issue("sensor")) as sensor,
        Heard(operator, "robot/**") as heard,
    ):
        for key in ("lab/imu", "**", "*/imu"):
            sensor.put(key, "beyond")
        heard.until(sensor, SAMPLE, "sample")
        heard.nothing()


# renewal


def routers(session):
    return list(session.info.routers_zid())


def test_a_certificate_that_ends_ends_the_session_until_it_is_renewed(authority, closed):
    """Nothing is restarted: Zenoh reads a client's files each time it connects."""
    sessions = []

    def opened():
        credentials = authority.issue("operator", name="short", seconds=3)
        with suppress(zenoh.ZError):  # it took so long that the certificate has ended before
            sessions.append(open_visitor([closed], patience=PATIENCE, credentials=credentials))
        return sessions

    until(opened)
    with sessions[0] as session:
        until(lambda: not routers(session))
        authority.issue("operator", name="short")
        until(lambda: routers(session))


def test_no_secret_is_said(authority, closed, capfd, caplog):
    secret = with_password(authority, "operator", "do-not-tell")
    refused(closed, secret)
    stop = Event()
    open_client([closed.replace("tls/", "nonsense/")], _after_one(stop), secret)
    key = (authority.issue("operator") / "tls.key").read_text().splitlines()[1]
    said = json.dumps([record.getMessage() for record in caplog.records]) + "".join(capfd.readouterr())
    assert "do-not-tell" not in said
    assert key not in said
    assert caplog.records


def _after_one(stop):
    """Stops the attempts after the first."""
    stop.wait = lambda _: stop.set()
    return stop
