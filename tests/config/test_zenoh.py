"""The Zenoh configurations do what their comments say, on a real router."""

from __future__ import annotations

import json
import socket
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import Empty, Queue

import pytest
import zenoh

from contextpolicy.bus.roles import ROLES, access_control

CONFIGURATIONS = Path(__file__).parents[2] / "config" / "zenoh"
USERS = ROLES
SOON = 5.0
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
    with socket.create_server(("127.0.0.1", 0)) as free:
        endpoint = f"tcp/127.0.0.1:{free.getsockname()[1]}"
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
    wait_for_listener(publisher)
    publisher.put(text)


def wait_for_listener(publisher):
    matching: Queue[bool] = Queue()
    with publisher.declare_matching_listener(lambda status: matching.put(status.matching)):
        if not publisher.matching_status.matching:
            matching.get(timeout=SOON)


def test_a_sensor_is_heard_by_modules_and_operator(connect):
    heard = [listen(connect(user), "robot/**") for user in ("module", "operator")]
    say(connect("sensor"), "robot/imu", "sample")
    assert [one.get(timeout=SOON) for one in heard] == ["sample", "sample"]


def test_the_operators_plan_is_heard_by_modules(connect):
    heard = listen(connect("module"), "contextpolicy/**")
    say(connect("operator"), "contextpolicy/robot/delivery-robot/plan", "plan")
    assert heard.get(timeout=SOON) == "plan"


def test_a_module_asks_for_the_last_plan(connect):
    key = "contextpolicy/robot/delivery-robot/plan"
    connect("operator").declare_queryable(key, lambda query: query.reply(key, "plan"))
    answers = [reply.ok.payload.to_string() for reply in connect("module").get("contextpolicy/*/*/plan", timeout=SOON)]
    assert answers == ["plan"]


def test_a_module_tells_another_its_profile(connect):
    key = "robot/slam/profile"
    connect("module").declare_queryable(key, lambda query: query.reply(key, "profile"))
    asker = connect("module")
    answers = next(filter(None, (list(asker.get(key, timeout=SOON)) for _ in range(1000))))
    assert answers[0].ok.payload.to_string() == "profile"


def test_the_operator_and_the_agents_know_of_each_other(connect):
    operator, agent = connect("operator"), connect("agent")
    plan, node = "contextpolicy/robot/delivery-robot/plan", "contextpolicy/agents/node-1"
    heard: Queue[tuple[str, bool]] = Queue()
    for session, others in ((operator, "contextpolicy/agents/*"), (agent, "contextpolicy/*/*/plan")):
        session.liveliness().declare_subscriber(
            others, lambda token: heard.put((str(token.key_expr), token.kind == zenoh.SampleKind.PUT)), history=True
        )
    tokens = operator.liveliness().declare_token(plan), agent.liveliness().declare_token(node)
    assert {heard.get(timeout=SOON) for _ in tokens} == {(plan, True), (node, True)}
    agent.declare_queryable(node, lambda query: query.reply(node, "report"))
    answers = next(filter(None, (list(operator.get("contextpolicy/agents/*", timeout=SOON)) for _ in range(1000))))
    assert answers[0].ok.payload.to_string() == "report"
    for token in tokens:
        token.undeclare()
    assert {heard.get(timeout=SOON) for _ in tokens} == {(plan, False), (node, False)}


def test_an_agent_hears_that_plans_are_withdrawn(connect):
    key = "contextpolicy/robot/delivery-robot/plan"
    withdrawn = Queue()
    connect("agent").declare_subscriber(key, lambda sample: withdrawn.put(sample.kind == zenoh.SampleKind.DELETE))
    publisher = connect("operator").declare_publisher(key)
    wait_for_listener(publisher)
    publisher.delete()
    assert withdrawn.get(timeout=SOON)


@pytest.mark.parametrize("user", ["sensor", "module", "agent"])
def test_nobody_else_makes_plans(connect, user):
    key = "contextpolicy/robot/delivery-robot/plan"
    heard = listen(connect("module"), "contextpolicy/**")
    forger = connect(user)
    forger.put(key, "forged")
    say(connect("operator"), key, "plan")
    forger.put(key, "forged")
    assert heard.get(timeout=SOON) == "plan"
    with pytest.raises(Empty):
        heard.get(timeout=NEVER)


def test_a_sensor_hears_nothing(connect):
    overheard, heard = listen(connect("sensor"), "**"), listen(connect("module"), "robot/**")
    say(connect("module"), "robot/slam/pose", "pose")
    assert heard.get(timeout=SOON) == "pose"
    with pytest.raises(Empty):
        overheard.get(timeout=NEVER)


@pytest.mark.parametrize("password", ["", "wrong"])
def test_a_stranger_is_not_let_in(router, password):
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "client.json5"))
    config.insert_json5("connect", json.dumps({"endpoints": [router], "timeout_ms": 0, "exit_on_failure": True}))
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": "operator", "password": password}))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
