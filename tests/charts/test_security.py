"""The bus of a release with agents: who gets which Secret, and what is in it."""

from __future__ import annotations

import base64
from contextlib import ExitStack

import pytest
from cryptography import x509

from contextpolicy.bus.session import open_router
from contextpolicy.bus.signatures import Signer, Verifier
from tests.bus.certificates import ROLES
from tests.bus.client import client_of
from tests.charts.test_chart import WORKLOADS, container, environment
from tests.ports import free_port

NOW = 1_800_000_000_000_000_000


@pytest.fixture(scope="module")
def secured(render):
    return render("agent.enabled=true", "security.routerNames={robot.local,10.0.0.9}")


@pytest.fixture
def files(secured, tmp_path):
    """A Secret as a directory, as kubelets mount it."""

    def directory(name):
        (tmp_path / name).mkdir()
        for file, content in secured["Secret", name]["data"].items():
            (tmp_path / name / file).write_bytes(base64.b64decode(content))
        return tmp_path / name

    return directory


def volumes(workload):
    """The Secrets that its container sees."""
    mounted = {mount["name"] for mount in container(workload).get("volumeMounts", ())}
    found = workload["spec"]["template"]["spec"].get("volumes", [])
    return {volume["name"]: volume["secret"] for volume in found if "secret" in volume and volume["name"] in mounted}


def test_without_agents_the_bus_is_open_and_there_is_no_secret(render):
    rendered = render()
    assert not [key for key in rendered if key[0] == "Secret"]
    assert container(rendered["Deployment", "contextpolicy-router"])["args"] == [
        "router",
        "--metrics-port=8081",
        "--listen=tcp/*:7447",
    ]
    assert not volumes(rendered["Deployment", "contextpolicy"])


def test_without_agents_the_bus_can_be_closed_as_well(render):
    rendered = render("security.enabled=true")
    assert environment(rendered["Deployment", "contextpolicy"])["ZENOH_CONNECT"].startswith("tls/")
    assert volumes(rendered["Deployment", "contextpolicy"]) == {"bus": {"secretName": "contextpolicy-bus-operator"}}
    assert ("Secret", "contextpolicy-signing") not in rendered


@pytest.mark.parametrize("role", WORKLOADS)
def test_each_part_has_the_secret_of_its_role(secured, role):
    workload = secured[WORKLOADS[role]]
    assert volumes(workload)["bus"] == {"secretName": f"contextpolicy-bus-{role}"}
    assert environment(workload)["ZENOH_CREDENTIALS"] == "/etc/contextpolicy/bus"


def test_only_the_operator_can_sign(secured):
    signing = {role: volumes(secured[workload]).get("signing") for role, workload in WORKLOADS.items()}
    name = {"secretName": "contextpolicy-signing"}
    assert signing == {
        "operator": name,
        "agent": {**name, "items": [{"key": "tls.crt", "path": "tls.crt"}]},
        "router": None,
    }


def test_nobody_mounts_what_signs_certificates(secured):
    assert "bus-authority" not in str([secured[workload] for workload in WORKLOADS.values()])


def test_the_routers_certificate_has_all_its_names(secured):
    pem = base64.b64decode(secured["Secret", "contextpolicy-bus-router"]["data"]["tls.crt"])
    names = x509.load_pem_x509_certificate(pem).extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert {"localhost", "robot.local", "contextpolicy-router.contextpolicy-system"} <= set(
        names.get_values_for_type(x509.DNSName)
    )
    assert {str(one) for one in names.get_values_for_type(x509.IPAddress)} == {"127.0.0.1", "10.0.0.9"}


def test_the_secrets_open_the_bus_to_every_role(files):
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with open_router([endpoint], files("contextpolicy-bus-router")), ExitStack() as sessions:
        for role in ROLES:
            credentials = files(f"contextpolicy-bus-{role}")
            session = sessions.enter_context(client_of(endpoint, credentials))
            assert list(session.info.routers_zid())


def test_agents_can_check_what_the_operator_signs(files):
    keys = files("contextpolicy-signing")
    assert Verifier(keys).check("key", b"plan", Signer(keys).sign("key", b"plan", NOW), NOW) == NOW


