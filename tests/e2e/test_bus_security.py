"""A hostile pod in another namespace, at the bus of a release with agents: it gets nothing and changes nothing."""

import json
import re
import sys
import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from contextpolicy.bus.decision_bus import agent_key
from contextpolicy.bus.session import open_visitor
from tests.e2e.agents import NAMESPACE, Component, connect, endpoint, report
from tests.e2e.cluster import (
    PATIENCE,
    REPOSITORY,
    CommandError,
    apply,
    get,
    helm_command,
    run,
    secret_files,
    until,
)
from tests.e2e.metrics_page import scrape
from tests.e2e.robot import Robot, Sensors, pod
from timelines.demo.deploy import free_address

if TYPE_CHECKING:
    import zenoh

HOSTILE, STRANGER = "e2e-hostile", "stranger"
STANDING = {"slam": 500, "speech": 500}
ATTACK = """
import json, sys, zenoh
endpoint, key, plan = sys.argv[1:]
config = zenoh.Config()
settings = {
    "mode": "client",
    "connect/endpoints": [endpoint],
    "connect/timeout_ms": 3000,
    "scouting/multicast/enabled": False,
    "transport/link/tls/verify_name_on_connect": False,
}
for name, value in settings.items():
    config.insert_json5(name, json.dumps(value))
try:
    with zenoh.open(config) as session:
        heard = [str(reply.ok.key_expr) for reply in session.get("**", timeout=2) if reply.ok]
        for where in (key, "*/*/*/plan", "**"):
            session.put(where, plan)
        session.delete(key)
        print("let in, heard", heard)
except zenoh.ZError:
    print("not let in")
"""


@pytest.fixture(scope="module", autouse=True)
def installation(module):  # noqa: ARG001 - comes with it
    apply({"apiVersion": "v1", "kind": "Namespace", "metadata": {"name": HOSTILE}})
    apply(pod(STRANGER, HOSTILE, ["sleep", "infinity"], None))
    run("kubectl", "wait", f"pod/{STRANGER}", "-n", HOSTILE, "--for=condition=Ready", "--timeout=60s")
    yield
    run("kubectl", "delete", "namespace", HOSTILE, "--timeout=90s")


@pytest.fixture(scope="module")
def robot(module):
    with Sensors(module) as sensors:
        robot = Robot(NAMESPACE, sensors)
        robot.drive(0.0)
        robot.start("slam", "speech")
        robot.policy()
        robot.expect(**STANDING)
        yield robot
        run("kubectl", "delete", "ctxp", "--all", "-n", NAMESPACE, "--timeout=60s")
        robot.stop("slam", "speech")


def forged(session):
    """A perfect plan but for its signature: the next one, with nothing left for slam."""
    key = f"contextpolicy/{NAMESPACE}/robot/plan"
    plan = json.loads(next(iter(session.get(key, timeout=PATIENCE))).ok.payload.to_bytes())
    targets = [target | {"cores": 0.01} for target in plan["targets"]]
    return key, json.dumps(plan | {"sequence": plan["sequence"] + 1, "targets": targets})


@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_an_anonymous_plan_does_nothing(robot, module, protocol):
    """Neither on the agent's containers nor on what it reports of them."""
    refused = report(module)["refused"]
    address = endpoint().replace("tls/", f"{protocol}/")
    said = run("kubectl", "exec", "-n", HOSTILE, STRANGER, "--", "python3", "-c", ATTACK, address, *forged(module))
    assert said.strip() == "not let in"
    time.sleep(1)
    assert robot.limits("slam", "speech") == STANDING
    assert report(module)["refused"] == refused


@pytest.mark.parametrize("role", ["module", "sensor", "viewer", "agent"])
def test_a_plan_of_another_role_does_nothing(robot, module, role):
    """Somebody took over a pod of the robot, its certificate included."""
    key, plan = forged(module)
    with connect(role) as session:
        for where in (key, "*/*/*/plan", "**"):
            session.put(where, plan)
        session.delete(key)
        time.sleep(1)
    assert robot.limits("slam", "speech") == STANDING


def repetitions(module):
    """How many messages the agent has refused as heard before, or on a slow machine as signed too long ago."""
    return sum(report(module)["refused"].get(reason, 0) for reason in ("Repeated", "TooOld"))


def test_replayed_plans_move_nothing(robot, module, faults):
    """By somebody who has the operator's certificate, but not the key of the plans."""
    key = f"contextpolicy/{NAMESPACE}/robot/plan"
    captured: list[zenoh.Sample] = []
    with faults("signed plans captured, and said again", "the agent refuses them all, nothing moves") as seen:
        with connect("operator") as thief:
            with module.declare_subscriber(key, captured.append):
                robot.drive(0.3)
                robot.expect(slam=990, speech=10)
                robot.drive(0.0)
                robot.expect(**STANDING)
                until("both plans are captured", lambda: len(captured) > 1)
            before = repetitions(module)
            for sample in captured:
                thief.put(key, sample.payload, attachment=sample.attachment)
            until("all are refused", lambda: repetitions(module) == before + len(captured))
        assert robot.limits("slam", "speech") == STANDING
        seen.back()
        robot.drive(0.3)
        robot.expect(slam=990, speech=10)
    robot.drive(0.0)
    robot.expect(**STANDING)


def answering(key, payload):
    """What gives each query the same answer."""
    return lambda query: query.reply(key, payload)


