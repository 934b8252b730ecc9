"""What each role can and can't do, with real clients at a real router."""

from __future__ import annotations

import time
from contextlib import ExitStack
from queue import Queue

import pytest
import zenoh
import zenoh.ext

from contextpolicy.bus.credentials import client_settings
from contextpolicy.bus.roles import OWN, all_but
from contextpolicy.bus.session import _config, open_router
from tests.bus.certificates import ROLES
from tests.bus.client import client_of
from tests.bus.entering import with_password
from tests.bus.hearing import NEVER, Heard
from tests.modules.robotkit.bus import ask
from tests.ports import free_port
from tests.waiting import PATIENCE

PLAN, SAMPLE, NODE = "contextpolicy/robot/delivery/plan", "robot/imu", "contextpolicy/agents/node-1"
WILD = ["*/robot/delivery/plan", "**", "**/plan", "contextpolicy/**", "*/*/*/plan", "context$*/robot/delivery/plan"]


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


@pytest.mark.parametrize("listener", ["module", "operator"])
@pytest.mark.parametrize("speaker", ["sensor", "module"])
def test_samples_are_received(bus, speaker, listener):
    with Heard(bus(listener), SAMPLE) as heard:
        heard.until(bus(speaker), SAMPLE, "sample")


def test_latched_samples_reach_late_subscribers(bus):
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
def test_plans_are_received_and_queries_answered(bus, listener):
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
def test_only_the_operator_answers_plan_queries(bus, role, key):
    forged = bus(role, "forger").declare_queryable("**", lambda query: query.reply(key, "forged"))
    with bus("operator").declare_queryable(PLAN, lambda query: query.reply(PLAN, "plan")):
        answers = ask(bus("agent"), PLAN)
    forged.undeclare()
    assert answers == ["plan"]


@pytest.mark.parametrize(
    "key", ["**", "*/**", "contextpolicy/**", "context$*/**", "*/*/*/plan", "contextpolicy/agents/*", "*/agents/*"]
)
@pytest.mark.parametrize("role", ["sensor", "module", "viewer"])
def test_complete_queryable_cannot_capture_queries_of_others(bus, role, key):
    """Zenoh sends a query to one queryable that calls itself complete, and to no other."""
    greedy = bus(role, "forger").declare_queryable(key, lambda query: query.drop(), complete=True)
    with (
        bus("operator").declare_queryable(PLAN, lambda query: query.reply(PLAN, "plan")),
        bus("agent").declare_queryable(NODE, lambda query: query.reply(NODE, "report")),
    ):
        answers = ask(bus("agent"), PLAN), ask(bus("operator"), "contextpolicy/agents/*")
    greedy.undeclare()
    assert answers == (["plan"], ["report"])


@pytest.mark.parametrize("role", ["sensor", "module"])
def test_only_the_operators_plans_reach_a_module(bus, role):
    with Heard(bus("module"), PLAN) as heard:
        heard.until(bus("operator"), PLAN, "plan")
        for key in (PLAN, *WILD):
            bus(role, "forger").put(key, f"forged as {key}")
        heard.until(bus("operator"), PLAN, "next")
        heard.nothing()


@pytest.mark.parametrize("role", ["sensor", "module", "agent", "viewer"])
def test_only_the_operators_plans_reach_an_agent(bus, role):
    with Heard(bus("agent"), "contextpolicy/*/*/plan") as heard:
        heard.until(bus("operator"), PLAN, "plan")
        for key in (PLAN, *WILD):
            bus(role, "forger").put(key, f"forged as {key}")
        bus(role, "forger").delete(PLAN)
        heard.until(bus("operator"), PLAN, "next")
        heard.nothing()


@pytest.mark.parametrize("role", ["sensor", "module", "viewer"])
def test_only_agents_report_nodes(bus, role):
    with Heard(bus("operator"), "contextpolicy/agents/*/confirmed") as heard:
        bus(role).put(f"{NODE}/confirmed", "forged")
        heard.until(bus("agent"), f"{NODE}/confirmed", "confirmed")
        heard.nothing()


@pytest.mark.parametrize(("role", "key"), [("sensor", "**"), ("agent", "robot/**"), ("viewer", "robot/**")])
def test_roles_without_samples_receive_none(bus, role, key):
    with Heard(bus(role), key) as overheard, Heard(bus("module"), SAMPLE) as heard:
        heard.until(bus("module"), SAMPLE, "sample")
        overheard.nothing()


@pytest.mark.parametrize("role", ["sensor", "module", "viewer", "agent"])
def test_only_the_operator_can_announce_plans(bus, role):
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


def test_operator_sees_and_queries_agents(bus):
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


@pytest.mark.parametrize("key", ["**", "*/agents/*", "*/*/node-1"])
def test_agents_are_not_asked_by_keys_beyond_ours(bus, key):
    """The router bounds only what questions on keys within ours carry."""
    asked: Queue[str] = Queue()

    def answer(query: zenoh.Query) -> None:
        asked.put(str(query.key_expr))
        query.reply(NODE, "report")

    with bus("agent").declare_queryable(NODE, answer):
        assert ask(bus("operator"), "contextpolicy/agents/*") == ["report"]
        for role in ("module", "viewer"):
            answers = bus(role).get(key, payload=bytes(5000), timeout=NEVER)
            assert not [one for one in answers if one.ok and str(one.ok.key_expr) == NODE]
    assert {asked.get_nowait() for _ in range(asked.qsize())} == {"contextpolicy/agents/*"}


@pytest.mark.parametrize("role", ["sensor", "module"])
def test_the_nodes_of_ros_see_each_other(bus, role):
    """rmw_zenoh's graph is made of such tokens; without it no service is found, and `ros2 topic list` is empty."""
    tokens: Queue[tuple[str, zenoh.SampleKind]] = Queue()
    graph = (
        bus("module")
        .liveliness()
        .declare_subscriber("@ros2_lv/0/**", lambda token: tokens.put((str(token.key_expr), token.kind)), history=True)
    )
    key = f"@ros2_lv/0/c0ffee/0/0/NN/%/%/{role}"
    token = bus(role, "node").liveliness().declare_token(key)
    assert tokens.get(timeout=PATIENCE) == (key, zenoh.SampleKind.PUT)
    replies = bus("module", "late").liveliness().get("@ros2_lv/0/**", timeout=PATIENCE)
    assert [str(reply.ok.key_expr) for reply in replies if reply.ok] == [key]
    token.undeclare()
    assert tokens.get(timeout=PATIENCE) == (key, zenoh.SampleKind.DELETE)
    graph.undeclare()


ANY = [
    *("robot/imu", "rt/tf", "0/imu/sensor_msgs::msg::dds_::Imu_/TypeHashNotSupported", "camera", "c/x", "context/x"),
    *("contextpolicies/x", "contextpolic/x", "conveyor/belt/1", "Contextpolicy/x", "_x/y", "~/imu", "%rt%imu/Imu_"),
]


@pytest.mark.parametrize("key", ANY)
def test_a_sample_may_have_any_key_but_ours(key):
    allowed = [zenoh.KeyExpr(one) for one in all_but(OWN)]
    assert any(one.includes(zenoh.KeyExpr(key)) for one in allowed)


def test_allowed_keys_do_not_intersect_ours():
    assert [one for one in all_but(OWN) if zenoh.KeyExpr(one).intersects(zenoh.KeyExpr("contextpolicy/**"))] == []


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
