"""The chart: what it renders under which values, and what it refuses."""

from __future__ import annotations

import pytest

from tests.bus.certificates import ROLES
from tests.charts.conftest import CHART, set_all
from tests.charts.objects import EVERYTHING
from tests.crds.schema import definition

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
    *((kind, "contextpolicy-originals") for kind in ("Secret", "Role", "RoleBinding")),
    *((f"ValidatingAdmissionPolicy{part}", "contextpolicy-originals") for part in ("", "Binding")),
    *((kind, "contextpolicy-restore-key") for kind in ("Role", "RoleBinding")),
    ("ServiceAccount", "contextpolicy"),
    ("ClusterRole", "contextpolicy-restore"),
    ("ClusterRoleBinding", "contextpolicy-restore"),
    ("Job", "contextpolicy-restore"),
    ("ServiceAccount", "contextpolicy-restore"),
    ("ClusterRole", "contextpolicy-doctor"),
    ("ClusterRoleBinding", "contextpolicy-doctor"),
    ("Pod", "contextpolicy-doctor"),
    ("ServiceAccount", "contextpolicy-doctor"),
    ("ServiceAccount", "contextpolicy-certificates"),
    ("Role", "contextpolicy-certificates"),
    ("RoleBinding", "contextpolicy-certificates"),
    ("CronJob", "contextpolicy-certificates"),
    *(("Secret", f"contextpolicy-bus-{role}") for role in ("authority", "router", *ROLES)),
}


@pytest.mark.parametrize("settings", [(), EVERYTHING], ids=["defaults", "everything"])
def test_it_lints(helm, settings):
    done = helm("lint", "--strict", str(CHART), *set_all(settings))
    assert done.returncode == 0, done.stdout


def test_it_renders_exactly_these_objects(render):
    [job] = render().keys() - DEFAULTS
    assert job[0] == "Job"
    assert job[1].startswith("contextpolicy-certificates-")


def test_all_options_render_together(render):
    added = {key for key in render(*EVERYTHING).keys() - DEFAULTS if key[0] != "Job"}
    assert added == {
        ("DaemonSet", "contextpolicy-agent"),
        ("NetworkPolicy", "contextpolicy-certificates"),
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


def test_crd_is_the_canonical_one(render):
    rendered = render()["CustomResourceDefinition", "contextpolicies.contextpolicy.dev"]
    assert rendered["spec"] == definition()["spec"]
    assert rendered["metadata"]["annotations"] == {"helm.sh/resource-policy": "keep"}


def test_crd_is_deleted_with_the_release_if_not_kept(render):
    rendered = render("crds.keep=false")["CustomResourceDefinition", "contextpolicies.contextpolicy.dev"]
    assert "annotations" not in rendered["metadata"]
    assert ("CustomResourceDefinition", "contextpolicies.contextpolicy.dev") not in render("crds.enabled=false")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("zenoh.connect={tcp/a:7447}",), "so set router.enabled=false; or leave zenoh.connect empty"),
        (("router.enabled=false",), "no Zenoh router: set router.enabled=true"),
        (("operator.logLevel=LOUD",), "operator/logLevel"),
        (("router.enabled=false", "zenoh.connect={robot.local:7447}"), "zenoh/connect/0"),
        (("agent.enabld=true",), "enabld"),
        (("image.pullPolicy=Sometimes",), "image/pullPolicy"),
        (("router.port=80",), "router/port"),
        (("operator.resources.requests.cpu=lots",), "operator/resources/requests/cpu"),
        (("watchNamespaces={Robot}",), "watchNamespaces/0"),
        (
            ("agent.enabled=true", "security.enabled=false"),
            "it needs security.enabled=true; or set agent.enabled=false",
        ),
        (("security.routerSecret=mine",), "the same authority must sign all certificates"),
        (("security.enabled=null",), "missing property 'enabled'"),
        (("security.sampleKeys={robot//imu}",), "security/sampleKeys/0"),
        (("router.uplink={tls/fleet:7447}",), "set security.enabled=true and name a Secret of the fleet's authority"),
        (("router.uplink={tls/fleet:7447}", "security.enabled=true"), "or leave router.uplink empty"),
        (("router.uplink={tcp/fleet:7447}",), "router/uplink/0"),
        (("image.digest=latest",), "image/digest"),
        (("operator.healthPort=8081",), "healthPort 8081, metrics.port 8081 and operator.livePort 8082 must differ"),
        (("metrics.port=8082",), "must differ"),
        (("operator.livePort=8080",), "must differ"),
        (("router.port=8081",), "router.port and metrics.port are both 8081"),
        ((r"commonLabels.app\.kubernetes\.io/name=mine",), "app.kubernetes.io/name"),
        ((r"agent.podLabels.app\.kubernetes\.io/component=mine",), "app.kubernetes.io/component"),
        ((r"commonLabels.app\.kubernetes\.io/part-of=mine",), "app.kubernetes.io/part-of"),
        (("nameOverride=My Robot",), "nameOverride"),
        (("operator.topologySpreadConstraints[0].maxSkew=1",), "topologySpreadConstraints/0"),
    ],
)
def test_it_refuses(refusal, settings, message):
    assert message in refusal(*settings)
