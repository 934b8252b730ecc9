"""The bus of a release with agents: who gets which Secret, and what is in it."""

from __future__ import annotations

from contextlib import nullcontext
from unittest.mock import MagicMock

import pytest
import yaml

from contextpolicy import cli
from contextpolicy.commands import certificates
from tests.charts.conftest import CHART, set_all
from tests.charts.objects import WORKLOADS, container, environment
from tests.charts.test_uninstall import notes


@pytest.fixture(scope="module")
def secured(render):
    return render("agent.enabled=true", "security.routerNames={robot.local,10.0.0.9}")


def volumes(workload):
    """The Secrets that its container sees."""
    mounted = {mount["name"] for mount in container(workload).get("volumeMounts", ())}
    found = workload["spec"]["template"]["spec"].get("volumes", [])
    return {volume["name"]: volume["secret"] for volume in found if "secret" in volume and volume["name"] in mounted}


def made(name, *files):
    """The volume's Secret, once these files are in it."""
    return {"secretName": name, "items": [{"key": file, "path": file} for file in files]}


def job_of(rendered):
    """What makes the certificates at the installation."""
    [job] = [item for (kind, name), item in rendered.items() if kind == "Job" and "-certificates-" in name]
    return job


BUS = ("ca.crt", "tls.crt", "tls.key")
ORIGINALS = ("Secret", "contextpolicy-originals")
"""The operator fills it itself, whether the bus is closed or not."""


def secrets_of_the_bus(rendered):
    """What the Job fills."""
    return {key for key in rendered if key[0] == "Secret"} - {ORIGINALS}


def test_bus_is_closed_by_default(render):
    rendered = render()
    assert environment(rendered["Deployment", "contextpolicy"])["ZENOH_CONNECT"].startswith("tls/")
    assert volumes(rendered["Deployment", "contextpolicy"]) == {"bus": made("contextpolicy-bus-operator", *BUS)}
    assert ("Secret", "contextpolicy-signing") not in rendered, "without agents nothing is signed"


def test_a_bus_that_is_open_has_no_certificates(helm, render):
    rendered = render("security.enabled=false")
    assert secrets_of_the_bus(rendered) == set()
    assert not [key for key in rendered if key[0] == "CronJob" or key[1].startswith("contextpolicy-certif")]
    assert "--listen=tcp/*:7447" in container(rendered["Deployment", "contextpolicy-router"])["args"]
    assert not volumes(rendered["Deployment", "contextpolicy"])
    assert "WARNING: security.enabled=false. The bus is open" in notes(helm, "security.enabled=false")


def test_the_notes_say_how_a_sensor_gets_its_certificate(helm):
    assert "kubectl ctxp credentials sensor ./sensor -n default" in notes(helm)
    assert "WARNING" not in notes(helm)


@pytest.mark.parametrize("role", WORKLOADS)
def test_each_part_has_the_secret_of_its_role(secured, role):
    workload = secured[WORKLOADS[role]]
    assert volumes(workload)["bus"] == made(f"contextpolicy-bus-{role}", *BUS)
    assert environment(workload)["ZENOH_CREDENTIALS"] == "/etc/contextpolicy/bus"


def test_only_the_operator_can_sign(secured):
    signing = {role: volumes(secured[workload]).get("signing") for role, workload in WORKLOADS.items()}
    assert signing == {
        "operator": made("contextpolicy-signing", "tls.crt", "tls.key"),
        "agent": made("contextpolicy-signing", "tls.crt"),
        "router": None,
    }


def test_no_workload_mounts_the_authority_key(secured):
    assert "bus-authority" not in str([secured[workload] for workload in WORKLOADS.values()])


def test_no_template_makes_a_key(secured):
    """It would be another one with every sync of a GitOps tool."""
    secrets = [item for (kind, _), item in secured.items() if kind == "Secret"]
    assert len(secrets) == 9
    assert [item for item in secrets if item.keys() & {"data", "stringData"}] == []


def test_rendering_is_deterministic(render):
    settings = ("agent.enabled=true", "security.namespaces={robot}")
    assert render(*settings) == render(*settings)


def test_certificates_are_made_by_a_job_and_renewed_by_a_cronjob(secured):
    job, schedule = job_of(secured), secured["CronJob", "contextpolicy-certificates"]
    assert container(job)["args"] == [
        "certificates",
        "--release=contextpolicy-system/contextpolicy",
        *(f"--router-name=contextpolicy-router{end}" for end in ENDS),
        *(f"--router-name={name}" for name in ("localhost", "127.0.0.1", "::1", "robot.local", "10.0.0.9")),
    ]
    assert schedule["spec"]["jobTemplate"]["spec"]["template"] == job["spec"]["template"]
    assert job["spec"]["template"]["spec"]["serviceAccountName"] == "contextpolicy-certificates"
    assert "annotations" not in job["metadata"], "no hook: see the template"
    assert schedule["spec"]["concurrencyPolicy"] == "Replace", "a pod that never starts would prevent all further runs"


