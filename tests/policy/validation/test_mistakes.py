"""Policies that a newcomer writes, and what `validate` says to each."""

from __future__ import annotations

import copy
from typing import Any

import pytest
import yaml

from contextpolicy.policy.validation.check import check
from contextpolicy.policy.validation.problem import Severity

BASE = {
    "apiVersion": "contextpolicy.dev/v1alpha1",
    "kind": "ContextPolicy",
    "metadata": {"name": "p", "namespace": "robot"},
    "spec": {
        "streams": [
            {"name": "imu", "key": "robot/imu", "encoding": "cdr", "type": "sensor_msgs/msg/Imu", "staleAfter": "1s"},
            {"name": "mic", "key": "robot/mic"},
        ],
        "tasks": [
            {
                "name": "slam",
                "selector": {"matchLabels": {"app": "slam"}},
                "activity": [{"stream": "mic", "when": "imu.angular_velocity.x > 1"}],
            },
            {"name": "speech", "selector": {"matchLabels": {"app": "speech"}}},
            {"name": "group", "subtasks": ["speech"]},
        ],
        "contexts": [{"name": "moving", "when": "mic.level > 1", "enterAfter": "1s", "tasks": {"slam": {"weight": 1}}}],
    },
}
STREAM, TASK, CONTEXT = ("spec", "streams", 0), ("spec", "tasks", 0), ("spec", "contexts", 0)
WHEN = (*CONTEXT, "when")


def changed(*changes):
    body = copy.deepcopy(BASE)
    for path, value in changes:
        inner: Any = body
        for key in path[:-1]:
            inner = inner[key]
        inner[path[-1]] = value
    return body


def reported(*changes):
    """Field and message of each problem of the changed policy."""
    report = check([("p.yaml", yaml.safe_dump(changed(*changes)))])
    return [(problem.severity, problem.field, problem.message) for problem in report.problems]


def test_the_base_is_sound():
    assert reported() == []


@pytest.mark.parametrize("key", ["**/mic", "*/*/mic", "contextpolicy/robot/delivery/plan"])
def test_wildcards_and_plans_of_the_own_namespace_are_accepted(key):
    assert reported((("spec", "streams", 1, "key"), key)) == []


