"""A shadow on the command line: shown, promoted and adopted, on a small API server and an operator's live page."""

from __future__ import annotations

import json

import pytest

from contextpolicy import cli
from contextpolicy.commands.adopt import adopted
from tests.commands import test_on_the_cluster as small
from tests.policies.builders import a_policy
from tests.policies.test_promotion import a_shadow, misses

cluster, operator = small.cluster, small.operator
PROFILES = {
    "tasks": {
        name: {
            "deadline": 0.1,
            "seconds": 10.0,
            "inputs": {
                "pictures": {
                    "key": "robot/camera",
                    "depth": 1,
                    "done": 100,
                    "dropped": 0,
                    "cpu": {"mean": 0.06, "quantiles": [0.06, 0.06]},
                    "service": {"mean": 0.06},
                }
            },
        }
        for name in ("slam", "speech")
    }
}
"""Ten pictures a second of 60 ms each: 0.6 cores."""


@pytest.fixture(autouse=True)
def beside(operator, cluster):
    """The shadow of a robot that moves, for half a minute."""
    operator.loop.inline = False
    operator.apply(a_shadow())
    misses(operator, 30, 0.02)
    cluster.others = {"robot-next": {**a_shadow(), "status": operator.cluster.statuses["lab/robot-next"]}}
    cluster.policy = {**a_policy(), "status": operator.cluster.statuses["lab/robot"]}
    operator.loop.inline = True
    return operator


def shown(capsys, *more):
    assert cli.main(["shadow", "robot-next", *more]) == 0
    return capsys.readouterr().out


def test_shadow_shows_the_differences(capsys):
    first, *rest = shown(capsys).splitlines()
    assert first.startswith("lab/robot-next beside lab/robot, ")
    assert first.endswith("other shares 100% of the time")
    text = "\n".join(rest)
    assert "slam    800m -> 500m" in text
    assert "moving" in text
    assert "slam 800m -> 500m, speech 200m -> 500m" in text


@pytest.mark.parametrize("columns", [40, 80])
def test_it_fits_the_terminal(capsys, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    assert [line for line in shown(capsys).splitlines() if len(line) > columns] == []


def test_as_fields(capsys):
    reported = json.loads(shown(capsys, "--output", "json"))
    assert (reported["differs"], reported["promoted"], reported["reverted"]) == (1.0, False, None)
    assert reported["tasks"]["slam"]["share"] == [0.8, 0.5]
    assert reported["tasks"]["slam"]["predictedMisses"] == [None, None]


def test_with_profiles_it_predicts_the_misses_of_both(capsys, tmp_path):
    """Slam needs 0.6 cores: 0.8 are enough, 0.5 are not; speech has too little in either case."""
    path = tmp_path / "profiles.json"
    path.write_text(json.dumps(PROFILES))
    reported = json.loads(shown(capsys, "--profiles", str(path), "--output", "json"))
    before, after = reported["tasks"]["slam"]["predictedMisses"]
    assert before < 0.2
    assert after > 0.5
    assert min(reported["tasks"]["speech"]["predictedMisses"]) > 0.5


def test_promote_sets_enforce_mode(cluster, capsys):
    assert cli.main(["promote", "robot-next"]) == 0
    assert cluster.patches == [(f"{small.POLICIES}/robot-next", {"spec": {"mode": "Enforce"}})]
    assert capsys.readouterr().out == "lab/robot-next: DryRun -> Enforce\n"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["promote", "robot"], "lab/robot is not a shadow: it has no spec.shadow"),
        (["shadow", "robot"], "lab/robot is not a shadow: it has no spec.shadow"),
        (["adopt", "robot"], "lab/robot is not a shadow: it has no spec.shadow"),
        (["resume", "robot-next"], "lab/robot-next is a shadow: use `promote` to carry it out"),
        (["adopt", "robot-next"], "lab/robot-next is not in force: `promote` it first, and watch it for a while"),
    ],
)
def test_invalid_input_changes_nothing(cluster, capsys, command, message):
    assert cli.main(command) == 2
    assert message in capsys.readouterr().err
    assert cluster.patches == []


def test_promoted_shadow_is_adopted_as_the_policy(cluster):
    cluster.policy["status"]["promotedShadow"] = "robot-next"
    assert cli.main(["adopt", "robot-next"]) == 0
    [(path, patch), deleted] = cluster.patches
    assert path == f"{small.POLICIES}/robot"
    assert patch["spec"]["contexts"] == a_shadow()["spec"]["contexts"]
    assert patch["spec"].keys().isdisjoint({"shadow", "mode", "force"})
    assert deleted == (f"{small.POLICIES}/robot-next", None)


def test_adopting_removes_fields_the_shadow_lacks():
    before = {"mode": "Enforce", "minDwell": "1s", "streams": [1], "force": {"context": "moving"}}
    after = {"mode": "Enforce", "streams": [2], "shadow": {"of": "robot"}, "reserve": "100m"}
    assert adopted(before, after) == {"minDwell": None, "streams": [2], "reserve": "100m"}


def test_status_names_the_shadowed_policy(capsys):
    cli.main(["status", "robot-next"])
    assert "  shadow of robot, would change: slam 800m -> 500m, speech 200m -> 500m\n" in capsys.readouterr().out
