"""Each bad field is refused by its name, with what was expected."""

from __future__ import annotations

from datetime import date

import pytest

from contextpolicy.errors import Finding, PolicyError
from contextpolicy.policy import parsing
from tests.planning.builders import a_context, a_stream, a_task
from tests.policy.parsing import refused

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
    ({"activity": [{"until": "nowhere.x"}]}, "activity[0].until"),
    ({"activity": [{"until": "imu.x >"}]}, "activity[0].until"),
    ({"activity": [{"until": "imu.x", "initiative": "x"}]}, "activity[0].until"),
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
    ({"until": "imu.speed > 1"}, "when"),
    ({"when": "imu.slow", "until": "nowhere.x"}, "until"),
    ({"when": "imu.slow", "until": 5}, "until"),
    ({"when": "age(nowhere) > 1"}, "when"),
    ({"when": "age(imu) > imu.limit"}, "when"),
    ({"tasks": {"nobody": {"weight": 1}}}, "tasks"),
    ({"tasks": []}, "tasks"),
    ({"tasks": {"slam": {}}}, "tasks.slam"),
    ({"tasks": {"slam": {"weight": 1, "scale": 2}}}, "tasks.slam"),
    ({"tasks": {"slam": {"suspend": False, "weight": 0}}}, "tasks.slam.suspend"),
    ({"tasks": {"slam": {"suspend": True, "weight": 3}}}, "tasks.slam"),
    ({"tasks": {"slam": {"suspend": "yes"}}}, "tasks.slam.suspend"),
    ({"tasks": {"slam": {"suspend": 1}}}, "tasks.slam.suspend"),
    ({"tasks": {"slam": {"max": "5m"}}}, "tasks.slam.max"),
    ({"tasks": {"slam": {"max": "much"}}}, "tasks.slam.max"),
    ({"tasks": {"slam": {"min": 2, "max": 1}}}, "tasks.slam.max"),
    ({"tasks": {"slam": {"suspend": True, "max": 1}}}, "tasks.slam"),
    ({"tasks": {"slam": {"scale": 0, "max": 1}}}, "tasks.slam"),
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


@pytest.mark.parametrize("number", ["1e400", "1.5E+309", "9" * 400])
def test_a_number_of_an_expression_beyond_all_doubles_is_refused_by_name(number):
    for source in (f"imu.x > {number}", f"imu.x < -{number}", f"age(imu) > {number}", f"imu.l[{number}] > 1"):
        contexts = [a_context("x", source)]
        value, allowed = refused(streams=[a_stream("imu")], contexts=contexts)["spec.contexts[0].when"]
        assert value == source
        assert allowed == f"a CEL expression; it has the number {number}, expected one of at most 1.8e+308"


@pytest.mark.parametrize("number", [float("inf"), 10**400, 2_000_000, -1, float("nan")])
def test_a_number_out_of_range_is_refused(number):
    value, allowed = refused(tasks=[a_task("slam", priority=number)])["spec.tasks[0].priority"]
    assert value is number
    assert allowed == "a number from 0 to 1000000"


def test_changes_that_exclude_each_other_are_quoted_as_written():
    context = a_context("x", "true", tasks={"slam": {"suspend": True, "weight": 3}})
    value, _ = refused(contexts=[context])["spec.contexts[0].tasks.slam"]
    assert value == {"weight": 3, "suspend": True}


def test_words_and_numbers_that_exclude_each_other_are_quoted_as_written():
    activity = [{"score": 1, "scoreFrom": "1"}]
    task = a_task("slam", protected=True, needs={"cores": 1, "enforce": "Suspend"}, activity=activity)
    found = refused(tasks=[task])
    assert repr(found["spec.tasks[0].needs.enforce"][0]) == "'Suspend'"
    assert repr(found["spec.tasks[0].activity[0].score"][0]) == "1"


def test_a_name_is_refused_where_none_is_declared():
    assert refused(fallback="moving")["spec.fallback"] == ("moving", "no name, as none are declared")


def test_the_only_name_declared_is_expected_once_without_a_guess():
    """`expected one of imu; did you mean imu?` says it twice."""
    found = refused(tasks=[a_task("slam")], contexts=[a_context("x", "true", tasks={"slan": {"weight": 1}})])
    assert found["spec.contexts[0].tasks"] == ("slan", "slam")


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (True, "true"),
        ({"weight": 1, "suspend": True}, '{"weight": 1, "suspend": true}'),
        (["a", False], '["a", false]'),
        ({date(2026, 1, 1): 1}, "{datetime.date(2026, 1, 1): 1}"),
        ("banana", "'banana'"),
        (float("inf"), "inf"),
    ],
)
def test_a_refused_value_is_shown_as_yaml_has_it(value, shown):
    """Keys that JSON does not know stay as Python has them."""
    assert Finding("spec", value, "else").problem() == f"invalid value {shown}: expected else"


@pytest.mark.parametrize(
    ("bounds", "allowed"),
    [
        ({"max": "5m"}, "at least 10m, the least that Linux can give to a container"),
        ({"min": 2, "max": "500m"}, "at least min, 2"),
    ],
)
def test_a_max_that_is_too_low_is_compared_with_what_it_is_below(bounds, allowed):
    assert refused(tasks=[a_task("slam", **bounds)])["spec.tasks[0].max"] == (bounds["max"], allowed)


def test_a_type_that_is_refused_is_quoted_as_written():
    value, _ = refused(streams=[a_stream("imu", type="foo")])["spec.streams[0].type"]
    assert value == "foo"


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
def test_a_value_that_is_not_an_object_is_refused(body):
    with pytest.raises(PolicyError):
        parsing.parse(body)


def test_a_selector_with_an_unknown_field_is_not_called_empty_too():
    found = refused(tasks=[{"name": "slam", "selector": {"app": "slam"}}])
    assert list(found) == ["spec.tasks[0].selector.app"]


def test_a_name_that_is_declared_twice_is_offered_once():
    found = refused(tasks=[a_task("slam"), a_task("slam")], contexts=[a_context("x", "true", tasks={"speech": {}})])
    _, allowed = found["spec.contexts[0].tasks"]
    assert allowed == "slam"


@pytest.mark.parametrize(("tasks", "allowed"), [({}, "a list"), ([], "at least one task"), (None, "at least one task")])
def test_tasks_that_hold_none_are_one_mistake(tasks, allowed):
    with pytest.raises(PolicyError) as caught:
        parsing.parse({"metadata": {"name": "robot", "namespace": "lab"}, "spec": {"streams": [], "tasks": tasks}})
    assert [found.allowed for found in caught.value.findings if found.field == "spec.tasks"] == [allowed]