def test_thousands_of_forged_nodes_do_not_restart_the_operator(robot, module, faults):  # noqa: ARG001 - in force
    """Somebody has an agent's certificate: tokens and long reports of nodes that the cluster does not have."""
    operator, flood = Component("operator"), b"x" * 200_000
    restarts = operator.restarts()
    with faults("3000 invented agents with reports of 200 kB", "the operator asks none of them") as seen:
        with connect("agent") as thief, ExitStack() as declared:
            for number in range(3000):
                ghost = agent_key(f"ghost-{number}")
                declared.callback(thief.declare_queryable(ghost, answering(ghost, flood)).undeclare)
                declared.callback(thief.liveliness().declare_token(ghost).undeclare)
            robot.drive(0.3)
            robot.expect(slam=990, speech=10)
            seen.back()
            robot.drive(0.0)
            robot.expect(**STANDING)
        assert operator.restarts() == restarts


def test_foreign_pod_cannot_read_secrets(installation):  # noqa: ARG001 - its pod has the default account
    for secret in ("bus-authority", "bus-operator", "signing"):
        with pytest.raises(CommandError, match="forbidden"):
            run(
                *("kubectl", "get", "secret", f"e2e-agent-{secret}", "-n", "e2e-agent-system"),
                *("--as", f"system:serviceaccount:{HOSTILE}:default"),
            )


def test_a_renewed_certificate_needs_no_restart(robot, module):
    """The router listens again; a plan made afterwards is in force, and nothing was started again."""
    lasting = "app.kubernetes.io/component in (operator, router, agent)"
    pods = (
        "kubectl",
        "get",
        "pods",
        "-n",
        "e2e-agent-system",
        "-l",
        lasting,
        "-o",
        "jsonpath={.items[*].metadata.uid}",
    )
    before, listened = run(*pods), _listened()
    where = ("-n", "e2e-agent-system")
    run("kubectl", "patch", "secret", "e2e-agent-bus-router", *where, "--type=merge", "-p", '{"data":{"tls.crt":""}}')
    run("kubectl", "create", "job", "renewal", "--from=cronjob/e2e-agent-certificates", *where)
    run("kubectl", "wait", "job/renewal", *where, "--for=condition=Complete", "--timeout=60s")
    until("the router listens again", lambda: _listened() > listened, patience=180)
    until("clients are back", lambda: bool(list(module.info.routers_zid())))
    robot.drive(0.3)
    robot.expect(slam=990, speech=10)
    assert run(*pods) == before


def _listened():
    """How often the router has begun to listen."""
    return run("kubectl", "logs", "deployment/e2e-agent-router", "-n", "e2e-agent-system").count("routing at")


# a release with nothing but defaults

DEFAULT = "e2e-closed"


@pytest.fixture(scope="module")
def closed():
    """The chart as the quick start installs it, beside the other releases; where its router listens."""
    values = {
        "fullnameOverride": DEFAULT,
        "image.tag": "dev",
        "crds.enabled": "false",
        "watchNamespaces": f"{{{HOSTILE}}}",
        "router.service.clusterIP": free_address(55),
        "security.namespaces": f"{{{HOSTILE}}}",
    }
    run(*helm_command(DEFAULT, f"{DEFAULT}-system", values), timeout=150)
    yield f"tls/{free_address(55)}:7447"
    run("helm", "uninstall", DEFAULT, "--namespace", f"{DEFAULT}-system", "--wait", "--timeout", "60s")
    assert not run("kubectl", "get", "secrets", "-n", HOSTILE, "-o", "name").strip()
    run("kubectl", "delete", "namespace", f"{DEFAULT}-system", "--timeout=90s")


def test_sensor_connects_with_fetched_credentials(closed, tmp_path):
    where = tmp_path / "sensor"
    run(sys.executable, "-m", "contextpolicy", "credentials", "sensor", str(where), "-n", f"{DEFAULT}-system")
    with open_visitor([closed], patience=20, credentials=where) as sensor:
        assert list(sensor.info.routers_zid())


def test_operator_and_router_export_certificate_expiry(closed):  # noqa: ARG001 - installed
    for component in ("operator", "router"):
        series = rf'^contextpolicy_certificate_expiry_timestamp_seconds\{{component="{component}"\}} (\S+)$'
        [end] = re.findall(series, scrape(component, DEFAULT, f"{DEFAULT}-system"), flags=re.MULTILINE)
        assert float(end) > time.time()


def test_the_robots_namespace_has_the_same_certificate(closed, tmp_path):
    where = secret_files(f"{DEFAULT}-bus-module", HOSTILE, tmp_path / "module")
    with open_visitor([closed], patience=20, credentials=where) as module:
        assert list(module.info.routers_zid())


def test_upgrade_and_renewal_keep_valid_certificates(closed):  # noqa: ARG001 - installed
    system = f"{DEFAULT}-system"
    before = get("secret", f"{DEFAULT}-bus-operator", system)["data"]
    chart = str(REPOSITORY / "charts" / "contextpolicy")
    run("helm", "upgrade", DEFAULT, chart, "-n", system, "--reuse-values", "--set", "commonLabels.site=hall", "--wait")
    run("kubectl", "create", "job", "renewal", f"--from=cronjob/{DEFAULT}-certificates", "-n", system)
    run("kubectl", "wait", "job/renewal", "-n", system, "--for=condition=Complete", "--timeout=60s")
    assert get("secret", f"{DEFAULT}-bus-operator", system)["data"] == before


def test_certificate_job_can_access_only_its_own_secrets(closed):  # noqa: ARG001 - installed
    system = f"{DEFAULT}-system"
    account = ("--as", f"system:serviceaccount:{system}:{DEFAULT}-certificates", "-n", system)
    for right in (("create", "secrets"), ("list", "secrets"), ("get", "secret/other"), ("delete", "secrets")):
        with pytest.raises(CommandError):
            run("kubectl", "auth", "can-i", *right, *account)
    run("kubectl", "auth", "can-i", "patch", f"secret/{DEFAULT}-bus-operator", *account)
