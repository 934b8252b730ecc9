"""What `validate` refuses, against what the API server refuses: its schema, and the collection of refused policies."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jsonschema
import pytest
import yaml

from contextpolicy.policy.validation.check import CheckReport, _check_document, check
from contextpolicy.policy.validation.documents import Document, Position
from contextpolicy.policy.validation.problem import Severity

if TYPE_CHECKING:
    from collections.abc import Iterator

ROOT = Path(__file__).parents[3]
BAD = sorted((ROOT / "tests/e2e/bad_policies").glob("*.yaml"))
GOOD = sorted(p for p in (ROOT / "config/policies").glob("*.yaml"))
CRD = yaml.safe_load((ROOT / "crds/contextpolicies.contextpolicy.dev.yaml").read_text())
SCHEMA = CRD["spec"]["versions"][0]["schema"]["openAPIV3Schema"]

FULL = {
    "apiVersion": "contextpolicy.dev/v1alpha1",
    "kind": "ContextPolicy",
    "metadata": {"name": "full", "namespace": "robot"},
    "spec": {
        "mode": "Enforce",
        "enforcement": {
            "scheduler": "CFS",
            "control": "Limit",
            "transition": "Strict",
            "realtimeFallback": "CFS",
            "realtimePolicy": "FIFO",
            "period": "1s",
            "minDwell": "1s",
        },
        "reserve": "300m",
        "fallback": "moving",
        "force": {"context": "moving", "until": "2027-01-01T00:00:00Z"},
        "streams": [
            {
                "name": "imu",
                "key": "robot/imu",
                "encoding": "cdr",
                "type": "sensor_msgs/msg/Imu",
                "staleAfter": "1s",
                "liveliness": "robot/imu",
                "timestamp": "header.stamp",
                "filter": "imu.orientation.x > 1",
                "debounce": "10ms",
                "sampleEvery": "10ms",
                "producedBy": "camera",
                "example": {"orientation": {"x": 0.5}},
                "features": [{"name": "mean", "op": "mean", "of": "imu.orientation.x", "over": "1s"}],
            }
        ],
        "tasks": [
            {
                "name": "slam",
                "container": "slam",
                "priority": 1,
                "idle": 1,
                "min": "10m",
                "max": 2,
                "suspendedCpu": "50m",
                "restartOnResize": True,
                "selector": {
                    "matchLabels": {"app": "slam"},
                    "matchExpressions": [{"key": "tier", "operator": "In", "values": ["a"]}],
                },
                "needs": {"cores": 1, "memory": "100Mi", "deadline": "50ms", "enforce": "Suspend"},
                "activity": [
                    {"stream": "imu", "when": "imu.orientation.x > 1", "score": 1, "hold": "1s", "decay": "1s"},
                    {"stream": "imu", "scoreFrom": "imu.orientation.x", "initiative": "mine", "with": {"a": "b"}},
                ],
                "requires": [{"when": "imu.orientation.x > 1", "hold": "1s"}, {"task": "camera"}],
            },
            {"name": "camera", "selector": {"matchLabels": {"app": "camera"}}, "protected": True},
            {"name": "group", "subtasks": ["slam"], "satisfiedBy": "All"},
        ],
        "contexts": [
            {
                "name": "moving",
                "when": "imu.orientation.x > 1",
                "enterAfter": "1s",
                "exitAfter": "1s",
                "tasks": {"slam": {"weight": 1}, "group": {"suspend": True}},
            }
        ],
    },
}
WRONG: tuple[Any, ...] = (
    *(
        -1,
        0,
        0.5,
        1_000_001,
        10**12,
        True,
        "",
        " ",
        "x",
        "Upper",
        "-a",
        "a" * 64,
        "a" * 300,
        "1m30",
        "5x",
        "a//b",
        "1.2345",
    ),
    *([], ["x"], ["a"] * 200, {}, {"x": "y"}, {"x": 1}, [{}], "0s", "-5m", "1e3", "Ki", "2027-01-01", "a b", "é"),
)


def problems(body: Any) -> list[Any]:
    report = CheckReport()
    _check_document("policy.yaml", Document(body, {"": Position(1, 1)}), report)
    return report.errors


def without_nothing(body: Any) -> Any:
    """JSON Schema's view of the definition: int-or-string has a type, format and CEL rules are left to others."""
    if isinstance(body, dict):
        return {key: without_nothing(value) for key, value in body.items() if not key.startswith("x-")}
    return [without_nothing(item) for item in body] if isinstance(body, list) else body


