"""The policies of Nav2: a server whose heartbeat stops makes its lifecycle manager shut down all of Nav2."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from contextpolicy.policy.validation.check import check

CONFIG = Path(__file__).parents[2] / "config"
POLICIES = sorted((CONFIG / "policies").glob("nav2-*.yaml"))


def managed(policy):
    """The tasks that a lifecycle manager watches: Nav2's servers, and slam_toolbox."""
    labels = {task["name"]: task["selector"]["matchLabels"]["app"] for task in policy["spec"]["tasks"]}
    return {name for name, app in labels.items() if app.startswith("nav2-") or app == "slam-toolbox"}


def loaded(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def test_there_are_policies_of_nav2():
    assert [path.stem for path in POLICIES] == ["nav2-robot", "nav2-slam"]


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_no_context_suspends_what_a_lifecycle_manager_watches(path):
    policy = loaded(path)
    for context in policy["spec"]["contexts"]:
        for name in managed(policy) & context["tasks"].keys():
            change = context["tasks"][name]
            assert not change.get("suspend"), (context["name"], name)
            assert 0 not in (change.get("weight"), change.get("scale")), (context["name"], name)


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_what_a_lifecycle_manager_watches_is_protected_and_has_cpu_for_its_heartbeat(path):
    policy = loaded(path)
    watched = [task for task in policy["spec"]["tasks"] if task["name"] in managed(policy)]
    assert len(watched) == 3
    assert [task["name"] for task in watched if not (task.get("protected") and "min" in task)] == []


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_no_watched_server_is_expected_to_be_suspended(path):
    watched = managed(loaded(path))
    for expected in loaded(CONFIG / "expectations" / path.name):
        assert not watched & set(expected.get("suspended", ())), expected


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_validate_reports_a_suspension_of_one(path):
    text = path.read_text(encoding="utf-8").replace("perception: {suspend: true}", "controller: {suspend: true}")
    found = [str(problem) for problem in check([(path.name, text)]).problems]
    assert any("suspends controller" in problem and "protected" in problem for problem in found)
