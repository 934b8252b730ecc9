from __future__ import annotations

from pathlib import Path

import pytest

from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.comparison import differences
from contextpolicy.simulation.expectations import ExpectationError, parse
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams import timeline

ROOT = Path(__file__).parents[2]
POLICY = load_policy(str(ROOT / "config/policies/delivery-robot.yaml"))
PLANS = simulate(POLICY, timeline.load(ROOT / "timelines/demo.json"), robot=Robot({NODE: 2000})).plans


def compare(text: str) -> list[str]:
    return [d.message for d in differences(PLANS, parse(text, POLICY, subject="test"))]


@pytest.mark.parametrize(
    "text",
    [
        "- {at: 12, contexts: [moving], suspended: [speech], shares: {speech: 10m, slam: {min: 1500m}}}",
        "- {from: 11, to: 20, contexts: [moving], weights: {slam: 10, speech: {max: 0}}, feasible: true}",
        "- {from: 0, to: 30, plans: {max: 10}}",
        "expect:\n- {at: 12, shares: {slam: {min: 1500m, max: '2'}}}",
        '[{"at": 12, "contexts": ["moving"]}]',
    ],
)
def test_met_expectations_give_no_difference(text: str) -> None:
    assert compare(text) == []


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ("- {at: 12, contexts: []}", ["contexts: expected none, but moving"]),
        ("- {at: 12, suspended: []}", ["suspended: expected none, but speech"]),
        ("- {at: 12, shares: {slam: {max: 1}}}", ["share of slam: expected at most 1000m, but 1690m"]),
        ("- {at: 12, shares: {slam: 1700m}}", ["share of slam: expected 1700m, but 1690m"]),
        ("- {at: 12, weights: {slam: {min: 11, max: 12}}}", ["weight of slam: expected 11 to 12, but 10"]),
        ("- {at: 12, weights: {slam: 10.0000001}}", ["weight of slam: expected 10.0000001, but 10"]),
        ("- {at: 12, feasible: false}", ["feasible: expected false, but there are no shortfalls"]),
        ("- {from: 12, to: 22, contexts: [moving]}", ["contexts: expected moving, but none"]),
        ("- {from: 11, to: 20, plans: 1}", ["expected 1 plans, but 0 began"]),
    ],
)
def test_differences_state_expected_and_actual(text: str, messages: list[str]) -> None:
    assert compare(text) == messages


def test_a_difference_names_line_time_and_the_plan_in_force() -> None:
    (difference,) = differences(PLANS, parse("# why\n- {at: 12, contexts: []}", POLICY, subject="test"))
    assert str(difference) == (
        "line 2, at 12 s: contexts: expected none, but moving\n"
        "    plan 5 of 10.100 s, caused by imu: context moving entered"
    )


@pytest.mark.parametrize(
    ("text", "field"),
    [
        ("- {contexts: []}", "[0]"),
        ("- {at: 1, from: 2, to: 3, contexts: []}", "[0]"),
        ("- {from: 3, to: 2, contexts: []}", "[0].to"),
        ("- {at: -1, contexts: []}", "[0]"),
        ("- {at: .inf, contexts: []}", "[0]"),
        ("- {at: 1, contexts: [], context: [moving]}", "[0].context"),
        ("- {at: 1, contexts: [driving]}", "[0].contexts"),
        ("- {at: 1, shares: {slamm: 1}}", "[0].shares"),
        ("- {at: 1, shares: {slam: many}}", "[0].shares.slam"),
        ("- {at: 1, shares: {slam: {atleast: 1}}}", "[0].shares.slam"),
        ("- {at: 1, feasible: 3}", "[0].feasible"),
        ("- 12", "[0]"),
        ("expect: []", "expect"),
        ("- {at: 1}", "[0]"),
        ("- {from: 1, to: 2, plans: }", "[0].plans"),
        ("- {at: 1, plans: 1}", "[0].plans"),
        ("- {at: 1, shares: {}}", "[0].shares"),
        ("- {at: 1, shares: {slam: {min: 2, max: 1}}}", "[0].shares.slam"),
        ("- {at: 1, contexts: [], contexts: [moving]}", "[0].contexts"),
        ("- {at: 1, contexts: []}\n---\n- {at: 2, contexts: [moving]}", "line 3"),
        ("expect: [{at: 1, contexts: []}]\nexpected: []", "expected"),
        ("", "file"),
        ("[", "line 1"),
    ],
)
def test_an_invalid_file_is_refused_with_the_field(text: str, field: str) -> None:
    with pytest.raises(ExpectationError) as caught:
        parse(text, POLICY, subject="test")
    assert [finding.field for finding in caught.value.findings] == [field]


def test_yaml_that_cannot_be_read_is_reported_with_its_line() -> None:
    with pytest.raises(ExpectationError, match=r"^mine\.yaml:\n  line 2: not valid YAML: "):
        parse("- {at: 1}\n[", POLICY, subject="mine.yaml")


def test_a_misspelt_name_is_answered_with_the_one_that_is_meant() -> None:
    with pytest.raises(ExpectationError, match="did you mean suspended") as caught:
        parse("- {at: 1, suspendet: [], shares: {slamm: 1}}", POLICY, subject="test")
    assert "did you mean slam?" in str(caught.value)


def test_a_group_has_no_share_to_expect() -> None:
    patrol = load_policy(str(ROOT / "config/policies/patrol-robot.yaml"))
    with pytest.raises(ExpectationError) as caught:
        parse("- {at: 1, shares: {dialogue: 0}, weights: {dialogue: 0}}", patrol, subject="test")
    assert [finding.field for finding in caught.value.findings] == ["[0].shares"]
