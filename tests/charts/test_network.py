"""Who reaches whom: routers, drivers, the API server and metrics."""

from __future__ import annotations

import pytest

from contextpolicy.bus.session import LARGEST
from tests.charts.objects import EVERYTHING, container, environment


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


def test_external_router_replaces_the_charts(render):
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


def test_no_pod_reaches_the_health_port(render):
    """A kubelet does: its traffic comes from the pod's own node, which no policy keeps out."""
    rules = render("networkPolicy.enabled=true")["NetworkPolicy", "contextpolicy"]["spec"]["ingress"]
    assert [port["port"] for rule in rules for port in rule["ports"]] == ["metrics"]


def test_the_router_has_memory_for_a_flood_of_the_largest_messages(render):
    """45 MiB and one such message of each of 7 priorities, reliable or not. Measured: 147 MiB."""
    router = container(render()["Deployment", "contextpolicy-router"])
    [largest] = [int(one.partition("=")[2]) for one in router["args"] if one.startswith("--max-message-bytes=")]
    limit = int(router["resources"]["limits"]["memory"].removesuffix("Mi")) << 20
    assert (45 << 20) + 14 * largest <= limit * 2 / 3
    assert largest == LARGEST


def test_network_policies_let_the_operator_reach_another_router(render):
    rendered = render("networkPolicy.enabled=true", "router.enabled=false", "zenoh.connect={quic/robot.local:7500?a=b}")
    *_, last = rendered["NetworkPolicy", "contextpolicy"]["spec"]["egress"]
    assert last["ports"] == [{"port": 7500, "protocol": "UDP"}]


def test_network_policy_peers_keep_our_own_clients(render):
    settings = ("networkPolicy.enabled=true", "networkPolicy.routerFrom[0].podSelector.matchLabels.app=camera")
    rule, _metrics = render(*settings)["NetworkPolicy", "contextpolicy-router"]["spec"]["ingress"]
    clients = [peer["podSelector"]["matchLabels"] for peer in rule["from"]]
    assert clients[0] == {"app": "camera"}
    assert [labels["app.kubernetes.io/component"] for labels in clients[1:]] == ["operator", "agent"]


@pytest.mark.parametrize("closed", ["true", "false"])
def test_the_router_listens_on_all_addresses_of_both_families(render, closed):
    rendered = render(f"security.enabled={closed}", "router.service.ipFamilyPolicy=PreferDualStack")
    protocol = "tls" if closed == "true" else "tcp"
    assert f"--listen={protocol}/*:7447" in container(rendered["Deployment", "contextpolicy-router"])["args"]
    assert rendered["Service", "contextpolicy-router"]["spec"]["ipFamilyPolicy"] == "PreferDualStack"
