"""The dashboard and the alert rules ask only for series that operator, agent and router export, by labels they have."""

from __future__ import annotations

import json
import re

import pytest
import yaml
from prometheus_client import REGISTRY
from prometheus_client.metrics import MetricWrapperBase

from contextpolicy.agent import agent_metrics
from contextpolicy.cluster.nodes import SLOW
from contextpolicy.telemetry import build_info, certificate_metrics, liveness, metrics, router_metrics
from contextpolicy.telemetry.scrape import Scrape
from tests.charts.conftest import CHART
from tests.node.layout import REPOSITORY

DASHBOARD = json.loads((CHART / "files" / "dashboard.json").read_text(encoding="utf-8"))
ALERTS = yaml.safe_load((CHART / "files" / "alerts.yaml").read_text(encoding="utf-8"))
SCHEMA = json.loads((CHART / "values.schema.json").read_text(encoding="utf-8"))
VALUES = yaml.safe_load((CHART / "values.yaml").read_text(encoding="utf-8"))
RULES = {rule["alert"]: rule for rule in ALERTS["groups"][0]["rules"]}
ROBOT = VALUES["metrics"]["robot"]["label"]
PROMETHEUS_OWN = {"le", "instance", "alertname", "namespace", ROBOT}
"""Labels that Prometheus adds itself: where a program is scraped, and of which robot."""

BOTH = ("metrics.alerts.enabled=true", "metrics.dashboard.enabled=true")
_NAME = re.compile(r"\bcontextpolicy_[a-z_]+")
_SELECTOR = re.compile(r"\b(contextpolicy_[a-z_]+)\s*(?:\{([^}]*)\})?")
_GROUPED = re.compile(r"\b(?:by|without|ignoring|on|group_left)\s*\(([^)]*)\)")
_SHOWN = re.compile(r"\$labels\.(\w+)|\{\{\s*(?!end\b)(\w+)\s*\}\}")


def exported():
    """Every series with its labels, as the programs register them."""
    modules = (metrics, agent_metrics, build_info, certificate_metrics, liveness, router_metrics)
    own = [one for module in modules for one in vars(module).values() if isinstance(one, MetricWrapperBase)]
    families = [(family, set(one._labelnames)) for one in own for family in one.describe()]
    families += [(family, set(family._labelnames)) for family in Scrape(lambda: None).describe()]
    families += [(family, set(family._labelnames)) for family in liveness.LoopDelays(dict).describe()]
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
    for name, rule in RULES.items():
        yield name, rule["expr"], " ".join(rule["annotations"].values())


QUESTIONS = list(questions())


def mistakes(expression, shown=""):
    """Series that nobody exports, and labels that none of the series in the expression has."""
    asked = set(_NAME.findall(expression))
    known = set().union(PROMETHEUS_OWN, *(EXPORTED.get(series, ()) for series in asked))
    wrong = [series for series in asked if series not in EXPORTED]
    for series, selector in _SELECTOR.findall(expression):
        named = re.findall(r"(\w+)\s*[=!]~?", selector)
        wrong += [
            f"{series}{{{label}}}" for label in named if label not in PROMETHEUS_OWN | EXPORTED.get(series, set())
        ]
    grouped = [label.strip() for group in _GROUPED.findall(expression) for label in group.split(",") if label.strip()]
    texts = [one or other for one, other in _SHOWN.findall(shown)]
    return wrong + [label for label in (*grouped, *texts) if label not in known]


@pytest.mark.parametrize(("where", "expression", "shown"), QUESTIONS, ids=[question[0] for question in QUESTIONS])
def test_queries_use_existing_series_and_labels(where, expression, shown):
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
        ("contextpolicy_stream_silent", "{{ with $labels.context }} in {{ . }}{{ end }}", ["context"]),
    ],
)
def test_a_planted_mistake_is_found(planted, shown, found):
    assert mistakes(planted, shown) == found


def test_every_exported_metric_is_shown_or_alerted():
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


def is_per_robot(expression):
    """Whether each of its series is of a chosen robot, or summed up by robot."""
    series = _NAME.findall(expression)
    return len(series) == expression.count(f'{ROBOT}=~"${ROBOT}"') or f"by ({ROBOT}" in expression


def sums_over_releases(expression):
    """What it adds up of several namespaces, that is, of several policies or releases; a node is of none."""
    kept = re.findall(r"\bby\s*\(([^)]*)\)\s*\((?!contextpolicy_node_)", expression)
    return [group for group in kept if "namespace" not in group]


@pytest.mark.parametrize(("where", "expression"), [question[:2] for question in QUESTIONS])
def test_namespaces_are_distinguished(where, expression):
    """Policies of one name in two namespaces, or two releases, must not become one line."""
    assert sums_over_releases(expression) == [], where


def test_a_sum_over_namespaces_is_found():
    assert sums_over_releases("sum by (cluster, name) (contextpolicy_plans_total)") == ["cluster, name"]


