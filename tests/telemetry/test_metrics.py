from __future__ import annotations

from dataclasses import replace

from prometheus_client import REGISTRY, generate_latest
from prometheus_client.metrics import MetricWrapperBase

from contextpolicy.policy.spec import Mode
from contextpolicy.telemetry import metrics
from tests.planning.builders import Story, a_context, a_parent, a_policy, a_stream, a_task, on_node

NAMES = {
    *("contextpolicy_sample_to_plan_seconds", "contextpolicy_plan_to_patch_seconds"),
    *("contextpolicy_patch_to_in_force_seconds", "contextpolicy_reaction_seconds"),
    *("contextpolicy_plans", "contextpolicy_samples_dropped", "contextpolicy_api_requests"),
    *("contextpolicy_events_left_out",),
    *("contextpolicy_plans_held_back", "contextpolicy_context_active", "contextpolicy_task_share_cores"),
    *("contextpolicy_task_weight", "contextpolicy_resizes", "contextpolicy_conflicts"),
}


LABELS = {
    *("namespace", "name", "stream", "reason", "context", "task", "result", "le"),
    *("method", "code"),
}


def ours():
    """The operator's own module: what other tests have imported is in the same registry."""
    own = [collector for collector in vars(metrics).values() if isinstance(collector, MetricWrapperBase)]
    names = {family.name for collector in own for family in collector.describe()}
    return {family.name: family for family in REGISTRY.collect() if family.name in names}


def test_every_metric_has_a_help_text():
    assert ours().keys() == NAMES
    assert all(family.documentation.endswith(".") for family in ours().values())


def test_names_and_labels_keep_the_conventions():
    metrics.REACTION.labels("lab", "robot").observe(0.003)
    metrics.PLANS.labels("lab", "robot").inc()
    text = generate_latest().decode()
    assert 'contextpolicy_plans_total{name="robot",namespace="lab"}' in text
    assert 'contextpolicy_reaction_seconds_bucket{le="0.005",name="robot",namespace="lab"}' in text
    labels = {label for family in ours().values() for sample in family.samples for label in sample.labels}
    assert labels <= LABELS


def of(name):
    """All series of a policy in namespace `gone`."""
    families = (sample for family in ours().values() for sample in family.samples)
    return {
        (s.name, s.labels.get("task", ""))
        for s in families
        if s.labels == {**s.labels, "namespace": "gone", "name": name}
    }


def test_counters_of_a_policy_exist_from_the_start():
    """`increase()` and a rate over buckets see nothing of a series that appears with its first count."""
    metrics.begin("gone/new")
    counted = {name for name, _ in of("new") if name.endswith(("_total", "_count"))}
    assert counted == {
        *(f"contextpolicy_{name}_total" for name in ("plans", "plans_held_back", "conflicts", "events_left_out")),
        *(f"contextpolicy_{name}_seconds_count" for name in ("sample_to_plan", "plan_to_patch")),
        *(f"contextpolicy_{name}_seconds_count" for name in ("patch_to_in_force", "reaction")),
    }
    metrics.forget("gone/new")
    assert of("new") == set()


def test_metrics_of_a_deleted_policy_are_removed():
    for name in ("one", "two"):
        metrics.PLANS.labels("gone", name).inc()
        metrics.TASK_SHARE.labels("gone", name, "slam").set(1)
        metrics.REACTION.labels("gone", name).observe(1)
    metrics.forget("gone/one")
    assert of("one") == set()
    assert ("contextpolicy_task_share_cores", "slam") in of("two")


def test_gauges_go_with_the_tasks_and_contexts_that_an_edit_removes():
    before = replace(
        a_policy(tasks=[a_task("slam"), a_task("speech")], contexts=[a_context("moving")]), namespace="gone"
    )
    after = replace(before, tasks=before.tasks[:1], contexts=())
    metrics.CONTEXT_ACTIVE.labels("gone", "robot", "moving").set(1)
    for task in before.tasks:
        metrics.TASK_SHARE.labels("gone", "robot", task.name).set(1)
    metrics.replace(before, after)
    assert of("robot") == {("contextpolicy_task_share_cores", "slam")}
    metrics.replace(after, replace(after, mode=Mode.PAUSED))
    assert of("robot") == set()


def weights_of(story):
    metrics.measure(story.planner.policy, story.last)
    [family] = [family for family in ours().values() if family.name == "contextpolicy_task_weight"]
    return {sample.labels["task"]: sample.value for sample in family.samples if sample.labels["name"] == "robot"}


def test_weights_add_up_to_what_the_plan_divides_by():
    """As on the live page: a task's weight is its part of the sum, so nothing may be in it twice."""
    tasks = [
        a_parent("navigation", "slam", "signs", priority=5),
        *(a_task(name) for name in ("slam", "signs", "speech")),
    ]
    story = Story(a_policy(tasks=tasks))
    assert weights_of(story) == {"slam": 2.5, "signs": 2.5, "speech": 1.0}
    assert sum(weights_of(story).values()) == sum(story.weights()[leaf] for leaf in ("slam", "signs", "speech"))
    story.place(on_node("slam", "speech"), at=1.0)
    assert set(weights_of(story)) == {"slam", "speech"}
    metrics.forget("lab/robot")


def test_counts_go_with_the_streams_that_an_edit_removes():
    before = replace(a_policy(streams=[a_stream("imu"), a_stream("scan")], tasks=[a_task("slam")]), namespace="gone")
    for stream in before.streams:
        metrics.DROPS.labels("gone", "robot", stream.name, "old").inc()
    metrics.replace(before, replace(before, mode=Mode.PAUSED))
    assert REGISTRY.get_sample_value(DROPPED, dropped("imu")) == 1
    metrics.replace(before, replace(before, streams=before.streams[1:]))
    assert REGISTRY.get_sample_value(DROPPED, dropped("imu")) is None
    assert REGISTRY.get_sample_value(DROPPED, dropped("scan")) == 1
    metrics.forget("gone/robot")


DROPPED = "contextpolicy_samples_dropped_total"


def dropped(stream):
    return {"namespace": "gone", "name": "robot", "stream": stream, "reason": "old"}
