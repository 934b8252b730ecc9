"""The Zenoh configurations do what their comments say, on a real router."""

from __future__ import annotations

import json
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import Empty, Queue

import pytest
import zenoh

from contextpolicy.bus.roles import ROLES, access_control
from tests.modules.robotkit.bus import Matching, ask
from tests.ports import free_port
from tests.waiting import PATIENCE, until

CONFIGURATIONS = Path(__file__).parents[2] / "config" / "zenoh"
USERS = ROLES
NEVER = 0.3


@pytest.mark.parametrize("path", sorted(CONFIGURATIONS.glob("*.json5")), ids=lambda path: path.name)
def test_zenoh_understands_the_configuration(path):
    assert json.loads(zenoh.Config.from_file(str(path)).get_json("mode")) in ("client", "router")


def test_the_routers_rules_are_those_of_the_charts_router():
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "router-acl.json5"))
    expected = zenoh.Config()
    expected.insert_json5("access_control", json.dumps(access_control(by="usernames")))
    assert json.loads(config.get_json("access_control")) == json.loads(expected.get_json("access_control"))


@pytest.fixture
def router(tmp_path):
    users = tmp_path / "users.txt"
    users.write_text("".join(f"{name}:{name}-password\n" for name in USERS))
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "router-acl.json5"))
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(users)))
    with zenoh.open(config):
        yield endpoint


@pytest.fixture
def connect(router):
    with ExitStack() as sessions:
        yield lambda user: sessions.enter_context(client(router, user))


@contextmanager
def client(endpoint, user):
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "client.json5"))
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": user, "password": f"{user}-password"}))
    with zenoh.open(config) as session:
        yield session


def listen(session, key):
    heard: Queue[str] = Queue()
    session.declare_subscriber(key, lambda sample: heard.put(sample.payload.to_string()))
    return heard


def say(session, key, text):
    publisher = session.declare_publisher(key)
    Matching(publisher).wait(expected=True)
    publisher.put(text)


def test_a_sensor_is_heard_by_modules_and_operator(connect):
    sensor, heard = connect("sensor"), [listen(connect(user), "robot/**") for user in ("module", "operator")]
    for one in heard:  # each listener is known to the router when it is
        until(lambda one=one: say(sensor, "robot/imu", "sample") or not one.empty())
        assert one.get() == "sample"


def test_the_operators_plan_is_heard_by_modules(connect):
    heard = listen(connect("module"), "contextpolicy/**")
    say(connect("operator"), "contextpolicy/robot/delivery-robot/plan", "plan")
    assert heard.get(timeout=PATIENCE) == "plan"


def test_a_module_asks_for_the_last_plan(connect):
    key = "contextpolicy/robot/delivery-robot/plan"
    connect("operator").declare_queryable(key, lambda query: query.reply(key, "plan"))
    assert ask(connect("module"), "contextpolicy/*/*/plan") == ["plan"]


def test_a_module_tells_another_its_profile(connect):
    key = "robot/slam/profile"
    connect("module").declare_queryable(key, lambda query: query.reply(key, "profile"))
    assert ask(connect("module"), key) == ["profile"]


def test_the_operator_and_the_agents_know_of_each_other(connect):
    operator, agent = connect("operator"), connect("agent")
    plan, node = "contextpolicy/robot/delivery-robot/plan", "contextpolicy/agents/node-1"
    alive: set[str] = set()

    def follow(token):
        (alive.add if token.kind == zenoh.SampleKind.PUT else alive.discard)(str(token.key_expr))

    for session, others in ((operator, "contextpolicy/agents/*"), (agent, "contextpolicy/*/*/plan")):
        session.liveliness().declare_subscriber(others, follow, history=True)
    tokens = operator.liveliness().declare_token(plan), agent.liveliness().declare_token(node)
    until(lambda: alive == {plan, node})
    agent.declare_queryable(node, lambda query: query.reply(node, "report"))
    assert ask(operator, "contextpolicy/agents/*") == ["report"]
    for token in tokens:
        token.undeclare()
    until(lambda: not alive)


def test_an_agent_hears_that_plans_are_withdrawn(connect):
    key = "contextpolicy/robot/delivery-robot/plan"
    withdrawn: Queue[bool] = Queue()
    connect("agent").declare_subscriber(key, lambda sample: withdrawn.put(sample.kind == zenoh.SampleKind.DELETE))
    publisher = connect("operator").declare_publisher(key)
    Matching(publisher).wait(expected=True)
    publisher.delete()
    assert withdrawn.get(timeout=PATIENCE)


@pytest.mark.parametrize("user", ["sensor", "module", "agent"])
def test_nobody_else_makes_plans(connect, user):
    key = "contextpolicy/robot/delivery-robot/plan"
    heard = listen(connect("module"), "contextpolicy/**")
    forger = connect(user)
    forger.put(key, "forged")
    say(connect("operator"), key, "plan")
    forger.put(key, "forged")
    assert heard.get(timeout=PATIENCE) == "plan"
    with pytest.raises(Empty):
        heard.get(timeout=NEVER)


def test_a_sensor_hears_nothing(connect):
    overheard, heard = listen(connect("sensor"), "**"), listen(connect("module"), "robot/**")
    say(connect("module"), "robot/slam/pose", "pose")
    assert heard.get(timeout=PATIENCE) == "pose"
    with pytest.raises(Empty):
        overheard.get(timeout=NEVER)


@pytest.mark.parametrize("password", ["", "wrong"])
def test_a_stranger_is_not_let_in(router, password):
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "client.json5"))
    config.insert_json5("connect", json.dumps({"endpoints": [router], "timeout_ms": 0, "exit_on_failure": True}))
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": "operator", "password": password}))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