@pytest.mark.parametrize(
    ("where", "expression"), [question[:2] for question in QUESTIONS if question[0] != f"${ROBOT}"]
)
def test_robots_of_a_fleet_are_distinguished(where, expression):
    """A robot that fails must not vanish among others that work."""
    assert is_per_robot(expression)
    if where in RULES:
        by = [group.split(",")[0].strip() for group in _GROUPED.findall(expression) if group.strip()]
        assert set(by) == {ROBOT}
        assert f"$labels.{ROBOT}" in RULES[where]["annotations"]["summary"]


def test_a_series_of_any_robot_is_found():
    assert not is_per_robot('contextpolicy_bus_connected{cluster=~"$cluster"} + contextpolicy_router_clients')


def test_robot_label_is_configurable(render):
    rendered = render(
        *BOTH, "metrics.podMonitor.enabled=true", "metrics.robot.label=robot", "metrics.robot.name=amr-17"
    )
    [endpoint] = rendered["PodMonitor", "contextpolicy"]["spec"]["podMetricsEndpoints"]
    assert endpoint["relabelings"] == [{"targetLabel": "robot", "replacement": "amr-17"}]
    for text in (
        json.dumps(rendered["PrometheusRule", "contextpolicy"]["spec"]),
        rendered["ConfigMap", "contextpolicy-dashboard"]["data"]["contextpolicy.json"],
    ):
        assert ROBOT not in text, "the word stands for nothing but the label, so it can be replaced"
        assert "by (robot, " in text


def test_an_alert_can_be_changed_and_left_out(render):
    changed = '{"ContextPolicySlowReaction": {"threshold": 0.25, "severity": "page", "for": "1m"}, '
    changed += '"ContextPolicyContested": {"threshold": 10, "for": "30s"}, "ContextPolicyApiFails": {"enabled": false}'
    changed += ', "ContextPolicyCertificateExpires": {"threshold": 14}}'
    rendered = render(*BOTH, f"metrics.alerts.rules:={changed}", "metrics.alerts.runbookUrl=https://wiki/robots")
    [group, _] = rendered["PrometheusRule", "contextpolicy"]["spec"]["groups"]
    rules = {rule["alert"]: rule for rule in group["rules"]}
    assert list(rules) == [name for name in RULES if name != "ContextPolicyApiFails"]
    slow, contested, silent = (rules[f"ContextPolicy{name}"] for name in ("SlowReaction", "Contested", "StreamSilent"))
    assert (slow["for"], slow["labels"]) == ("1m", {"severity": "page"})
    assert slow["expr"] == RULES["ContextPolicySlowReaction"]["expr"].removesuffix("1") + "0.25"
    assert (contested["for"], contested["labels"]) == ("30s", {"severity": "warning"})
    assert contested["expr"].endswith(" > 10")
    assert rules["ContextPolicyCertificateExpires"]["expr"].endswith(" / 86400 < 14")
    assert silent["expr"] == RULES["ContextPolicyStreamSilent"]["expr"]
    assert silent["annotations"]["runbook_url"] == "https://wiki/robots#contextpolicystreamsilent"


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("metrics.alerts.rules.ContextPolicyNotRedy.severity=info",), "ContextPolicyNotRedy"),
        (("metrics.alerts.rules.ContextPolicyNotReady.threshold=1",), "threshold"),
        (("metrics.alerts.rules.ContextPolicyNotReady.for=soon",), "ContextPolicyNotReady/for"),
        (("metrics.robot.label=the robot",), "metrics/robot/label"),
        (("metrics.robot.label=__robot",), "metrics/robot/label"),
        (("metrics.alerts.runbookUrl=reference/conditions.html",), "metrics/alerts/runbookUrl"),
    ],
)
def test_an_unknown_alert_is_refused(refusal, settings, message):
    assert message in refusal(*settings)


@pytest.mark.parametrize("label", ["namespace", "name", "instance", "severity", "job"])
def test_reserved_label_is_refused_as_the_robot_label(refusal, label):
    assert "metrics/robot/label" in refusal(f"metrics.robot.label={label}")


def test_labels_used_by_rules_and_panels_are_reserved():
    schema = json.loads((CHART / "values.schema.json").read_text(encoding="utf-8"))
    refused = schema["properties"]["metrics"]["properties"]["robot"]["properties"]["label"]["not"]["enum"]
    texts = [(CHART / "files" / name).read_text(encoding="utf-8") for name in ("alerts.yaml", "dashboard.json")]
    used = {
        label
        for text in texts
        for group in re.findall(r"\b(?:by|on) \(([a-z_, ]+)\)", text)
        for label in group.split(", ")
    } | set(re.findall(r"\$labels\.([a-z_]+)", texts[0]))
    assert used - {"cluster"} <= set(refused)


