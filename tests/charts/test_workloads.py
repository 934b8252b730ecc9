"""The pods of a release: how each is configured, where it runs, when it is ready, and what can be added."""

from __future__ import annotations

import json
from typing import Any

import pytest

from contextpolicy.commands.operator_access import OPERATOR
from contextpolicy.planning.allocation.enforcement import PROTECTED_WEIGHT, fitted
from contextpolicy.policy.quantities import parse_cpu
from tests.charts.objects import WORKLOADS, container, environment


def test_operator_gets_its_image_and_environment(render):
    operator = render("image.tag=dev", "watchNamespaces={robot,lab}")["Deployment", "contextpolicy"]
    assert container(operator)["image"] == "contextpolicy:dev"
    assert environment(operator) == {
        "ZENOH_CONNECT": "tls/contextpolicy-router.contextpolicy-system:7447",
        "ZENOH_CREDENTIALS": "/etc/contextpolicy/bus",
        "WATCH_NAMESPACES": "robot,lab",
        "LEASE": "contextpolicy-system/contextpolicy",
        "LEASE_SECONDS": "60",
        "POD_NAME": None,
        "POD_UID": None,
        "IDENTITY": "$(POD_NAME)_$(POD_UID)",
        "LEASE_POD": "$(POD_NAME)/$(POD_UID)",
        "ORIGINALS_KEY": "contextpolicy-system/contextpolicy-originals",
        "HEALTH_PORT": "8080",
        "METRICS_PORT": "8081",
        "LIVE_PORT": "8082",
        "LOG_FORMAT": "text",
        "LOG_LEVEL": "INFO",
    }


def test_the_router_weighs_as_much_as_each_of_three_tasks_that_weigh_a_core_on_two_processors(render):
    rendered = render("agent.enabled=true")
    requests = {
        (name, one["name"]): parse_cpu(one["resources"]["requests"]["cpu"])
        for (kind, name), workload in rendered.items()
        if kind in ("Deployment", "DaemonSet")
        for one in workload["spec"]["template"]["spec"]["containers"]
    }
    robot = {"navigation": PROTECTED_WEIGHT, "imu": PROTECTED_WEIGHT, "slam": 1000}
    weights = fitted(robot, dict.fromkeys(robot, 10), 2000 - sum(requests.values()))
    assert requests["contextpolicy-router", "router"] >= max(weights.values())


def test_a_rollout_needs_no_room_for_another_operator(render):
    spec = render()["Deployment", "contextpolicy"]["spec"]
    assert (spec["replicas"], spec["strategy"]) == (1, {"type": "Recreate"})
    spec = render("operator.replicas=2")["Deployment", "contextpolicy"]["spec"]
    one_by_one = {"type": "RollingUpdate", "rollingUpdate": {"maxSurge": 0, "maxUnavailable": 1}}
    assert (spec["replicas"], spec["strategy"]) == (2, one_by_one)


def test_a_standby_notices_a_killed_operator_within_a_second(render):
    assert environment(render("operator.replicas=2")["Deployment", "contextpolicy"])["LEASE_SECONDS"] == "1"


def test_the_operator_knows_when_the_api_is_to_follow_an_agent(render):
    deployment = "Deployment", "contextpolicy"
    assert environment(render("agent.enabled=true", "agent.settleSeconds=5")[deployment])["SETTLE_SECONDS"] == "5"
    assert environment(render("agent.enabled=true")[deployment])["SETTLE_SECONDS"] == "30"
    assert "SETTLE_SECONDS" not in environment(render()[deployment])


def test_readiness_has_its_own_endpoint(render):
    operator = container(render()["Deployment", "contextpolicy"])
    pages = {probe: operator[f"{probe}Probe"]["httpGet"]["path"] for probe in ("startup", "liveness", "readiness")}
    assert pages == {"startup": "/healthz", "liveness": "/healthz", "readiness": "/readyz"}


@pytest.mark.parametrize("component", WORKLOADS)
@pytest.mark.parametrize("closed", ["true", "false"])
def test_each_pod_takes_extras(render, component, closed):
    """Beside what the component itself needs, which depends on whether the bus is closed."""
    opened = closed == "false" and component != "agent"
    bare = {"security.enabled=false"} if opened else {"agent.enabled=true"}
    extras = (
        *bare,
        f"{component}.extraEnv[0].name=RUST_LOG",
        f"{component}.extraEnv[0].value=debug",
        f"{component}.extraArgs={{--more}}",
        f"{component}.extraVolumes[0].name=data",
        f"{component}.extraVolumeMounts[0].name=data",
        f"{component}.extraVolumeMounts[0].mountPath=/data",
        f"{component}.podLabels.team=robots",
        "commonLabels.site=hall",
    )
    kind = WORKLOADS[component]
    template, before = (rendered[kind]["spec"]["template"] for rendered in (render(*extras), render(*bare)))
    (changed,), (own,) = template["spec"]["containers"], before["spec"]["containers"]
    assert changed["args"] == [*own["args"], "--more"]
    assert changed["env"] == [*own.get("env", []), {"name": "RUST_LOG", "value": "debug"}]
    assert changed["volumeMounts"] == [*own.get("volumeMounts", []), {"name": "data", "mountPath": "/data"}]
    assert template["spec"]["volumes"] == [*before["spec"].get("volumes", []), {"name": "data"}]
    assert template["metadata"]["labels"].items() >= {"team": "robots", "site": "hall"}.items()


