from __future__ import annotations

import importlib

import pytest
from prometheus_client import REGISTRY, generate_latest

from contextpolicy.telemetry import metrics

NAMES = {
    *("contextpolicy_stage_seconds", "contextpolicy_plans", "contextpolicy_samples_dropped"),
    *("contextpolicy_plans_held_back", "contextpolicy_context_active", "contextpolicy_task_share_cores"),
    *("contextpolicy_task_weight", "contextpolicy_resizes", "contextpolicy_contests"),
}


def ours():
    """The operator's: an agent that was imported by another test has its own."""
    families = {family.name: family for family in REGISTRY.collect() if family.name.startswith("contextpolicy_")}
    return {name: family for name, family in families.items() if not name.startswith("contextpolicy_agent_")}


def test_every_metric_is_there_with_a_text():
    assert ours().keys() == NAMES
    assert all(family.documentation.endswith(".") for family in ours().values())


def test_names_and_labels_keep_the_conventions():
    metrics.STAGE_SECONDS.labels("lab/robot", "plan").observe(0.003)
    metrics.PLANS.labels("lab/robot").inc()
    text = generate_latest().decode()
    assert 'contextpolicy_plans_total{policy="lab/robot"}' in text
    assert 'contextpolicy_stage_seconds_bucket{le="0.005",policy="lab/robot",stage="plan"}' in text
    labels = {label for family in ours().values() for sample in family.samples for label in sample.labels}
    assert labels <= {"policy", "stage", "stream", "reason", "context", "task", "result", "le"}


def test_they_are_registered_once():
    with pytest.raises(ValueError, match="Duplicated"):
        importlib.reload(metrics)