def test_only_alerts_with_a_bound_have_a_threshold_option():
    """What can be more or less than a figure ends with it; what is 0 or 1 is no matter of taste."""
    known = SCHEMA["properties"]["metrics"]["properties"]["alerts"]["properties"]["rules"]["properties"]
    assert list(known) == list(RULES)
    for name, rule in RULES.items():
        bounded = re.search(r" [<>] [0-9.]+$", rule["expr"]) is not None
        assert bounded == ("threshold" in known[name]["properties"]), name


def test_reaction_histogram_has_a_bucket_at_the_alert_threshold():
    """A quantile is read from between two boundaries: what the alert allows has to be one, for old kubelets too."""
    allowed = float(RULES["ContextPolicySlowReaction"]["expr"].split()[-1])
    assert {allowed, SLOW + allowed} <= set(metrics.REACTION._upper_bounds)


def test_each_alert_is_tested_on_a_healthy_and_a_failing_robot():
    """tests/heavy has promtool carry the tests out: the first has all alerts, about the second robot only."""
    tests = yaml.safe_load((REPOSITORY / "tests" / "charts" / "alerts_test.yaml").read_text(encoding="utf-8"))["tests"]
    first = tests[0]
    [question] = first["promql_expr_test"]
    fired = [re.findall(r'(\w+)="([^"]*)"', sample["labels"]) for sample in question["exp_samples"]]
    assert sorted(dict(labels)["alertname"] for labels in fired) == sorted(RULES)
    assert {dict(labels)["cluster"] for labels in fired} == {"amr-2"}
    well = {one["series"].partition("{")[0] for one in first["input_series"] if 'cluster="amr-1"' in one["series"]}
    asked = {series for rule in RULES.values() for series in re.findall(r"\bcontextpolicy[_:][a-z_]+", rule["expr"])}
    assert asked <= well


def test_texts_that_are_tested_are_those_of_the_alerts():
    """promtool compares them whole, and runs in tests/heavy only: here what is written between the labels."""
    tests = yaml.safe_load((REPOSITORY / "tests" / "charts" / "alerts_test.yaml").read_text(encoding="utf-8"))["tests"]
    expected = [
        (one["alertname"], alert["exp_annotations"]["description"])
        for test in tests
        for one in test.get("alert_rule_test", ())
        for alert in one.get("exp_alerts", ())
    ]
    assert expected
    for name, text in expected:
        written = re.split(r"\{\{.*?\}\}", RULES[name]["annotations"]["description"])
        assert re.fullmatch(".*".join(re.escape(part) for part in written), text), name


def test_each_alert_links_to_what_to_do():
    """That the anchors exist: see test_operating."""
    base = VALUES["metrics"]["alerts"]["runbookUrl"]
    for name, rule in RULES.items():
        assert rule["annotations"]["runbook_url"] == f"{base}#{name.lower()}"
        assert rule["labels"]["severity"] in {"critical", "warning"}


def test_critical_alerts_wait_for_several_scrapes():
    """One scrape that fails, or a router that restarts, is no reason to page anybody. A forged plan is."""
    scrape = int(VALUES["metrics"]["podMonitor"]["interval"].removesuffix("s"))
    seconds = {"s": 1, "m": 60}
    for name, rule in RULES.items():
        if rule["labels"]["severity"] == "critical" and name != "ContextPolicyPlansForged":
            assert int(rule["for"][:-1]) * seconds[rule["for"][-1]] >= 4 * scrape, name


def test_alerts_and_dashboard_are_rendered_unchanged(render):
    rendered = render(*BOTH)
    [alerts, _] = rendered["PrometheusRule", "contextpolicy"]["spec"]["groups"]
    assert [alerts] == ALERTS["groups"]
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


@pytest.mark.parametrize(
    ("settings", "labels"),
    [((), {}), (("metrics.robot.label=robot", "metrics.robot.name=amr-17"), {"robot": "amr-17"})],
)
def test_an_operator_is_expected_where_its_release_is_installed(render, settings, labels):
    [_, group] = render(*BOTH, *settings)["PrometheusRule", "contextpolicy"]["spec"]["groups"]
    [plain] = yaml.safe_load((CHART / "files" / "expected.yaml").read_text(encoding="utf-8"))["groups"]
    assert group == {
        **plain,
        "rules": [{**plain["rules"][0], "labels": {"namespace": "contextpolicy-system", **labels}}],
    }
    assert plain["rules"][0]["record"] in RULES["ContextPolicyOperatorAbsent"]["expr"]


def operators_environment(rendered):
    [program] = rendered["Deployment", "contextpolicy"]["spec"]["template"]["spec"]["containers"]
    return {variable["name"]: variable.get("value") for variable in program["env"]}


@pytest.mark.parametrize(
    ("settings", "everywhere"),
    [
        ((), False),
        (("agent.enabled=true",), True),
        (("agent.enabled=true", "agent.nodeSelector.robot=yes"), False),
    ],
)
def test_agents_are_expected_on_every_node_without_a_selector(render, settings, everywhere):
    """An operator that is no longer to expect agents is started again, and knows of none that was there."""
    assert (operators_environment(render(*settings)).get("AGENTS") == "everywhere") is everywhere