ENDS = ("", *(f".contextpolicy-system{end}" for end in ("", ".svc", ".svc.cluster.local")))


@pytest.mark.parametrize("setting", ["security.routerNames={robot}", "image.tag=dev", "security.namespaces={lab}"])
def test_job_name_changes_with_its_settings(render, setting):
    assert job_of(render(setting))["metadata"]["name"] != job_of(render())["metadata"]["name"]


def test_the_command_fills_existing_secrets(secured, monkeypatch):
    renew = MagicMock(return_value=True)
    monkeypatch.setattr(certificates, "api_server", lambda _: nullcontext(None))
    monkeypatch.setattr(certificates, "renew", renew)
    assert cli.main(container(job_of(secured))["args"]) == 0
    release = renew.call_args.args[1]
    assert {("Secret", place.name) for place in release.places()} == secrets_of_the_bus(secured)


def test_shared_namespaces_get_secrets_and_a_role(helm):
    settings = set_all(["agent.enabled=true", "security.namespaces={robot,contextpolicy-system}"])
    where = ("contextpolicy", str(CHART), "-n", "contextpolicy-system")
    done = helm("template", *where, *settings)
    documents = [one for one in yaml.safe_load_all(done.stdout) if one]
    own = [one for one in documents if one["metadata"].get("namespace") == "robot"]
    assert [(one["kind"], one["metadata"]["name"]) for one in own if one["kind"] == "Secret"] == [
        ("Secret", "contextpolicy-bus-sensor"),
        ("Secret", "contextpolicy-bus-module"),
    ]
    [role] = [one for one in own if one["kind"] == "Role"]
    assert role["rules"][0]["resourceNames"] == ["contextpolicy-bus-sensor", "contextpolicy-bus-module"]
    [job] = [one for one in documents if one["kind"] == "Job" and "-certificates-" in one["metadata"]["name"]]
    assert container(job)["args"][-2:] == ["--share=robot", "--share=contextpolicy-system"]


def test_existing_secrets_are_used(render):
    mine = [f"security.{role}Secret=my-{role}" for role in (*WORKLOADS, "signing")]
    rendered = render("agent.enabled=true", *mine)
    assert secrets_of_the_bus(rendered) == set()
    for role, workload in WORKLOADS.items():
        assert volumes(rendered[workload])["bus"] == {"secretName": f"my-{role}"}
    assert volumes(rendered["Deployment", "contextpolicy"])["signing"] == made("my-signing", "tls.crt", "tls.key")
    assert not [key for key in rendered if key[0] == "CronJob"]


def test_plans_are_signed_on_another_router_too(render):
    rendered = render(
        "agent.enabled=true",
        "router.enabled=false",
        "zenoh.connect={tls/a:7447}",
        "security.operatorSecret=mine",
    )
    assert volumes(rendered["Deployment", "contextpolicy"]).keys() == {"bus", "signing"}
    assert volumes(rendered["DaemonSet", "contextpolicy-agent"]).keys() == {"signing"}
    assert container(job_of(rendered))["args"][2:] == ["--no-bus"]


def test_router_restricts_publishers_to_sample_keys(render):
    rendered = render("security.enabled=true", "security.sampleKeys={robot/**,lab/*/imu}")
    assert "--samples=robot/**,lab/*/imu" in container(rendered["Deployment", "contextpolicy-router"])["args"]


FLEET = ("security.enabled=true", "security.routerSecret=fleet", "security.operatorSecret=own")


def test_a_router_joins_its_fleet(render):
    rendered = render(*FLEET, "router.uplink={tls/a:7447,quic/b:7448}", "networkPolicy.enabled=true")
    assert container(rendered["Deployment", "contextpolicy-router"])["args"][-1] == "--uplink=tls/a:7447,quic/b:7448"
    _, up = rendered["NetworkPolicy", "contextpolicy-router"]["spec"]["egress"]
    assert up["ports"] == [{"port": 7447, "protocol": "TCP"}, {"port": 7448, "protocol": "UDP"}]


def test_a_router_without_a_fleet_opens_no_connection(render):
    rendered = render("networkPolicy.enabled=true")
    assert rendered["NetworkPolicy", "contextpolicy-router"]["spec"]["egress"] == []


def test_pod_user_and_selinux_labels_are_configurable(render):
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


def test_agent_is_probed_and_scraped(render):
    rendered = render("agent.enabled=true", "metrics.podMonitor.enabled=true")
    agent = container(rendered[WORKLOADS["agent"]])
    for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
        assert agent[probe]["httpGet"] == {"path": "/healthz", "port": "metrics"}
    assert agent["ports"] == [{"name": "metrics", "containerPort": 8081}]
    [choice] = rendered["PodMonitor", "contextpolicy"]["spec"]["selector"]["matchExpressions"]
    service = rendered["Service", "contextpolicy-agent-metrics"]
    assert service["metadata"]["labels"]["app.kubernetes.io/component"] in choice["values"]
    assert service["spec"]["clusterIP"] == "None"
