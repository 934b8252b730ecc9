"""What administrators allow namespaces, and the findings for policies that exceed it."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING

import pytest

from contextpolicy.policy.spec import Shadow
from contextpolicy.policy.tenants import Tenant, Tenants, read_tenants
from tests.planning.builders import a_policy, a_stream, a_task

if TYPE_CHECKING:
    from contextpolicy.errors import Finding


def of(**listed):
    """Tenants as the operator's environment has them; `others` stands for `*`."""
    findings: list[Finding] = []
    tenants = read_tenants(
        json.dumps({"*" if name == "others" else name: own for name, own in listed.items()}), findings
    )
    assert findings == []
    return tenants


def policy(*keys, namespace="lab", **stream):
    streams = [a_stream(f"stream{index}", key=key, **stream) for index, key in enumerate(keys)]
    return replace(a_policy(tasks=[a_task("slam")], streams=streams), namespace=namespace)


def refused(tenants, *keys, **more):
    return [finding.value for finding in tenants.findings(policy(*keys, **more))]


def test_by_default_every_namespace_reads_everything():
    assert Tenants().priority("lab") == 0
    assert refused(Tenants(), "robot/imu", "**") == []


def test_a_priority_applies_only_to_listed_namespaces():
    tenants = of(lab={"priority": 10}, others={"priority": 2})
    assert [tenants.priority(name) for name in ("lab", "elsewhere")] == [10, 2]
    assert refused(tenants, "robot/imu") == [], "it says nothing about streams"


def test_streams_read_below_the_prefixes_of_their_namespace():
    tenants = of(lab={"streamPrefixes": ["robot", "rt/arm"]})
    keys = ("robot", "robot/imu", "robot/**", "rt/arm/joints")
    assert refused(tenants, *keys) == []
    wider = ("**", "*/imu", "robots/imu", "robot$*/imu", "rt/*/joints", "rt", "arm")
    assert refused(tenants, *wider) == list(wider)


def test_a_refusal_names_the_field_and_what_is_allowed():
    [finding] = of(lab={"streamPrefixes": ["robot"]}).findings(policy("robot/imu", "**"))
    assert str(finding) == (
        "spec.streams[1].key: invalid value '**': expected a key that the administrator lets namespace lab read: "
        "robot/**"
    )


def test_liveliness_outside_the_prefixes_is_refused():
    [finding] = of(lab={"streamPrefixes": ["robot"]}).findings(policy("robot/imu", liveliness="other/imu"))
    assert (finding.field, finding.value) == ("spec.streams[0].liveliness", "other/imu")


def test_a_shadow_receives_misses_only_on_keys_that_it_may_read():
    shadow = replace(policy("lab/imu"), shadow=Shadow("other"))
    [finding] = of(lab={"streamPrefixes": ["lab"]}).findings(shadow)
    assert (finding.field, finding.value) == ("spec.shadow.health", "robot/*/health")


def test_without_prefixes_nothing_is_readable_once_any_is_restricted():
    [finding] = of(lab={"streamPrefixes": ["robot"]}, dock={"priority": 1}).findings(policy("dock/x", namespace="dock"))
    assert finding.allowed == "a key that the administrator lets namespace dock read: no stream"


def test_the_namespace_placeholder_expands_for_each_namespace():
    tenants = of(lab={"priority": 1}, others={"streamPrefixes": ["{namespace}"]})
    assert refused(tenants, "lab/imu", "dock/imu") == ["dock/imu"]
    assert refused(tenants, "lab/imu", "dock/imu", namespace="dock") == ["lab/imu"]


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("lab=10", "TENANTS"),
        ("[]", "TENANTS"),
        ('{"lab": 10}', "TENANTS.lab"),
        ('{"lab": {"priority": "high"}}', "TENANTS.lab.priority"),
        ('{"lab": {"priority": 1.5}}', "TENANTS.lab.priority"),
        ('{"lab": {"prefixes": []}}', "TENANTS.lab.prefixes"),
        ('{"lab": {"streamPrefixes": "robot"}}', "TENANTS.lab.streamPrefixes"),
        ('{"lab": {"streamPrefixes": ["robot/**"]}}', "TENANTS.lab.streamPrefixes"),
        ('{"lab": {"streamPrefixes": ["/robot"]}}', "TENANTS.lab.streamPrefixes"),
    ],
)
def test_invalid_input_is_named(text, field):
    findings: list[Finding] = []
    read_tenants(text, findings)
    assert [finding.field for finding in findings] == [field]


def test_an_empty_prefix_list_is_kept():
    assert Tenants({"lab": Tenant(stream_prefixes=())}).stream_prefixes("lab") == ()