RMW = "0/imu/data/sensor_msgs::msg::dds_::Imu_"
HEARS_DECISIONS = "excludes what the operator publishes for other namespaces"
REFUSED = [
    pytest.param([(("spec", "streams", 1, "key"), "**")], HEARS_DECISIONS, id="everything"),
    pytest.param([(("spec", "streams", 1, "key"), "*/*/*/plan")], HEARS_DECISIONS, id="all plans"),
    pytest.param([(("spec", "streams", 1, "key"), "contextpolicy/lab/*/applied")], HEARS_DECISIONS, id="others"),
    pytest.param([(("spec", "streams", 1, "key"), "contextpolicy/agents/*/confirmed")], HEARS_DECISIONS, id="agents"),
    pytest.param([(("spec", "streams", 1, "key"), "**/confirmed")], HEARS_DECISIONS, id="agents among others"),
    pytest.param([((*TASK, "activity", 0, "when"), "imu.gyro > 1")], "imu has no field gyro", id="no such field"),
    pytest.param([((*STREAM, "timestamp"), "header.stampp")], "did you mean stamp?", id="timestamp misspelt"),
    pytest.param([((*STREAM, "filter"), "imu.header.seq > 1")], "imu.header has no field seq", id="inner field"),
    pytest.param([((*STREAM, "key"), f"{RMW}/*".replace("Imu", "Image"))], "sensor_msgs/msg/Image, the", id="key type"),
    pytest.param([((*STREAM, "key"), RMW)], f"{RMW}/*: rmw_zenoh ends a key with the type's hash", id="no hash"),
    pytest.param(
        [(("spec", "streams", 1, "key"), f"{RMW}/*")],
        "cdr, with type sensor_msgs/msg/Imu: the key is one of rmw_zenoh",
        id="no encoding",
    ),
    pytest.param([(WHEN, "1")], "true or false; this is a number", id="a number"),
    pytest.param([(WHEN, "mic > 5")], "such as 5, is read as mic.value", id="a stream as a number"),
    pytest.param([(WHEN, "mic == 5")], "such as 5, is read as mic.value", id="a stream beside a number"),
    pytest.param([(WHEN, "mic")], "such as 5, is read as mic.value", id="a stream as a condition"),
    pytest.param([(WHEN, "int('x') > 1")], "int('x') has no value", id="no number"),
    pytest.param(
        [(WHEN, "timestamp(mic.t).getHours('Europe/Berlin') > 1")], "no time zone, such as 'Europe/B", id="time zone"
    ),
    pytest.param([(WHEN, "abs(mic.x, 1) > 1")], "a call such as abs(imu.speed)", id="one argument too many"),
    pytest.param([(WHEN, "min() > 1")], "a call such as min(imu.speed, 2.0)", id="no argument"),
    pytest.param([(WHEN, "[1, 2].contains(mic.x)")], "for a list, write x in list", id="contains of a list"),
    pytest.param([(WHEN, "mic.list.contains(1)")], "for a list, write x in list", id="contains of maybe a list"),
    pytest.param([(WHEN, 'mic.word.matches("(")')], '"(" is not a valid regular expression', id="no pattern"),
    pytest.param([((*TASK, "activity", 0, "scoreFrom"), "mic.level > 1")], "a number; this is true or", id="score"),
    pytest.param([(("spec", "tasks", 2, "min"), "100m")], "a task with subtasks has no container", id="min of a group"),
    pytest.param([(("spec", "tasks", 2, "max"), 1)], "a task with subtasks has no container", id="max of a group"),
    pytest.param(
        [(("spec", "tasks", 2, "needs"), {"cores": 1})], "a task with subtasks has no container", id="needs of a group"
    ),
    pytest.param(
        [(("spec", "tasks", 2, "container"), "x")], "a task with subtasks has no container", id="container of a group"
    ),
    pytest.param([((*STREAM, "debounce"), "1s")], "a debounce below staleAfter, 1 s", id="debounce"),
    pytest.param([((*TASK, "min"), "11m"), ((*TASK, "max"), "19m")], "a multiple of 10m between", id="bounds"),
    pytest.param([((*TASK, "selector", "matchLabels"), {"a b": "x"})], "a label key: letters", id="label key"),
    pytest.param([((*TASK, "selector", "matchLabels"), {"app": "x/y"})], "a label value: letters", id="label value"),
    pytest.param([((*TASK, "piority"), 1)], "did you mean priority?", id="misspelt field"),
    pytest.param([(WHEN, "mik.level > 1")], "did you mean mic?", id="misspelt stream"),
    pytest.param([((*CONTEXT, "tasks"), {"slamm": {"weight": 1}})], "did you mean slam?", id="misspelt task"),
    pytest.param([((*TASK, "activity", 0, "stream"), "mick")], "did you mean mic?", id="misspelt stream name"),
    pytest.param([((*TASK, "min"), 0.5)], '"0.5"', id="a fraction without quotes"),
    pytest.param([((*TASK, "name"), "x" * 64)], "at most 63 lower-case letters", id="a long name"),
    pytest.param([(WHEN, "mic.level > 1 and mic.ok")], "in CEL, write && for and", id="and"),
    pytest.param([(WHEN, "mic.level > 99999999999999999999")], "write 99999999999999999999.0", id="a large number"),
    pytest.param([(WHEN, "mic.level = 1")], "in CEL, write == for equality", id="one equals sign"),
    pytest.param([(WHEN, "mic.level >")], "a CEL expression; it ends too early", id="half an expression"),
]


@pytest.mark.parametrize(("changes", "message"), REFUSED)
def test_mistakes_are_refused_with_a_correction(changes, message):
    problems = reported(*changes)
    assert any(severity is Severity.ERROR and message in words for severity, _, words in problems), problems
    assert all("expecting" not in words for _, _, words in problems), "no words of the parser's"


@pytest.mark.parametrize(
    "changes",
    [
        [((*TASK, "min"), "11m"), ((*TASK, "max"), "20m")],
        [((*TASK, "min"), "11m"), ((*TASK, "max"), "19m"), (("spec", "enforcement"), {"scheduler": "Realtime"})],
        [((*STREAM, "debounce"), "999ms")],
        [((*STREAM, "key"), f"{RMW}/*")],
        [((*STREAM, "key"), f"{RMW}/RIHS01_7d9a00ff")],
        [((*TASK, "selector", "matchLabels"), {"robot.example.com/app": "", "a": "A_b.c-d"})],
        [(WHEN, "mic.a == null || mic.b in [1, 2.0] && mic.c.exists(x, x.y > 1) ? true : size(mic.d) > 1")],
    ],
)
def test_plausible_values_are_not_refused(changes):
    assert reported(*changes) == []


def test_yaml_reads_y_as_true():
    text = yaml.safe_dump(BASE).replace("name: slam", "name: y").replace("slam: {weight", "x: {weight")
    (problem,) = [p for p in check([("p.yaml", text)]).errors if p.field == "spec.tasks[0].name"]
    assert problem.message.endswith("YAML reads y as true: put it in quotes")


@pytest.mark.parametrize(("word", "read"), [("y", "true"), ("N", "false"), ("off", "false"), ("Yes", "true")])
def test_yaml_reads_a_key_y_as_true(word, read):
    text = yaml.safe_dump(BASE).replace("slam: {weight", f"{word}: {{weight").replace("slam:", f"{word}:")
    problems = [p for p in check([("p.yaml", text)]).problems if f"the key {word} " in p.message]
    assert [(p.severity, p.message) for p in problems] == [
        (Severity.WARNING, f"YAML reads the key {word} as {read}: put it in quotes")
    ]
    assert problems[0].field == f"spec.contexts[0].tasks.{read}"


