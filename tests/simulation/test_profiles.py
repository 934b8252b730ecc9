from __future__ import annotations

import json
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from contextpolicy.simulation.profiles import Cost, ProfileError, load_profiles, parse_profiles
from robotkit.module import Input, Module, Needs
from robotkit.profile import Profile, Run
from robotkit.profiles import document, idle

SCHEMA = Draft202012Validator(
    json.loads((Path(__file__).parents[2] / "modules/robotkit/profiles.schema.json").read_text(encoding="utf-8"))
)
MS = 1_000_000


def measured(*, runs=10, came=0, waited=(0,)):
    """The document of robotkit for a task that used 20 ms of CPU for each input, in 10 ms.

    Before that, each was on its way for `came` ns, and waited for one of `waited` in turn.
    """
    module = Module("slam", inputs={"stereo": Input("robot/camera/stereo", depth=2)}, needs=Needs(deadline=0.1))
    profile = Profile(module)
    for index in range(runs):
        start = 10**18 + index * 10**8
        begun = start + came + waited[index % len(waited)]
        profile.inputs["stereo"].add(Run(start, start + came, begun, begun + 10 * MS, 20 * MS + index))
    return profile.as_json("slam", {"stereo": 0}, {"stereo": 0})


def test_robotkits_profiles_satisfy_parser_and_schema():
    body = document([measured()], datetime(2026, 11, 22, tzinfo=UTC))
    SCHEMA.validate(body)
    task = parse_profiles(body).tasks["slam"]
    (cost,) = task.inputs
    assert (task.deadline, cost.key, cost.depth) == (0.1, "robot/camera/stereo", 2)
    assert task.threads == pytest.approx(2.0)
    assert cost.work(0) == pytest.approx(0.02, abs=1e-6)


def test_the_rest_of_the_latency_is_transport_and_wakeup():
    waited = [MS, *[6 * MS] * 9]  # a tenth met an empty queue
    body = document([measured(runs=100, came=4 * MS, waited=waited)], datetime(2026, 11, 22, tzinfo=UTC))
    (cost,) = parse_profiles(body).tasks["slam"].inputs
    assert cost.transit == pytest.approx(0.005)


def test_a_task_that_did_nothing_has_no_cost_and_is_reported():
    body = document([measured(runs=0)], datetime(2026, 11, 22, tzinfo=UTC))
    SCHEMA.validate(body)
    assert parse_profiles(body).tasks["slam"].inputs == ()
    assert idle([measured(runs=0), measured()]) == ["slam"]


def test_unrequested_output_counts_as_background():
    produced = {"done": 100, "cpu": {"mean": 0.01, "quantiles": [0.01]}}
    body = {"tasks": {"imu": {"seconds": 10.0, "background": 0.02, "inputs": {}, "produced": produced}}}
    assert parse_profiles(body).tasks["imu"].background == pytest.approx(0.12)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=21).map(sorted))
def test_many_inputs_are_distributed_as_measured(quantiles):
    cost = Cost("k", 1, tuple(quantiles))
    drawn = sorted(cost.work(number) for number in range(2000))
    assert quantiles[0] <= drawn[0] <= drawn[-1] <= quantiles[-1]
    middle = (quantiles[(len(quantiles) - 1) // 2] + quantiles[len(quantiles) // 2]) / 2
    steps = [high - low for low, high in pairwise(quantiles)]
    assert drawn[1000] == pytest.approx(middle, abs=0.05 * max(steps, default=0) * len(quantiles) + 1e-9)


def test_all_mistakes_are_reported_at_once():
    bad = {
        "tasks": {"slam": {"deadline": -1, "inputs": {"a": {"key": "/x", "depth": 0, "cpu": {"quantiles": [2, 1]}}}}},
        "more": 1,
    }
    assert not SCHEMA.is_valid(bad)
    with pytest.raises(ProfileError) as error:
        parse_profiles(bad)
    assert [finding.field for finding in error.value.findings] == [
        "profiles.tasks.slam.inputs.a.key",
        "profiles.tasks.slam.inputs.a.depth",
        "profiles.tasks.slam.inputs.a.cpu.quantiles",
        "profiles.tasks.slam.deadline",
        "profiles.more",
    ]


@pytest.mark.parametrize("body", [None, [], {}, {"tasks": {}}, {"tasks": []}, {"tasks": {"a": 1}}])
def test_an_invalid_profile_is_refused(body):
    with pytest.raises(ProfileError):
        parse_profiles(body)


def test_a_file_that_cannot_be_read_is_reported(tmp_path):
    with pytest.raises(ProfileError, match=r"none\.json:\n  cannot read file: No such file or directory$"):
        load_profiles(str(tmp_path / "none.json"))
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")
    with pytest.raises(ProfileError, match=r"broken\.json:\n  not valid JSON: "):
        load_profiles(str(tmp_path / "broken.json"))