def test_robots_namespaces_get_what_their_pods_need(helm):
    from tests.charts.conftest import CHART, set_all  # noqa: PLC0415 - several objects of one name

    settings = set_all(["agent.enabled=true", "security.namespaces={robot}"])
    done = helm("template", "contextpolicy", str(CHART), *settings, "-s", "templates/bus-secrets.yaml")
    places = [line.strip() for line in done.stdout.splitlines() if line.startswith("  namespace: robot")]
    assert len(places) == 2


def test_secrets_that_exist_are_used_and_none_is_made(render):
    mine = [f"security.{role}Secret=my-{role}" for role in (*WORKLOADS, "signing")]
    rendered = render("agent.enabled=true", *mine)
    assert not [key for key in rendered if key[0] == "Secret"]
    for role, workload in WORKLOADS.items():
        assert volumes(rendered[workload])["bus"] == {"secretName": f"my-{role}"}
    assert volumes(rendered["Deployment", "contextpolicy"])["signing"] == {"secretName": "my-signing"}


def test_plans_are_signed_on_another_router_too(render):
    rendered = render(
        "agent.enabled=true",
        "router.enabled=false",
        "zenoh.connect={tls/a:7447}",
        "security.operatorSecret=mine",
    )
    assert volumes(rendered["Deployment", "contextpolicy"]).keys() == {"bus", "signing"}
    assert volumes(rendered["DaemonSet", "contextpolicy-agent"]).keys() == {"signing"}


def test_the_router_holds_publishers_to_their_keys(render):
    rendered = render("security.enabled=true", "security.sampleKeys={robot/**,lab/*/imu}")
    assert container(rendered["Deployment", "contextpolicy-router"])["args"][-1] == "--samples=robot/**,lab/*/imu"


FLEET = ("security.enabled=true", "security.routerSecret=fleet", "security.operatorSecret=own")


def test_a_router_joins_its_fleet(render):
    rendered = render(*FLEET, "router.uplink={tls/a:7447,quic/b:7448}", "networkPolicy.enabled=true")
    assert container(rendered["Deployment", "contextpolicy-router"])["args"][-1] == "--uplink=tls/a:7447,quic/b:7448"
    _, up = rendered["NetworkPolicy", "contextpolicy-router"]["spec"]["egress"]
    assert up["ports"] == [{"port": 7447, "protocol": "TCP"}, {"port": 7448, "protocol": "UDP"}]


def test_a_router_without_a_fleet_opens_no_connection(render):
    rendered = render("networkPolicy.enabled=true")
    assert rendered["NetworkPolicy", "contextpolicy-router"]["spec"]["egress"] == []


def test_no_secret_is_an_argument_or_in_the_environment(secured):
    for workload in WORKLOADS.values():
        told = str((container(secured[workload])["args"], environment(secured[workload])))
        for (kind, _), secret in secured.items():
            for content in secret["data"].values() if kind == "Secret" else ():
                assert content not in told
                assert base64.b64decode(content).decode() not in told


def test_a_cluster_may_choose_users_and_labels(render):
    rendered = render(
        "agent.enabled=true",
        *("podSecurity.runAsUser=null", "podSecurity.runAsGroup=null", "podSecurity.seLinuxOptions.level=s0:c1"),
        "agent.seLinuxOptions.type=spc_t",
    )
    for workload in (WORKLOADS["operator"], WORKLOADS["router"], ("Job", "contextpolicy-restore")):
        context = rendered[workload]["spec"]["template"]["spec"]["securityContext"]
        assert not context.keys() & {"runAsUser", "runAsGroup"}
        assert (context["runAsNonRoot"], context["seLinuxOptions"]) == (True, {"level": "s0:c1"})
    agent = rendered[WORKLOADS["agent"]]["spec"]["template"]["spec"]["securityContext"]
    assert agent["seLinuxOptions"] == {"type": "spc_t"}


def test_the_agent_is_asked_whether_it_lives_and_scraped(render):
    rendered = render("agent.enabled=true", "metrics.podMonitor.enabled=true")
    agent = container(rendered[WORKLOADS["agent"]])
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert agent[probe]["httpGet"] == {"path": "/healthz", "port": "metrics"}
    assert agent["ports"] == [{"name": "metrics", "containerPort": 8081}]
    [choice] = rendered["PodMonitor", "contextpolicy"]["spec"]["selector"]["matchExpressions"]
    service = rendered["Service", "contextpolicy-agent-metrics"]
    assert service["metadata"]["labels"]["app.kubernetes.io/component"] in choice["values"]
    assert service["spec"]["clusterIP"] == "None"
