"""The chart: what it renders under which values, and what it refuses."""

from __future__ import annotations

import pytest

from tests.bus.certificates import ROLES
from tests.charts.conftest import CHART, set_all
from tests.crds.schema import definition

EVERYTHING = (
    "agent.enabled=true",
    "agent.realtime=true",
    "networkPolicy.enabled=true",
    "metrics.podMonitor.enabled=true",
    "metrics.alerts.enabled=true",
    "metrics.dashboard.enabled=true",
    "imagePullSecrets[0].name=secret",
    "commonLabels.robot=one",
    "router.hostPort=7447",
)
DEFAULTS = {
    ("Role", "contextpolicy-lease"),
    ("RoleBinding", "contextpolicy-lease"),
    ("ClusterRole", "contextpolicy"),
    ("ClusterRole", "contextpolicy-editor"),
    ("ClusterRole", "contextpolicy-viewer"),
    ("ClusterRoleBinding", "contextpolicy"),
    ("CustomResourceDefinition", "contextpolicies.contextpolicy.dev"),
    ("Deployment", "contextpolicy"),
    ("Deployment", "contextpolicy-router"),
    ("Service", "contextpolicy-metrics"),
    ("Service", "contextpolicy-router"),
    ("Role", "contextpolicy-live"),
    ("ServiceAccount", "contextpolicy"),
    ("ClusterRole", "contextpolicy-restore"),
    ("ClusterRoleBinding", "contextpolicy-restore"),
    ("Job", "contextpolicy-restore"),
    ("ServiceAccount", "contextpolicy-restore"),
    ("ClusterRole", "contextpolicy-doctor"),
    ("ClusterRoleBinding", "contextpolicy-doctor"),
    ("Pod", "contextpolicy-doctor"),
    ("ServiceAccount", "contextpolicy-doctor"),
}


def container(workload):
    (only,) = workload["spec"]["template"]["spec"]["containers"]
    return only


def environment(workload):
    return {entry["name"]: entry.get("value") for entry in container(workload)["env"]}


@pytest.mark.parametrize("settings", [(), EVERYTHING], ids=["defaults", "everything"])
def test_it_lints(helm, settings):
    done = helm("lint", "--strict", str(CHART), *set_all(settings))
    assert done.returncode == 0, done.stdout


def test_it_renders_exactly_these_objects(render):
    assert render().keys() == DEFAULTS


def test_everything_at_once_renders(render):
    added = render(*EVERYTHING).keys() - DEFAULTS
    assert added == {
        ("DaemonSet", "contextpolicy-agent"),
        *(("Secret", f"contextpolicy-bus-{role}") for role in ("authority", "router", *ROLES)),
        ("Secret", "contextpolicy-signing"),
        ("Service", "contextpolicy-agent-metrics"),
        ("NetworkPolicy", "contextpolicy"),
        ("NetworkPolicy", "contextpolicy-doctor"),
        ("NetworkPolicy", "contextpolicy-restore"),
        ("NetworkPolicy", "contextpolicy-router"),
        ("ServiceAccount", "contextpolicy-agent"),
        ("PodMonitor", "contextpolicy"),
        ("PrometheusRule", "contextpolicy"),
        ("ConfigMap", "contextpolicy-dashboard"),
    }


def test_every_object_is_labelled(render):
    for rendered in render(*EVERYTHING).values():
        labels = rendered["metadata"]["labels"]
        assert labels["app.kubernetes.io/name"] == "contextpolicy"
        assert labels["robot"] == "one"


def test_the_definition_is_the_canonical_one(render):
    rendered = render()["CustomResourceDefinition", "contextpolicies.contextpolicy.dev"]
    assert rendered["spec"] == definition()["spec"]
    assert rendered["metadata"]["annotations"] == {"helm.sh/resource-policy": "keep"}


def test_the_definition_goes_with_the_release_if_told(render):
    rendered = render("crds.keep=false")["CustomResourceDefinition", "contextpolicies.contextpolicy.dev"]
    assert "annotations" not in rendered["metadata"]
    assert ("CustomResourceDefinition", "contextpolicies.contextpolicy.dev") not in render("crds.enabled=false")


