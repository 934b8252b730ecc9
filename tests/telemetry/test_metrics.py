from __future__ import annotations

import importlib

import pytest
from prometheus_client import REGISTRY, generate_latest
from prometheus_client.metrics import MetricWrapperBase

from contextpolicy.telemetry import metrics

NAMES = {
    *("contextpolicy_sample_to_plan_seconds", "contextpolicy_plan_to_patch_seconds"),
    *("contextpolicy_patch_to_in_force_seconds", "contextpolicy_reaction_seconds"),
    *("contextpolicy_plans", "contextpolicy_samples_dropped", "contextpolicy_api_requests"),
    *("contextpolicy_events_left_out",),
    *("contextpolicy_plans_held_back", "contextpolicy_context_active", "contextpolicy_task_share_cores"),
    *("contextpolicy_task_weight", "contextpolicy_resizes", "contextpolicy_contests"),
}


LABELS = {
    *("policy", "namespace", "name", "stream", "reason", "context", "task", "result", "le"),
    *("method", "code"),
}


def ours():
    """The operator's own module: what other tests have imported is in the same registry."""
    names = {
        collector.describe()[0].name for collector in vars(metrics).values() if isinstance(collector, MetricWrapperBase)
    }
    return {family.name: family for family in REGISTRY.collect() if family.name in names}


def test_every_metric_is_there_with_a_text():
    assert ours().keys() == NAMES
    assert all(family.documentation.endswith(".") for family in ours().values())


def test_names_and_labels_keep_the_conventions():
    metrics.REACTION.labels("lab", "robot").observe(0.003)
    metrics.PLANS.labels("lab/robot").inc()
    text = generate_latest().decode()
    assert 'contextpolicy_plans_total{policy="lab/robot"}' in text
    assert 'contextpolicy_reaction_seconds_bucket{le="0.005",name="robot",namespace="lab"}' in text
    labels = {label for family in ours().values() for sample in family.samples for label in sample.labels}
    assert labels <= LABELS


def test_they_are_registered_once():
    with pytest.raises(ValueError, match="Duplicated"):
        importlib.reload(metrics)