VALIDATOR = jsonschema.Draft202012Validator(without_nothing(SCHEMA))


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of every value inside."""
    if path:
        yield path
    for key, inner in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from places(inner, (*path, key))


def changed(path: tuple[Any, ...], value: Any) -> Any:
    body = copy.deepcopy(FULL)
    inner: Any = body
    for key in path[:-1]:
        inner = inner[key]
    if value is KeyError:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return body


def test_the_full_example_is_valid() -> None:
    assert not list(VALIDATOR.iter_errors(FULL))
    assert not problems(FULL)


def _is_refused(body: Any) -> bool:
    """By the schema; what is no ContextPolicy at all is no policy to refuse."""
    return body.get("kind") == "ContextPolicy" and bool(list(VALIDATOR.iter_errors(body)))


@pytest.mark.parametrize("path", list(places(FULL)), ids=lambda p: ".".join(map(str, p)))
def test_everything_the_schema_refuses_is_refused(path: tuple[Any, ...]) -> None:
    accepted = [
        value
        for value in (*WRONG, KeyError)
        if _is_refused(changed(path, value)) and not problems(changed(path, value))
    ]
    assert accepted == []


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_everything_the_api_server_refuses_is_refused(path: Path) -> None:
    report = check([(path.name, path.read_text())])
    assert report.errors
    assert all(problem.position.line > 1 for problem in report.errors)


def test_enough_refused_policies_are_compared() -> None:
    assert len(BAD) >= 40


@pytest.mark.parametrize("path", GOOD, ids=lambda path: path.stem)
def test_samples_are_valid(path: Path) -> None:
    report = check([(path.name, path.read_text())])
    assert report.policies
    assert not report.errors


def test_all_findings_of_all_files_at_once() -> None:
    one = changed(("spec", "mode"), "Dryrun")
    one["spec"]["enforcement"]["minDwell"] = "soon"
    report = check([("one.yaml", yaml.safe_dump(one)), ("two.yaml", "a: [")])
    assert [(p.file, p.field) for p in report.errors] == [
        ("one.yaml", "spec.enforcement.minDwell"),
        ("one.yaml", "spec.mode"),
        ("two.yaml", ""),
    ]


def test_another_version_is_refused() -> None:
    assert [p.field for p in problems({**FULL, "apiVersion": "contextpolicy.dev/v1"})] == ["apiVersion"]


def test_items_of_a_list_are_checked() -> None:
    report = check([("list.yaml", yaml.safe_dump({"kind": "List", "items": [FULL, changed(("spec", "mode"), "x")]}))])
    assert [problem.field for problem in report.errors] == ["spec.mode"]
    assert report.errors[0].position.line > 10


def claimed(first: dict[str, Any], second: dict[str, Any], *, together: bool = True) -> list[Severity]:
    texts = [
        yaml.safe_dump(
            {
                "apiVersion": "contextpolicy.dev/v1alpha1",
                "kind": "ContextPolicy",
                "metadata": {"name": name},
                "spec": {
                    "streams": [{"name": "imu", "key": "imu"}],
                    "tasks": [
                        {"name": "slam", "selector": selector, "activity": [{"stream": "imu", "hold": "1s"}]},
                    ],
                },
            }
        )
        for name, selector in (("one", first), ("two", second))
    ]
    report = check(
        [("a.yaml", "---\n".join(texts))] if together else list(zip(("a.yaml", "b.yaml"), texts, strict=True))
    )
    return [problem.severity for problem in report.problems]


APP = {"matchLabels": {"app": "slam"}}
APP_TIER = {"matchLabels": {"app": "slam", "tier": "a"}}


def expression(operator: str, *values: str) -> dict[str, Any]:
    return {"matchExpressions": [{"key": "app", "operator": operator, **({"values": list(values)} if values else {})}]}


@pytest.mark.parametrize(
    ("first", "second", "severities"),
    [
        (APP, APP, [Severity.ERROR]),
        (APP, APP_TIER, [Severity.ERROR]),
        (APP, expression("In", "slam", "other"), [Severity.ERROR]),
        (APP, expression("Exists"), [Severity.ERROR]),
        (APP, expression("NotIn", "other"), [Severity.ERROR]),
        (APP, {"matchLabels": {"tier": "a"}}, [Severity.WARNING]),
        (expression("In", "a", "b"), expression("In", "b", "c"), [Severity.WARNING]),
        (APP, {"matchLabels": {"app": "other"}}, []),
        (APP, expression("NotIn", "slam"), []),
        (APP, expression("DoesNotExist"), []),
    ],
)
def test_two_policies_that_claim_one_container(
    first: dict[str, Any], second: dict[str, Any], severities: list[Severity]
) -> None:
    assert claimed(first, second) == severities


def test_two_files_may_be_alternatives() -> None:
    assert claimed(APP, APP, together=False) == [Severity.WARNING]


@pytest.mark.parametrize(
    ("path", "value", "field"),
    [
        (("spec", "tasks", 0, "max"), "500m", "spec.tasks[0].needs.cores"),
        (("spec", "tasks", 0, "activity", 0, "score"), 0, "spec.tasks[0].activity[0].score"),
        (("spec", "contexts", 0, "tasks"), {}, "spec.contexts[0]"),
        (("spec", "contexts", 0, "tasks"), {"slam": {"suspend": False}}, "spec.contexts[0].tasks.slam.suspend"),
    ],
)
def test_implausible_values_are_warnings(path: tuple[Any, ...], value: Any, field: str) -> None:
    report = check([("policy.yaml", yaml.safe_dump(changed(path, value)))])
    assert not report.errors
    assert field in [problem.field for problem in report.problems]


def test_contexts_that_try_to_suspend_a_protected_task_are_named():
    text = """
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: robot, namespace: lab}
spec:
  streams: [{name: imu, key: robot/imu}]
  tasks:
  - {name: drive, subtasks: [brake, slam]}
  - {name: brake, selector: {matchLabels: {app: brake}}, protected: true}
  - {name: slam, selector: {matchLabels: {app: slam}}}
  contexts:
  - {name: light, when: imu.light, exitAfter: 1s, tasks: {brake: {scale: 0.5}, slam: {suspend: true}}}
  - {name: own, when: imu.own, exitAfter: 1s, tasks: {brake: {weight: 0}}}
  - {name: above, when: imu.above, exitAfter: 1s, tasks: {drive: {suspend: true}}}
