"""Every bad field is named, all at once, with its value and what is allowed."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta, timezone

import pytest

from contextpolicy.errors import PolicyError
from contextpolicy.policy import parsing
from contextpolicy.policy.spec import (
    Clock,
    Control,
    Encoding,
    Force,
    Mode,
    RosRelease,
    SatisfiedBy,
    Scheduler,
    Shadow,
)
from tests.planning.builders import a_body, a_context, a_parent, a_policy, a_stream, a_task


def refused(**spec):
    """The findings for a spec, as {field: (value, allowed)}."""
    spec.setdefault("tasks", [a_task("slam")])
    with pytest.raises(PolicyError) as caught:
        parsing.parse(a_body(**spec))
    return {finding.field: (finding.value, finding.allowed) for finding in caught.value.findings}


def test_what_is_not_said_has_the_documented_default():
    policy = a_policy(tasks=[a_task("slam")])
    assert (policy.mode, policy.enforcement.scheduler, policy.enforcement.control) == (
        Mode.ENFORCE,
        Scheduler.CFS,
        Control.LIMIT,
    )
    assert (policy.reserve, policy.enforcement.min_dwell, policy.fallback, policy.force) == (0, 0.0, None, None)
    task = policy.tasks[0]
    assert (task.container, task.priority, task.idle, task.min, task.max) == ("slam", 1.0, None, 10, None)
    assert task.satisfied_by is SatisfiedBy.ALL
    assert policy.reference == "lab/robot"


def test_a_field_of_the_group_outside_it_says_where_it_belongs():
    [(value, allowed)] = refused(control="Weight").values()
    assert value == "Weight"
    assert allowed.endswith("; did you mean enforcement.control?")


def test_fields_are_read_in_planning_units():
    policy = a_policy(
        reserve="300m",
        enforcement={"minDwell": "1.5s"},
        streams=[a_stream("imu", staleAfter="500ms", encoding="cbor")],
        tasks=[a_task("slam", min="0.1", max=2, needs={"cores": "1", "memory": "1Ki", "deadline": "50ms"})],
    )
    task = policy.tasks[0]
    assert (policy.reserve, policy.enforcement.min_dwell) == (300, 1.5)
    assert (policy.streams[0].stale_after, policy.streams[0].encoding) == (0.5, Encoding.CBOR)
    assert (task.min, task.max) == (100, 2000)
    assert (task.needs.cores, task.needs.memory, task.needs.deadline) == (1000, 1024, 0.05)


def test_a_ros_stream_says_whose_messages_and_which_clock():
    cdr = {"encoding": "cdr", "type": "sensor_msgs/msg/Range"}
    said, unsaid = a_policy(
        streams=[a_stream("range", ros="humble", types="robot-types", clock="Arrival", **cdr), a_stream("near", **cdr)],
        tasks=[a_task("slam")],
    ).streams
    assert (said.ros, said.types, said.clock) == (RosRelease.HUMBLE, "robot-types", Clock.ARRIVAL)
    assert (unsaid.ros, unsaid.types, unsaid.clock) == (RosRelease.LATEST, None, Clock.AUTO)


def test_what_only_ros_streams_have_is_refused_elsewhere():
    findings = refused(
        streams=[a_stream("imu", ros="foxy", types="Robot Types", clock="sim"), a_stream("mic", ros="jazzy")]
    )
    assert findings["spec.streams[0].clock"] == ("sim", "one of Auto, Source, Arrival")
    assert findings["spec.streams[0].types"][0] == "Robot Types"
    assert findings["spec.streams[1].ros"] == ("jazzy", "encoding cdr with it: other encodings have no message types")


def test_a_selector_reads_labels_and_expressions():
    selector = {"matchLabels": {"app": "slam"}, "matchExpressions": [{"key": "tier", "operator": "Exists"}]}
    task = a_policy(tasks=[{"name": "slam", "selector": selector}]).tasks[0]
    assert task.selector is not None
    assert task.selector.matches({"app": "slam", "tier": "x"})
    assert not task.selector.matches({"app": "slam"})


@pytest.mark.parametrize(
    "until",
    [
        "2026-11-21T12:00:00Z",
        "2026-11-21T13:00:00+01:00",
        datetime(2026, 11, 21, 12, tzinfo=UTC),
        datetime(2026, 11, 21, 10, tzinfo=timezone(timedelta(hours=-2))),
    ],
)
def test_a_moment_is_unix_time(until):
    policy = a_policy(tasks=[a_task("slam")], contexts=[a_context("care")], force={"context": "care", "until": until})
    assert policy.force == Force("care", 1795262400.0)


def test_a_shadow_has_usual_values():
    policy = a_policy(tasks=[a_task("slam")], shadow={"of": "other"})
    assert policy.shadow == Shadow("other", tolerance=0.05, patience=5.0, health="robot/*/health")
    assert a_policy(tasks=[a_task("slam")]).shadow is None


FIELDS = [
    # where, what, the field that is named
    ({"mode": "On"}, "spec.mode"),
    ({"mode": ["Enforce"]}, "spec.mode"),
    ({"reserve": "-1"}, "spec.reserve"),
    ({"fallback": "nowhere"}, "spec.fallback"),
    ({"fallback": 5}, "spec.fallback"),
    ({"force": {"context": "nowhere", "until": "2026-11-21T12:00:00Z"}}, "spec.force.context"),
    ({"force": {"context": "nowhere", "until": "2026-11-21T12:00:00"}}, "spec.force.until"),
    ({"force": {"context": "nowhere", "until": date(2026, 11, 21)}}, "spec.force.until"),
    ({"force": {"context": "nowhere", "until": 10**30}}, "spec.force.until"),
    ({"force": {"context": "nowhere"}}, "spec.force.until"),
    ({"force": "soon"}, "spec.force"),
    ({"shadow": "robot"}, "spec.shadow"),
    ({"shadow": {}}, "spec.shadow.of"),
    ({"shadow": {"of": "robot"}}, "spec.shadow.of"),
    ({"shadow": {"of": "other", "tolerance": 1.5}}, "spec.shadow.tolerance"),
    ({"shadow": {"of": "other", "patience": "0s"}}, "spec.shadow.patience"),
    ({"shadow": {"of": "other", "health": "robot/health"}}, "spec.shadow.health"),
    ({"shadow": {"of": "other", "health": "robot/**"}}, "spec.shadow.health"),
    ({"shadow": {"of": "other", "misses": 1}}, "spec.shadow.misses"),
    ({"surprise": 1}, "spec.surprise"),
    ({"streams": {}}, "spec.streams"),
    ({"streams": ["imu"]}, "spec.streams[0]"),
    ({"streams": [a_stream(f"s{n}") for n in range(65)]}, "spec.streams"),
    ({"streams": [a_stream("imu"), a_stream("imu")]}, "spec.streams"),
    ({"tasks": []}, "spec.tasks"),
    ({"tasks": [a_task("slam"), a_task("slam")]}, "spec.tasks"),
    ({"contexts": [a_context("a", "true"), a_context("a", "true")]}, "spec.contexts"),
]
STREAM = [
    ({"name": "Imu"}, "name"),
    ({"name": "min"}, "name"),
    ({"name": None}, "name"),
    ({"name": 5}, "name"),
    ({"key": "/robot"}, "key"),
    ({"key": "x" * 257}, "key"),
    ({"encoding": "cdr"}, "type"),
    ({"type": "sensor_msgs/msg/Imu"}, "type"),
    ({"encoding": "cdr", "type": "Imu"}, "type"),
    ({"staleAfter": "0.5"}, "staleAfter"),
    ({"timestamp": "a..b"}, "timestamp"),
    ({"filter": "imu.ok &&"}, "filter"),
    ({"filter": "mic.ok"}, "filter"),
    ({"filter": ""}, "filter"),
    ({"filter": "heard(imu)"}, "filter"),
    ({"filter": "age(imu) > 1"}, "filter"),
    ({"filter": 5}, "filter"),
    ({"producedBy": "nobody"}, "producedBy"),
    ({"features": [{"name": "F", "op": "count", "over": "1s"}]}, "features[0].name"),
    ({"features": [{"name": "f", "over": "1s"}]}, "features[0].op"),
    ({"features": [{"name": "f", "op": "count"}]}, "features[0].over"),
    ({"features": [{"name": "f", "op": "count", "over": "0s"}]}, "features[0].over"),
    ({"features": [{"name": "f", "op": "mean", "over": "1s"}]}, "features[0].of"),
    ({"features": [{"name": "f", "op": "mean", "of": "mic.x", "over": "1s"}]}, "features[0].of"),
    ({"unit": "m/s"}, "unit"),
]
TASK = [
    ({"name": "Slam"}, "name"),
    ({"selector": None}, "selector"),
    ({"selector": {}}, "selector"),
    ({"selector": {"matchLabels": {"app": 5}}}, "selector.matchLabels.app"),
    ({"selector": {"matchLabels": []}}, "selector.matchLabels"),
    ({"selector": {"matchExpressions": [{"key": "a", "operator": "Like"}]}}, "selector.matchExpressions[0].operator"),
    ({"selector": {"app": "slam"}}, "selector.app"),
    ({"subtasks": ["slam"]}, "selector"),
    ({"container": ""}, "container"),
    ({"priority": -1}, "priority"),
    ({"priority": float("nan")}, "priority"),
    ({"priority": 10**400}, "priority"),
    ({"priority": True}, "priority"),
    ({"max": "1m"}, "max"),
    ({"min": 2, "max": 1}, "max"),
    ({"needs": {"gpu": 1}}, "needs.gpu"),
    ({"needs": {"cores": 1, "enforce": "Suspend"}, "protected": True}, "needs.enforce"),
    ({"satisfiedBy": "Some"}, "satisfiedBy"),
    ({"activity": [{"stream": "nowhere"}]}, "activity[0].stream"),
    ({"activity": [{"when": "nowhere.x"}]}, "activity[0].when"),
    ({"activity": [{"when": "median(imu.x) > 1.0"}]}, "activity[0].when"),
    ({"activity": [{"when": "x" * 1025}]}, "activity[0].when"),
    ({"activity": [{"scoreFrom": "nowhere.x"}]}, "activity[0].scoreFrom"),
    ({"activity": [{"scoreFrom": "1", "score": 1}]}, "activity[0].score"),
    ({"activity": [{"initiative": ""}]}, "activity[0].initiative"),
    ({"activity": [{"initiative": "x", "with": {"a": 1}}]}, "activity[0].with.a"),
    ({"activity": [None] * 17}, "activity"),
    ({"requires": [{"hold": "1s"}]}, "requires[0].when"),
    ({"requires": [{"when": "nowhere.x"}]}, "requires[0].when"),
    ({"nice": 5}, "nice"),
]
CONTEXT = [
    ({"name": "In Motion"}, "name"),
    ({"when": "imu.speed >"}, "when"),
    ({"when": "nowhere.x"}, "when"),
    ({"when": "heard(nowhere)"}, "when"),
    ({"when": "age(nowhere) > 1"}, "when"),
    ({"when": "age(imu) > imu.limit"}, "when"),
    ({"tasks": {"nobody": {"weight": 1}}}, "tasks"),
    ({"tasks": []}, "tasks"),
    ({"tasks": {"slam": {}}}, "tasks.slam"),
    ({"tasks": {"slam": {"weight": 1, "scale": 2}}}, "tasks.slam"),
    ({"tasks": {"slam": {"suspend": False}}}, "tasks.slam"),
    ({"tasks": {"slam": {"suspend": "yes"}}}, "tasks.slam.suspend"),
    ({"tasks": {"slam": {"suspend": 1}}}, "tasks.slam.suspend"),
    ({"tasks": {"slam": 5}}, "tasks.slam"),
    ({"tasks": {"slam": {"weight": 1, "until": "noon"}}}, "tasks.slam.until"),
    ({"colour": "red"}, "colour"),
]


def ids(cases):
    return [f"{field}-{number}" for number, (_, field) in enumerate(cases)]


@pytest.mark.parametrize(("spec", "field"), FIELDS, ids=ids(FIELDS))
def test_a_bad_field_of_the_policy_is_named(spec, field):
    assert field in refused(**spec)


@pytest.mark.parametrize(("stream", "field"), STREAM, ids=ids(STREAM))
def test_a_bad_field_of_a_stream_is_named(stream, field):
    assert f"spec.streams[0].{field}" in refused(streams=[a_stream("imu") | stream])


@pytest.mark.parametrize(("task", "field"), TASK, ids=ids(TASK))
def test_a_bad_field_of_a_task_is_named(task, field):
    assert f"spec.tasks[0].{field}" in refused(streams=[a_stream("imu")], tasks=[a_task("slam") | task])


@pytest.mark.parametrize(("context", "field"), CONTEXT, ids=ids(CONTEXT))
def test_a_bad_field_of_a_context_is_named(context, field):
    assert f"spec.contexts[0].{field}" in refused(streams=[a_stream("imu")], contexts=[a_context("moving") | context])


def a_chain(levels):
    """t1 is the parent of t2, and so on."""
    return [*(a_parent(f"t{at}", f"t{at + 1}") for at in range(1, levels)), a_task(f"t{levels}")]


def test_a_graph_of_eight_levels_is_accepted():
    assert len(a_policy(tasks=a_chain(8)).tasks) == 8


GRAPHS = [
    pytest.param([a_parent("p", "nobody")], "spec.tasks[0].subtasks[0]", id="unknown"),
    pytest.param([a_parent("p", "p")], "spec.tasks[0]", id="itself"),
    pytest.param([a_parent("p", "q"), a_parent("q", "p")], "spec.tasks[0]", id="cycle"),
    pytest.param(a_chain(9), "spec.tasks[8]", id="too deep"),
    pytest.param([a_parent("p", "a"), a_parent("q", "a"), a_task("a")], "spec.tasks[0].subtasks[0]", id="two parents"),
    pytest.param([a_parent("p", "a", "a"), a_task("a")], "spec.tasks[0].subtasks[1]", id="the same twice"),
    pytest.param([a_parent("p", *"abcdefghijklmnopq")], "spec.tasks[0].subtasks", id="too many"),
    pytest.param([{"name": "p", "subtasks": [5]}], "spec.tasks[0].subtasks[0]", id="no name"),
]


@pytest.mark.parametrize(("tasks", "field"), GRAPHS)
def test_a_graph_that_is_no_forest_is_refused(tasks, field):
    assert field in refused(tasks=tasks)


def needing(name, *required, **fields):
    return a_task(name, requires=[{"task": other} for other in required], **fields)


def reading(name, stream):
    return a_task(name, requires=[{"when": f"{stream}.done"}])


CYCLES = [
    pytest.param([needing("a", "b"), needing("b", "c"), needing("c", "a")], {}, "a -> b -> c -> a", id="tasks"),
    pytest.param([reading("a", "x"), reading("b", "y")], {"x": "b", "y": "a"}, "a -> b -> a", id="streams"),
    pytest.param([reading("a", "x")], {"x": "a"}, "a -> a", id="its own stream"),
    pytest.param([a_parent("p", "a"), needing("a", "p")], {}, "p -> a -> p", id="its parent"),
    pytest.param([a_parent("p", "a", "b"), a_task("a"), reading("b", "x")], {"x": "a"}, "p -> b -> p", id="compound"),
    pytest.param(
        [a_parent("p", "a"), a_task("a"), a_parent("q", "b"), needing("b", "a"), needing("c", "b")],
        {},
        None,
        id="none",
    ),
    pytest.param(
        [a_parent("p", "a", "b", satisfiedBy="Any"), a_task("a"), reading("b", "x")], {"x": "a"}, None, id="complex"
    ),
    pytest.param([a_parent("p", "a", "b"), a_task("a"), needing("b", "a")], {}, None, id="siblings"),
]


@pytest.mark.parametrize(("tasks", "producers", "cycle"), CYCLES)
def test_tasks_that_wait_for_each_other_are_refused_and_named(tasks, producers, cycle):
    streams = [a_stream(name, producedBy=task) for name, task in producers.items()]
    try:
        a_policy(streams=streams, tasks=tasks)
        found = []
    except PolicyError as error:
        found = [finding.value for finding in error.findings]
    assert (cycle in found) if cycle else not found


def test_a_cycle_says_why_each_task_waits():
    with pytest.raises(PolicyError) as caught:
        a_policy(streams=[a_stream("x", producedBy="b")], tasks=[reading("a", "x"), needing("b", "a")])
    assert str(caught.value.findings[0]).endswith(
        "no cycle in the task graph: a waits for b (it requires stream x of b), b waits for a (it requires task a)"
    )


def test_all_findings_come_at_once_in_one_readable_message():
    spec = {"mode": "On", "reserve": "lots", "tasks": [a_task("slam", priority=-1, activity=[{"when": "nowhere.x"}])]}
    with pytest.raises(PolicyError) as caught:
        parsing.parse(a_body(**spec))
    lines = str(caught.value).splitlines()
    assert lines[0] == "ContextPolicy lab/robot:"
    assert lines[1] == "  spec.mode: 'On' is not allowed: one of Enforce, DryRun, Paused"
    assert len(lines) == 5


def test_an_expression_that_may_run_away_is_refused_with_the_reason():
    source = "imu.l.map(a, imu.l.map(b, imu.l.map(c, c)))"
    value, allowed = refused(streams=[a_stream("imu")], contexts=[a_context("x", source)])["spec.contexts[0].when"]
    assert value == source
    assert "run away" in allowed


@pytest.mark.parametrize(
    "body",
    [
        {},
        {"spec": None},
        {"spec": []},
        {"spec": "x", "metadata": "y"},
        {"metadata": [], "spec": {}},
        {"metadata": {"name": 5, "namespace": {}}, "spec": {"tasks": [a_task("slam")]}},
        {"metadata": {"name": ""}, "spec": {"tasks": [a_task("slam")]}},
        {"metadata": {"name": "x"}, "spec": {5: 6, None: 7, "tasks": [{5: 6}]}},
        [],
        None,
        5,
    ],
    ids=repr,
)
def test_what_is_no_object_is_refused_not_a_crash(body):
    with pytest.raises(PolicyError):
        parsing.parse(body)