def test_the_operator_is_told_all_it_needs(render):
    operator = render("image.tag=dev", "watchNamespaces={robot,lab}")["Deployment", "contextpolicy"]
    assert container(operator)["image"] == "contextpolicy:dev"
    assert environment(operator) == {
        "ZENOH_CONNECT": "tcp/contextpolicy-router.contextpolicy-system:7447",
        "WATCH_NAMESPACES": "robot,lab",
        "LEASE": "contextpolicy-system/contextpolicy",
        "LEASE_SECONDS": "15",
        "POD_NAME": None,
        "POD_UID": None,
        "IDENTITY": "$(POD_NAME)_$(POD_UID)",
        "LEASE_POD": "$(POD_NAME)/$(POD_UID)",
        "HEALTH_PORT": "8080",
        "METRICS_PORT": "8081",
        "LIVE_PORT": "8082",
        "LOG_FORMAT": "text",
        "LOG_LEVEL": "INFO",
    }


def test_a_rollout_needs_no_room_for_another_operator(render):
    spec = render()["Deployment", "contextpolicy"]["spec"]
    assert (spec["replicas"], spec["strategy"]) == (1, {"type": "Recreate"})
    spec = render("operator.replicas=2")["Deployment", "contextpolicy"]["spec"]
    one_by_one = {"type": "RollingUpdate", "rollingUpdate": {"maxSurge": 0, "maxUnavailable": 1}}
    assert (spec["replicas"], spec["strategy"]) == (2, one_by_one)


def test_a_standby_notices_a_killed_operator_within_a_second(render):
    assert environment(render("operator.replicas=2")["Deployment", "contextpolicy"])["LEASE_SECONDS"] == "1"


def test_ready_means_more_than_alive(render):
    operator = container(render()["Deployment", "contextpolicy"])
    pages = {probe: operator[f"{probe}Probe"]["httpGet"]["path"] for probe in ("startup", "liveness", "readiness")}
    assert pages == {"startup": "/healthz", "liveness": "/healthz", "readiness": "/readyz"}


def test_metrics_of_an_operator_without_a_router_can_be_read(render):
    assert render()["Service", "contextpolicy-metrics"]["spec"]["publishNotReadyAddresses"] is True


@pytest.mark.parametrize(
    ("settings", "endpoints"),
    [
        (("router.service.clusterIP=10.96.7.47",), "tls/10.96.7.47:7447"),
        (("router.service.clusterIP=fd00::47",), "tls/[fd00::47]:7447"),
        (("router.port=7400",), "tls/contextpolicy-router.contextpolicy-system:7400"),
        (("router.enabled=false", "zenoh.connect={tcp/a:7447,tcp/b:7447}"), "tcp/a:7447,tcp/b:7447"),
    ],
)
def test_operator_and_agent_connect_to_the_same_router(render, settings, endpoints):
    rendered = render("agent.enabled=true", *settings)
    for workload in (("Deployment", "contextpolicy"), ("DaemonSet", "contextpolicy-agent")):
        assert environment(rendered[workload])["ZENOH_CONNECT"] == endpoints


def test_another_router_takes_the_place_of_the_charts(render):
    rendered = render("router.enabled=false", "zenoh.connect={tcp/a:7447}")
    assert not [name for _, name in rendered if name.endswith("-router")]


def test_drivers_outside_reach_the_router(render):
    rendered = render("router.hostPort=7447", "router.service.type=NodePort", "router.service.nodePort=30747")
    assert container(rendered["Deployment", "contextpolicy-router"])["ports"][0]["hostPort"] == 7447
    assert rendered["Service", "contextpolicy-router"]["spec"]["ports"][0]["nodePort"] == 30747


def test_network_policies_let_k3s_reach_its_api(render):
    ports = [
        port["port"]
        for rule in render(*EVERYTHING)["NetworkPolicy", "contextpolicy"]["spec"]["egress"]
        for port in rule["ports"]
    ]
    assert {53, 443, 6443, 7447} <= set(ports)


def test_network_policies_let_the_operator_reach_another_router(render):
    rendered = render("networkPolicy.enabled=true", "router.enabled=false", "zenoh.connect={quic/robot.local:7500?a=b}")
    *_, last = rendered["NetworkPolicy", "contextpolicy"]["spec"]["egress"]
    assert last["ports"] == [{"port": 7500, "protocol": "UDP"}]


