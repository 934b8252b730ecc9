"""What the chart makes of the administrator's word about namespaces; tests/e2e tries it on an API server."""

from __future__ import annotations

import json

import pytest

from contextpolicy.app.settings import read
from contextpolicy.policy.tenants import Tenant, Tenants
from tests.charts.objects import environment

TENANTS = {"lab": {"priority": 10, "streamPrefixes": ["robot"]}, "*": {"streamPrefixes": ["{namespace}"]}}
SET = f"tenants:={json.dumps(TENANTS)}"
POLICY = ("ValidatingAdmissionPolicy", "contextpolicy-streams")


def test_the_operator_reads_what_the_chart_writes(render):
    environ = {"TENANTS": environment(render(SET)["Deployment", "contextpolicy"])["TENANTS"]}
    assert read(environ).tenants == Tenants({"lab": Tenant(10, ("robot",)), "*": Tenant(0, ("{namespace}",))})


@pytest.mark.parametrize("settings", [(), ("tenants.lab.priority=10",)])
def test_no_admission_policy_without_prefixes(render, settings):
    assert POLICY not in render(*settings)


def test_admission_policy_covers_only_served_namespaces(render):
    everywhere, there = render(SET)[POLICY]["spec"], render(SET, "watchNamespaces={lab}")[POLICY]["spec"]
    assert "namespaceSelector" not in everywhere["matchConstraints"]
    [expression] = there["matchConstraints"]["namespaceSelector"]["matchExpressions"]
    assert expression == {"key": "kubernetes.io/metadata.name", "operator": "In", "values": ["lab"]}


@pytest.mark.parametrize(
    ("tenants", "named"),
    [
        ({"lab": {"streamPrefixes": ["robot/**"]}}, "/tenants/lab/streamPrefixes"),
        ({"lab": {"streamPrefixes": ["/robot"]}}, "/tenants/lab/streamPrefixes"),
        ({"lab": {"priority": -1}}, "/tenants/lab/priority"),
        ({"lab": {"prio": 1}}, "prio"),
        ({"Lab!": {"priority": 1}}, "Lab!"),
    ],
)
def test_invalid_input_is_refused(refusal, tenants, named):
    assert named in refusal(f"tenants:={json.dumps(tenants)}")