"""
    report = check([("policy.yaml", text)])
    assert [(p.severity, p.position.line, p.field, p.message) for p in report.problems] == [
        (
            Severity.WARNING,
            13,
            "spec.contexts[1].tasks.brake",
            "context own suspends brake: it has no effect on brake, which is protected",
        ),
        (
            Severity.WARNING,
            14,
            "spec.contexts[2].tasks.drive",
            "context above suspends drive, of which brake is a part: it has no effect on brake, which is protected",
        ),
    ]


def test_unbounded_restarts_are_reported():
    text = """
apiVersion: contextpolicy.dev/v1alpha1
kind: ContextPolicy
metadata: {name: p, namespace: robot}
spec:
  streams: [{name: imu, key: robot/imu}]
  tasks: [{name: slam, selector: {matchLabels: {app: slam}}, restartOnResize: true}]
  contexts: [{name: moving, when: imu.speed > 1, enterAfter: 1s, tasks: {slam: {weight: 2}}}]
"""
    [problem] = check([("policy.yaml", text)]).problems
    assert (problem.severity, problem.field) == (Severity.WARNING, "spec.tasks[0].restartOnResize")
    assert "minDwell bounds how often" in problem.message
    assert check([("policy.yaml", text.replace("spec:", "spec:\n  enforcement: {minDwell: 10s}"))]).problems == []
