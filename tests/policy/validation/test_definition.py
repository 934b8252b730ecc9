"""The resource definition against files: its schema in words, its rules evaluated."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
import yaml

from contextpolicy.errors import PolicyError
from contextpolicy.policy.parsing import parse
from contextpolicy.policy.validation import crd_rules, crd_schema
from contextpolicy.policy.validation.crd_words import PATTERNS
from tests.crds.schema import REFUSED, nodes, schema
from tests.policy.validation.test_check import FULL, changed, problems

if TYPE_CHECKING:
    from pathlib import Path

    from contextpolicy.errors import Finding

SPEC = [node for path, node in nodes(schema()) if path == "spec" or path.startswith("spec.")]
STATED = [rule for node in SPEC for rule in node.get("x-kubernetes-validations", ())]
RULES = [rule["rule"] for rule in STATED]
NAMING = {rule["message"].removeprefix("expected ") for rule in STATED if "messageExpression" in rule}
"""What the API server never says, as these rules name the value that is wrong."""
STREAM, TASK = ("spec", "streams", 0), ("spec", "tasks", 0)
_TASKS: Any = FULL["spec"]
GROUP = ("spec", "tasks", next(n for n, task in enumerate(_TASKS["tasks"]) if "subtasks" in task))


def broken(path: Path) -> list[Finding]:
    """What the rules find in a policy, whatever else is wrong with it."""
    stored = crd_schema.as_stored(yaml.safe_load(path.read_text(encoding="utf-8")), crd_schema.schema())
    return list(crd_rules.findings(stored, crd_schema.schema(), ()))


def violated(path: Path) -> set[str]:
    """The rules that a policy breaks."""
    stored = crd_schema.as_stored(yaml.safe_load(path.read_text(encoding="utf-8")), crd_schema.schema())
    found = {(finding.field, finding.allowed) for finding in broken(path)}
    rules = crd_rules.rules(stored, crd_schema.schema())
    return {rule.source for rule in rules if (rule.field, rule.allowed) in found}


def test_every_rule_is_evaluated() -> None:
    assert RULES
    assert set(RULES) - set().union(*map(violated, REFUSED)) == set()


def refused(path: Path) -> dict[str, str]:
    """What the parser expects in the fields that it refuses."""
    try:
        parse(yaml.safe_load(path.read_text(encoding="utf-8")))
    except PolicyError as error:
        return {finding.field: finding.allowed for finding in error.findings}
    return {}


def test_rules_and_parser_word_a_mistake_alike() -> None:
    """Where both find it in one field; what follows a semicolon is Zenoh's reason in the parser's words."""
    found = [(finding, refused(path).get(finding.field)) for path in REFUSED for finding in broken(path)]
    pairs = {
        (finding.allowed.partition(";")[0], parsers.partition(";")[0])
        for finding, parsers in found
        if parsers is not None and finding.allowed not in NAMING
    }
    assert [pair for pair in pairs if len(set(pair)) > 1] == []
    assert len(pairs) > 20


def test_every_pattern_has_words_and_is_anchored() -> None:
    """The API server looks for a match anywhere; what we ask of the whole text is the same only between ^ and $."""
    patterns = {node["pattern"] for node in SPEC if "pattern" in node}
    assert patterns <= PATTERNS.keys()
    alternatives = [part for pattern in patterns for part in re.split(r"\|(?=\^)", pattern)]
    assert [part for part in alternatives if not re.fullmatch(r"\^.*\$", part)] == []


def expected(path: tuple[Any, ...], value: Any) -> list[tuple[str, object, str | None]]:
    return [(problem.field, problem.value, problem.allowed) for problem in problems(changed(path, value))]


@pytest.mark.parametrize(
    ("path", "value", "allowed"),
    [
        ((*TASK, "min"), 0.5, 'a fraction in quotes ("0.5") or in thousandths (500m)'),
        ((*TASK, "container"), "slam\n", "lower-case letters, digits and '-', no '-' at either end"),
        ((*TASK, "priority"), 1e7, "a number from 0 to 1000000"),
        ((*STREAM, "minDwell"), "1s", "one of the fields "),
        ((*STREAM, "staleAfter"), "0s", "a duration above 0; omit it to keep a silent stream's last value forever"),
        ((*STREAM, "debounce"), "1m" * 17, "at most 32 characters"),
        (("spec", "force", "until"), "2027-01-01T00:00+01:00", "a date and time as in RFC 3339, such as"),
        ((*GROUP, "subtasks"), [], "either a selector (a task in containers) or subtasks (a group of tasks)"),
        (("spec", "streams"), [], "at least one stream"),
        (("speck",), {}, "one of the fields apiVersion, kind, metadata, spec, status"),
    ],
)
def test_findings_describe_what_is_allowed(path: tuple[Any, ...], value: Any, allowed: str) -> None:
    assert any(words is not None and words.startswith(allowed) for _, _, words in expected(path, value))


def test_a_missing_field_is_reported_where_it_belongs() -> None:
    assert expected((*STREAM, "features", 0, "over"), KeyError)[0][:2] == ("spec.streams[0].features[0].over", None)


def test_null_counts_as_absent() -> None:
    assert expected((*STREAM, "debounce"), None) == []


def test_a_duplicate_name_is_named() -> None:
    feature = {"name": "mean", "op": "mean", "of": "imu.orientation.x", "over": "1s"}
    assert expected((*STREAM, "features"), [feature] * 2) == [("spec.streams[0].features", "mean", "each name once")]


def test_an_overlong_list_reports_only_its_length() -> None:
    assert {field for field, _, _ in expected(("spec", "contexts"), ["x"] * 1000)} >= {"spec.contexts"}
    assert "spec.contexts[64]" not in {field for field, _, _ in expected(("spec", "contexts"), ["x"] * 1000)}


@pytest.mark.parametrize(
    ("expected", "findings"),
    [
        (set(), [("spec", {"a": 1}, "b must be larger")]),
        ({"other"}, [("spec", {"a": 1}, "b must be larger")]),
        ({"spec.c"}, []),
    ],
)
def test_a_rule_without_a_value_is_broken_unless_its_object_is(expected: set[str], findings: list[Any]) -> None:
    rule = {"rule": "self.a < self.b", "message": "b must be larger"}
    node = {"properties": {"spec": {"x-kubernetes-validations": [rule]}}}
    found = crd_rules.findings({"spec": {"a": 1}}, node, expected)
    assert [(finding.field, finding.value, finding.allowed) for finding in found] == findings


@pytest.mark.parametrize("needs", [{"enforce": "Report"}, {}, "x", None])
def test_a_rule_about_an_inner_field_quotes_its_value(needs: Any) -> None:
    rule = {"rule": "false", "message": "expected Suspend", "fieldPath": ".needs.enforce"}
    node = {"properties": {"spec": {"x-kubernetes-validations": [rule]}}}
    [found] = crd_rules.findings({"spec": {"needs": needs}}, node, ())
    value = "Report" if needs == {"enforce": "Report"} else None
    assert (found.field, found.value, found.allowed) == ("spec.needs.enforce", value, "Suspend")


def test_rules_about_an_invalid_field_add_no_finding() -> None:
    assert [field for field, _, _ in expected((*TASK, "max"), "much")] == ["spec.tasks[0].max"]


def test_an_invalid_ros_type_is_reported_once() -> None:
    assert [field for field, _, _ in expected((*STREAM, "type"), "Imu")] == ["spec.streams[0].type"]


def test_rules_about_other_fields_are_reported_at_once() -> None:
    body = changed((*STREAM, "debounce"), "soon")
    body["spec"]["streams"][0]["staleAfter"] = "0s"
    assert [problem.field for problem in problems(body)] == ["spec.streams[0].debounce", "spec.streams[0].staleAfter"]