def test_a_label_and_an_example_may_not_mean_true_either():
    body = yaml.safe_dump(BASE).replace("app: slam", "y: slam")
    assert [p.message for p in check([("p.yaml", body)]).problems if "the key y" in p.message]


def test_quoted_keys_are_accepted():
    body = yaml.safe_dump(BASE).replace("app: slam", "'y': slam")
    assert [p.message for p in check([("p.yaml", body)]).problems if "the key" in p.message] == []


@pytest.mark.parametrize("when", ["true", "1 < 2"])
def test_a_constant_condition_does_not_change_with_samples(when):
    assert [words for _, _, words in reported((WHEN, when)) if "every sample" in words] == []


@pytest.mark.parametrize("change", [{"weight": -1}, {"scale": "much"}, {"weight": -1, "suspend": False}])
def test_a_bad_number_is_not_also_a_missing_one(change):
    problems = reported(((*WHEN[:-1], "tasks", "slam"), change))
    assert problems
    assert [words for _, _, words in problems if "exactly one of" in words] == []


def test_a_context_that_nothing_makes_hold_is_reported():
    assert [(severity, field) for severity, field, _ in reported((WHEN, "false"))] == [
        (Severity.WARNING, "spec.contexts[0]")
    ]
    assert reported((WHEN, "false"), (("spec", "fallback"), "moving")) == []


def test_refused_names_are_reported_once():
    """They were also reported as '' that appears twice, and suggested as ''."""
    problems = reported((("spec", "streams", 0, "name"), "theImu"), (("spec", "streams", 1, "name"), "theMic"))
    assert [field for _, field, _ in problems if field.startswith("spec.streams")] == [
        "spec.streams[0].name",
        "spec.streams[1].name",
    ]
    assert not [message for _, _, message in problems if "''" in message or "one of ," in message]


def test_two_policies_of_one_name():
    text, other = yaml.safe_dump(BASE), yaml.safe_dump(changed(((*TASK, "container"), "other")))
    together = check([("a.yaml", f"{text}---\n{other}")]).errors
    assert [(p.field, p.position.line > 20) for p in together] == [("metadata.name", True)]
    apart = [p for p in check([("a.yaml", text), ("b.yaml", other)]).problems if p.field == "metadata.name"]
    assert [(p.file, p.severity) for p in apart] == [("b.yaml", Severity.WARNING)]
    assert "robot/p is also defined at a.yaml:" in apart[0].message


EXAMPLE = ("spec", "streams", 1, "example")


@pytest.mark.parametrize(
    ("example", "when", "message"),
    [
        ({"level": 0.2}, "mic.levle > 1", "mic has no field levle: its example has level; did you mean level?"),
        ({"ok": True}, "mic.ok == 1", "mic.ok == 1 has true or false and a number: never equal"),
        (0.5, "mic.level > 1", "mic has no field level: its example, a plain value, has value"),
    ],
)
def test_an_example_lets_every_expression_be_checked(example, when, message):
    problems = reported((EXAMPLE, example), (WHEN, when))
    assert any(message in words for _, _, words in problems), problems


def test_has_says_that_not_every_sample_has_the_field():
    guarded = (WHEN, "has(mic.word) && mic.word == 'go' || mic.level > 1")
    assert reported((EXAMPLE, {"level": 1}), guarded) == []
    assert reported((EXAMPLE, {"level": 1}), (WHEN, "mic.word == 'go' || mic.level > 1")) != []
    imu = ((*TASK, "activity", 0, "when"), "has(imu.gyro) && imu.gyro > 1")
    assert any("imu has no field gyro" in words for _, _, words in reported(imu)), "a ROS type has its fields always"


@pytest.mark.parametrize("example", [{"level": 1}, {"level": 0.2, "more": None}, {"level": None}])
def test_an_example_that_fits_refuses_nothing(example):
    assert reported((EXAMPLE, example)) == []


def test_features_are_fields_too_but_not_for_the_stream_itself():
    feature = {"name": "peak", "op": "max", "of": "mic.level", "over": "1s"}
    features = (("spec", "streams", 1, "features"), [feature])
    assert reported((EXAMPLE, {"level": 1}), features, (WHEN, "mic.peak > 1")) == []
    filtered = (("spec", "streams", 1, "filter"), "mic.peak > 1")
    problems = reported((EXAMPLE, {"level": 1}), features, filtered, (WHEN, "mic.peak > 1"))
    assert [field for _, field, _ in problems] == ["spec.streams[1].filter"]
