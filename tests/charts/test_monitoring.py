"""The dashboard and the alert rules ask only for series that operator, agent and router export, by labels they have."""

from __future__ import annotations

import json
import re

import pytest
import yaml
from prometheus_client import REGISTRY
from prometheus_client.metrics import MetricWrapperBase

from contextpolicy.agent import service
from contextpolicy.telemetry import build_info, metrics, router_metrics
from contextpolicy.telemetry.scrape import Scrape
from tests.charts.conftest import CHART

DASHBOARD = json.loads((CHART / "files" / "dashboard.json").read_text(encoding="utf-8"))
ALERTS = yaml.safe_load((CHART / "files" / "alerts.yaml").read_text(encoding="utf-8"))
PROMETHEUS_OWN = {"le", "instance", "alertname"}
"""Labels that Prometheus adds itself."""

_NAME = re.compile(r"\bcontextpolicy_[a-z_]+")
_SELECTOR = re.compile(r"\b(contextpolicy_[a-z_]+)\s*(?:\{([^}]*)\})?")
_GROUPED = re.compile(r"\b(?:by|without|ignoring|on|group_left)\s*\(([^)]*)\)")
_SHOWN = re.compile(r"\{\{\s*(?:\$labels\.)?(\w+)\s*\}\}")


def exported():
    """Every series with its labels, as the programs register them."""
    modules = (metrics, service, build_info, router_metrics)
    own = [one for module in modules for one in vars(module).values() if isinstance(one, MetricWrapperBase)]
    families = [(family, set(one._labelnames)) for one in own for family in one.describe()]
    families += [(family, set(family._labelnames)) for family in Scrape(lambda: None).describe()]
    return {series: labels for family, labels in families for series in _series(family)}


def _series(family):
    suffixes = {"counter": ("_total",), "histogram": ("_bucket", "_sum", "_count")}.get(family.type, ("",))
    return [family.name + suffix for suffix in suffixes]


EXPORTED = exported()


def questions():
    """(where, expression, texts that show labels) of all panels, variables and alerts."""
    for panel in DASHBOARD["panels"]:
        for target in panel.get("targets", ()):
            yield panel["title"], target["expr"], target["legendFormat"]
    for variable in DASHBOARD["templating"]["list"]:
        if variable["type"] == "query":
            yield f"${variable['name']}", variable["query"]["query"], ""
    for rule in ALERTS["groups"][0]["rules"]:
        yield rule["alert"], rule["expr"], " ".join(rule["annotations"].values())


QUESTIONS = list(questions())


def mistakes(expression, shown=""):
    """Series that nobody exports, and labels that none of the series in the expression has."""
    asked = set(_NAME.findall(expression))
    known = set().union(PROMETHEUS_OWN, *(EXPORTED.get(series, ()) for series in asked))
    wrong = [series for series in asked if series not in EXPORTED]
    for series, selector in _SELECTOR.findall(expression):
        named = re.findall(r"(\w+)\s*[=!]~?", selector)
        wrong += [f"{series}{{{label}}}" for label in named if label not in EXPORTED.get(series, ())]
    grouped = [label.strip() for group in _GROUPED.findall(expression) for label in group.split(",") if label.strip()]
    return wrong + [label for label in (*grouped, *_SHOWN.findall(shown)) if label not in known]


@pytest.mark.parametrize(("where", "expression", "shown"), QUESTIONS, ids=[question[0] for question in QUESTIONS])
def test_it_asks_for_what_there_is(where, expression, shown):
    assert mistakes(expression, shown) == [], where


@pytest.mark.parametrize(
    ("planted", "shown", "found"),
    [
        ("rate(contextpolicy_planz_total[5m])", "", ["contextpolicy_planz_total"]),
        ("contextpolicy_plans", "", ["contextpolicy_plans"]),
        ('contextpolicy_bus_connected{robot="a"}', "", ["contextpolicy_bus_connected{robot}"]),
        ("sum by (robot) (contextpolicy_bus_connected)", "", ["robot"]),
        ("contextpolicy_stream_silent", "{{stream}} {{robot}}", ["robot"]),
        ("contextpolicy_stream_silent", "{{ $labels.context }}", ["context"]),
    ],
)
def test_a_planted_mistake_is_found(planted, shown, found):
    assert mistakes(planted, shown) == found


def test_nothing_that_is_exported_is_left_unwatched():
    """A metric that no panel and no alert shows is one that nobody will ever look at."""
    asked = {series for _, expression, _ in QUESTIONS for series in _NAME.findall(expression)}
    families = {re.sub(r"_(bucket|sum|count)$", "", series) for series in EXPORTED}
    assert families - {re.sub(r"_(bucket|sum|count)$", "", series) for series in asked} == set()


def test_no_two_panels_overlap():
    taken = [
        (x, y)
        for panel in DASHBOARD["panels"]
        for x in range(panel["gridPos"]["x"], panel["gridPos"]["x"] + panel["gridPos"]["w"])
        for y in range(panel["gridPos"]["y"], panel["gridPos"]["y"] + panel["gridPos"]["h"])
    ]
    assert len(taken) == len(set(taken))
    assert max(x for x, _ in taken) < 24


def test_the_chart_passes_both_on_unchanged(render):
    rendered = render("metrics.alerts.enabled=true", "metrics.dashboard.enabled=true")
    assert rendered["PrometheusRule", "contextpolicy"]["spec"] == ALERTS
    dashboard = rendered["ConfigMap", "contextpolicy-dashboard"]
    assert json.loads(dashboard["data"]["contextpolicy.json"]) == DASHBOARD
    assert dashboard["metadata"]["labels"]["grafana_dashboard"] == "1"


def test_prometheus_scrapes_whatever_has_metrics(render):
    rendered = render("agent.enabled=true", "metrics.podMonitor.enabled=true")
    spec = rendered["PodMonitor", "contextpolicy"]["spec"]
    [endpoint] = spec["podMetricsEndpoints"]
    assert endpoint["honorLabels"] is True, "else a policy's namespace becomes exported_namespace"
    [choice] = spec["selector"]["matchExpressions"]
    for kind, name in (
        ("Deployment", "contextpolicy"),
        ("Deployment", "contextpolicy-router"),
        ("DaemonSet", "contextpolicy-agent"),
    ):
        template = rendered[kind, name]["spec"]["template"]
        assert template["metadata"]["labels"]["app.kubernetes.io/component"] in choice["values"]
        [program] = template["spec"]["containers"]
        assert endpoint["port"] in [port["name"] for port in program["ports"]]


def test_the_registry_is_the_one_that_is_served():
    """What `exported` lists is what prometheus_client serves by default."""
    assert {family.name for family in REGISTRY.collect()} >= {"contextpolicy_plans", "contextpolicy_build_info"}
