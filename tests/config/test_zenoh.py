"""The Zenoh configurations do what their comments say, on a real router."""

from __future__ import annotations

import json
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import Queue

import pytest
import zenoh

from contextpolicy.bus.roles import access_control
from contextpolicy.bus.session import LARGEST, _bounds, _config, _router
from tests.bus.certificates import ROLES
from tests.modules.robotkit.bus import Matching
from tests.ports import free_port
from tests.waiting import PATIENCE, until

CONFIGURATIONS = Path(__file__).parents[2] / "config" / "zenoh"
SAMPLES = ["robot/**", "0/**"]
NEVER = 0.3


@pytest.mark.parametrize("path", sorted(CONFIGURATIONS.glob("*.json5")), ids=lambda path: path.name)
def test_zenoh_understands_the_configuration(path):
    assert json.loads(zenoh.Config.from_file(str(path)).get_json("mode")) in ("client", "router")


def test_router_acl_equals_the_charts():
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "router-acl.json5"))
    expected = zenoh.Config()
    expected.insert_json5("access_control", json.dumps(access_control(SAMPLES, by="usernames")))
    assert json.loads(config.get_json("access_control")) == json.loads(expected.get_json("access_control"))


BOUNDS = {
    "qos/network",
    "low_pass_filter",
    "transport/link/rx/max_message_size",
    "transport/link/tx/queue/congestion_control/block",
}


@pytest.mark.parametrize("key", sorted(BOUNDS))
def test_router_bounds_equal_the_charts(key):
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "router-acl.json5"))
    charts = _config({**_router([]), **_bounds(LARGEST)})
    assert json.loads(config.get_json(key)) == json.loads(charts.get_json(key))


@pytest.fixture
def router(tmp_path):
    users = tmp_path / "users.txt"
    users.write_text("".join(f"{name}:{name}-password\n" for name in ROLES))
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


def test_modules_and_operator_receive_sensor_samples(connect):
    sensor, heard = connect("sensor"), [listen(connect(user), "robot/**") for user in ("module", "operator")]
    for one in heard:  # each listener is known to the router when it is
        until(lambda one=one: say(sensor, "robot/imu", "sample") or not one.empty())
        assert one.get() == "sample"


def test_an_agent_receives_withdrawals_of_plans(connect):
    key = "contextpolicy/robot/delivery-robot/plan"
    withdrawn: Queue[bool] = Queue()
    connect("agent").declare_subscriber(key, lambda sample: withdrawn.put(sample.kind == zenoh.SampleKind.DELETE))
    publisher = connect("operator").declare_publisher(key)
    Matching(publisher).wait(expected=True)
    publisher.delete()
    assert withdrawn.get(timeout=PATIENCE)


@pytest.mark.parametrize("password", ["", "wrong"])
def test_client_without_the_password_is_refused(router, password):
    config = zenoh.Config.from_file(str(CONFIGURATIONS / "client.json5"))
    config.insert_json5("connect", json.dumps({"endpoints": [router], "timeout_ms": 0, "exit_on_failure": True}))
    config.insert_json5("transport/auth/usrpwd", json.dumps({"user": "operator", "password": password}))
    with pytest.raises(zenoh.ZError):
        zenoh.open(config)
