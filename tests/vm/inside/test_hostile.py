"""An attacker with the operator's certificate and signing key changes no foreign limit, under cgroup v2."""

import base64
import json
import time
from contextlib import contextmanager

from contextpolicy.bus.decision_bus import agent_key, plan_key
from contextpolicy.bus.session import open_visitor
from contextpolicy.bus.signatures import Signer
from tests.e2e.cluster import until
from tests.vm.chart import NAMESPACE, RELEASE, ROBOT, ROUTER
from tests.vm.inside import api
from tests.vm.inside.files import container_id, limit, scope
from tests.vm.inside.robot import MOVING, STANDING, agreed, drive, govern, let_go, start

KEY = plan_key(ROBOT, "robot")
STRANGER, OTHER = "stranger", "default"


def files(secret, directory):
    """What a pod would see of a Secret of the release."""
    directory.mkdir()
    for name, content in api.get("secrets", f"{RELEASE}-{secret}", NAMESPACE)["data"].items():
        (directory / name).write_bytes(base64.b64decode(content))
    return directory


@contextmanager
def thief(directory):
    """A session with the operator's certificate."""
    credentials = files("bus-operator", directory)
    with open_visitor([f"tls/{ROUTER}:7447"], patience=120, credentials=credentials) as session:
        yield session


def refused(session, *reasons):
    """How many messages the agent has refused, for one of these reasons."""
    [reply] = [one.ok for one in session.get(agent_key("*"), timeout=120) if one.ok is not None]
    said = json.loads(reply.payload.to_bytes())["refused"]
    return sum(said.get(reason, 0) for reason in reasons)


def test_a_signed_plan_for_a_foreign_container_is_refused(governed, session, tmp_path):  # noqa: ARG001
    start(STRANGER, namespace=OTHER)
    uid, container = api.get("pods", STRANGER, OTHER)["metadata"]["uid"], container_id(STRANGER, OTHER)
    signer = Signer(files("signing", tmp_path / "signing"))
    [reply] = [one.ok for one in session.get(KEY, timeout=120) if one.ok is not None]
    plan = json.loads(reply.payload.to_bytes())
    mine = plan["targets"][0] | {"cores": 0.01, "quota": 0.01}
    stolen = mine | {"pod": STRANGER, "uid": uid, "containerId": container}
    payload = json.dumps(plan | {"sequence": plan["sequence"] + 1, "targets": [stolen]}).encode()
    with thief(tmp_path / "operator") as speaker:
        before = refused(speaker, "Foreign")
        speaker.put(KEY, payload, attachment=signer.sign(KEY, payload, time.time_ns()))
        until("it is refused", lambda: refused(speaker, "Foreign") == before + 1)
    assert limit(scope(STRANGER, OTHER)) == "50000 100000"
    api.delete("pods", STRANGER, OTHER)


def test_a_replayed_withdrawal_is_refused(sensors, session, tmp_path):
    withdrawn = []
    with (
        session.declare_subscriber(KEY, lambda sample: withdrawn.append(sample.attachment)),
        thief(tmp_path / "operator") as speaker,
    ):
        drive(sensors, 0.0)
        govern()
        agreed(**STANDING)
        withdrawn.clear()
        let_go()
        until("the withdrawal is captured", lambda: bool(withdrawn))
        captured = withdrawn[-1]
        govern()
        drive(sensors, 0.3)
        agreed(**MOVING)
        before = refused(speaker, "Repeated", "TooOld", "Outdated")
        speaker.delete(KEY, attachment=captured)
        until("it is refused", lambda: refused(speaker, "Repeated", "TooOld", "Outdated") > before)
        agreed(**MOVING)
    drive(sensors, 0.0)
    let_go()