def test_who_lists_the_routers_clients_does_not_lock_our_own_out(render):
    settings = ("networkPolicy.enabled=true", "networkPolicy.routerFrom[0].podSelector.matchLabels.app=camera")
    rule, _metrics = render(*settings)["NetworkPolicy", "contextpolicy-router"]["spec"]["ingress"]
    clients = [peer["podSelector"]["matchLabels"] for peer in rule["from"]]
    assert clients[0] == {"app": "camera"}
    assert [labels["app.kubernetes.io/component"] for labels in clients[1:]] == ["operator", "agent"]


WORKLOADS = {
    "operator": ("Deployment", "contextpolicy"),
    "router": ("Deployment", "contextpolicy-router"),
    "agent": ("DaemonSet", "contextpolicy-agent"),
}


@pytest.mark.parametrize("component", WORKLOADS)
@pytest.mark.parametrize("closed", ["true", "null"])
def test_each_pod_takes_extras(render, component, closed):
    """Beside what the component itself needs, which depends on whether the bus is closed."""
    bare = {"agent.enabled=true", "security.enabled=true"} if closed == "true" or component == "agent" else set()
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


def test_an_image_can_be_pinned(render):
    digest = f"sha256:{'a' * 64}"
    rendered = render("image.tag=1.0", f"image.digest={digest}", "agent.enabled=true")
    for workload in (*WORKLOADS.values(), ("Job", "contextpolicy-restore")):
        assert container(rendered[workload])["image"] == f"contextpolicy:1.0@{digest}"


def test_agents_can_wait_for_the_robot_to_be_parked(render):
    spec = render("agent.enabled=true", "agent.updateStrategy.type=OnDelete")["DaemonSet", "contextpolicy-agent"][
        "spec"
    ]
    assert spec["updateStrategy"] == {"type": "OnDelete"}


@pytest.mark.parametrize("closed", ["true", "false"])
def test_the_router_listens_on_all_addresses_of_both_families(render, closed):
    rendered = render(f"security.enabled={closed}", "router.service.ipFamilyPolicy=PreferDualStack")
    protocol = "tls" if closed == "true" else "tcp"
    assert f"--listen={protocol}/*:7447" in container(rendered["Deployment", "contextpolicy-router"])["args"]
    assert rendered["Service", "contextpolicy-router"]["spec"]["ipFamilyPolicy"] == "PreferDualStack"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("zenoh.connect={tcp/a:7447}",), "so set router.enabled=false; or leave zenoh.connect empty"),
        (("router.enabled=false",), "there is no Zenoh router to listen to: set router.enabled=true"),
        (("operator.logLevel=LOUD",), "operator/logLevel"),
        (("router.enabled=false", "zenoh.connect={robot.local:7447}"), "zenoh/connect/0"),
        (("agent.enabld=true",), "enabld"),
        (("image.pullPolicy=Sometimes",), "image/pullPolicy"),
        (("router.port=80",), "router/port"),
        (("operator.resources.requests.cpu=lots",), "operator/resources/requests/cpu"),
        (("watchNamespaces={Robot}",), "watchNamespaces/0"),
        (("agent.enabled=true", "security.enabled=false"), "leave security.enabled empty or set it to true"),
        (("security.enabled=true", "security.routerSecret=mine"), "one authority signs all"),
        (("security.sampleKeys={robot//imu}",), "security/sampleKeys/0"),
        (("router.uplink={tls/fleet:7447}",), "set security.enabled=true and name a Secret of the fleet's authority"),
        (("router.uplink={tls/fleet:7447}", "security.enabled=true"), "or leave router.uplink empty"),
        (("router.uplink={tcp/fleet:7447}",), "router/uplink/0"),
        (("image.digest=latest",), "image/digest"),
        ((r"commonLabels.app\.kubernetes\.io/name=mine",), "app.kubernetes.io/name"),
        ((r"agent.podLabels.app\.kubernetes\.io/component=mine",), "app.kubernetes.io/component"),
    ],
)
def test_it_refuses(refusal, settings, message):
    assert message in refusal(*settings)