def test_selectors_stay_when_labels_are_added(render):
    """A selector can't be changed, so an upgrade that adds labels would fail."""
    added = ("agent.enabled=true", "commonLabels.site=hall", "operator.podLabels.team=robots")
    labelled, plain = render(*added), render("agent.enabled=true")
    for workload in WORKLOADS.values():
        assert labelled[workload]["spec"]["selector"] == plain[workload]["spec"]["selector"]


def test_name_override_changes_names_and_labels(render):
    """In names and labels alike; by `part-of` the command line finds its pods all the same."""
    rendered = render("nameOverride=planner", "agent.enabled=true", "metrics.podMonitor.enabled=true")
    for kind, suffix in (("Deployment", ""), ("Deployment", "-router"), ("DaemonSet", "-agent")):
        workload = rendered[kind, f"contextpolicy-planner{suffix}"]["spec"]
        labels = workload["template"]["metadata"]["labels"]
        assert labels.items() >= workload["selector"]["matchLabels"].items()
        assert labels["app.kubernetes.io/name"] == "planner"
        assert labels["app.kubernetes.io/part-of"] == "contextpolicy"
    monitor = rendered["PodMonitor", "contextpolicy-planner"]["spec"]["selector"]["matchLabels"]
    assert monitor["app.kubernetes.io/name"] == "planner"
    assert render("nameOverride=policy")["Deployment", "contextpolicy"], "part of the release's name already"


def test_the_command_line_finds_the_operator_by_its_labels(render):
    wanted = dict(part.split("=") for part in OPERATOR.split(","))
    for settings in ((), ("nameOverride=planner", "fullnameOverride=planner")):
        [labels] = [
            item["spec"]["template"]["metadata"]["labels"]
            for (kind, name), item in render(*settings).items()
            if kind == "Deployment" and not name.endswith("-router")
        ]
        assert labels.items() >= wanted.items()


@pytest.mark.parametrize(
    ("settings", "account", "made"),
    [
        ((), "contextpolicy", True),
        (("serviceAccount.name=robots",), "robots", True),
        (("serviceAccount.name=robots", "serviceAccount.create=false"), "robots", False),
        (("serviceAccount.create=false",), "default", False),
    ],
)
def test_the_operators_account(render, settings, account, made):
    rendered = render(*settings, r"serviceAccount.annotations.example\.com/role=robots")
    assert rendered["Deployment", "contextpolicy"]["spec"]["template"]["spec"]["serviceAccountName"] == account
    assert rendered["ClusterRoleBinding", "contextpolicy"]["subjects"][0]["name"] == account
    assert (("ServiceAccount", account) in rendered) is made
    if made:
        assert rendered["ServiceAccount", account]["metadata"]["annotations"] == {"example.com/role": "robots"}


@pytest.mark.parametrize("component", WORKLOADS)
def test_each_pod_can_be_placed(render, component):
    zone = {"maxSkew": 1, "topologyKey": "zone", "whenUnsatisfiable": "DoNotSchedule"}
    chosen = {**zone, "labelSelector": {"matchLabels": {"app": "other"}}}
    affinity: dict[str, Any] = {"nodeAffinity": {"preferredDuringSchedulingIgnoredDuringExecution": []}}
    wanted = {
        "priorityClassName": "robots",
        "nodeSelector": {"arm": "yes"},
        "tolerations": [{"key": "robot", "operator": "Exists"}],
        "affinity": affinity,
    }
    settings = [f"{component}.{name}:={json.dumps(value)}" for name, value in wanted.items()]
    settings.append(f"{component}.topologySpreadConstraints:={json.dumps([zone, chosen])}")
    workload = render("agent.enabled=true", *settings)[WORKLOADS[component]]["spec"]
    pod = workload["template"]["spec"]
    assert {name: pod[name] for name in wanted} == wanted
    own = {"labelSelector": {"matchLabels": workload["selector"]["matchLabels"]}}
    assert pod["topologySpreadConstraints"] == [{**zone, **own}, chosen]


def test_replicas_are_spread_over_nodes_by_default(render):
    def spread(*settings):
        pod = render(*settings)["Deployment", "contextpolicy"]["spec"]["template"]["spec"]
        return [(one["topologyKey"], one["whenUnsatisfiable"]) for one in pod.get("topologySpreadConstraints", ())]

    zone = [{"maxSkew": 1, "topologyKey": "zone", "whenUnsatisfiable": "DoNotSchedule"}]
    assert spread() == []
    assert spread("operator.replicas=2") == [("kubernetes.io/hostname", "ScheduleAnyway")]
    own = f"operator.topologySpreadConstraints:={json.dumps(zone)}"
    assert spread("operator.replicas=2", own) == [("zone", "DoNotSchedule")]


def test_an_image_can_be_pinned(render):
    digest = f"sha256:{'a' * 64}"
    rendered = render("image.tag=1.0", f"image.digest={digest}", "agent.enabled=true")
    for workload in (*WORKLOADS.values(), ("Job", "contextpolicy-restore")):
        assert container(rendered[workload])["image"] == f"contextpolicy:1.0@{digest}"


def test_agent_update_strategy_is_configurable(render):
    spec = render("agent.enabled=true", "agent.updateStrategy.type=OnDelete")["DaemonSet", "contextpolicy-agent"][
        "spec"
    ]
    assert spec["updateStrategy"] == {"type": "OnDelete"}
