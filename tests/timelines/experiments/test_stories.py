"""The stories: what is held out is frozen, and what matters in each context is what the policy says."""

from __future__ import annotations

import hashlib
from itertools import pairwise

import pytest
import yaml

from contextpolicy.policy.quantities import parse_cpu
from contextpolicy.policy.validation.policy_file import load_policy
from contextpolicy.simulation.robot import NODE, Robot
from contextpolicy.simulation.run import simulate
from contextpolicy.streams.timeline import parse
from timelines.experiments.capacity import Capacity
from timelines.experiments.due import windows
from timelines.experiments.schedules import without_delays
from timelines.experiments.stories import CRITICAL, HELD_OUT, PAPER, PROTECTED, SCENARIOS, STORIES, TUNING
from timelines.scenarios.inputs import timeline
from timelines.scenarios.scenario import load, shipped

FROZEN = {
    "library": "cff05902c89928ef1b1806091d0e8824b94f293f159877516e01098838ccadc4",
    "hotel": "08537d21c220b7ec7710313db1ee721b2baff99be49776dec0e0ab80bf07daea",
}
OWN = (*TUNING, *HELD_OUT)


def scenario(story):
    return load(SCENARIOS / f"{story.name}.yaml")


@pytest.mark.parametrize("story", HELD_OUT, ids=lambda story: story.name)
def test_a_held_out_story_is_as_it_was_frozen(story):
    text = (SCENARIOS / f"{story.name}.yaml").read_bytes()
    assert hashlib.sha256(text).hexdigest() == FROZEN[story.name]
    assert text.startswith(b"# HELD OUT")


def test_every_scenario_is_a_story_and_the_papers_are_its_own():
    assert {path.stem for path in SCENARIOS.glob("*.yaml")} == {story.name for story in OWN}
    assert {story.name: story.seconds for story in PAPER} == {one.name: one.duration for one in shipped().values()}


@pytest.mark.parametrize("story", OWN, ids=lambda story: story.name)
def test_stories_have_their_stated_length_and_sensor_rates(story):
    found = scenario(story)
    assert (found.name, found.duration) == (story.name, story.seconds)
    assert (found.camera_rate, found.side_rate) == (20, 1)
    rates = {entry.key: entry.dataset_rate for entry in parse(timeline(found)).entries if entry.dataset}
    assert rates == {
        "robot/camera/stereo": 20, "robot/camera/side": 1, "robot/camera/left": 1,
        "robot/microphone": 10, "robot/imu/raw": 200,
    }  # fmt: skip


@pytest.mark.parametrize("story", OWN, ids=lambda story: story.name)
def test_importance_moves_with_the_mission(story):
    found = scenario(story)
    told = parse(timeline(found))
    plans = simulate(without_delays(load_policy(str(story.policy_file))), told, robot=Robot({NODE: 2000})).plans
    held = [window.contexts for window in windows(plans, told.duration) if window.contexts]
    assert held == [(phase.does,) for phase in found.phases]
    assert len(set(held)) >= 2


def test_a_picture_in_hand_is_finished_whatever_comes_next():
    """It keeps its weight for a second, and the pause of the next context waits so long; what is due is as before."""
    phases = ((0, 8, "read"), (8, 12, "talk"))
    entries = [
        {"key": "robot/mission", "encoding": "json", "from": begin, "to": end, "rate": 10, "value": {"does": does}}
        for begin, end, does in phases
    ]
    told = parse({"name": "two", "duration": 12, "phases": [], "inputs": entries})

    def held(policy):
        return windows(simulate(policy, told, robot=Robot({NODE: 2000})).plans, 12)

    policy = load_policy(str(HELD_OUT[0].policy_file))
    reads, both, talks = held(policy)
    assert (reads.contexts, both.contexts, talks.contexts) == (("read",), ("talk", "read"), ("talk",))
    assert both.end - both.begin == pytest.approx(1.0, abs=0.2)
    assert ("signs" in both.suspended, "signs" in talks.suspended) == (False, True)
    assert [window.contexts for window in held(without_delays(policy))] == [("read",), ("talk",)]


def test_the_held_out_stories_have_every_context():
    for story in HELD_OUT:
        assert {phase.does for phase in scenario(story).phases} == {"drive", "talk", "read", "grip"}


@pytest.mark.parametrize("story", [HELD_OUT[0], PAPER[0]], ids=lambda story: story.policy)
def test_the_critical_task_is_the_one_of_the_highest_weight(story):
    spec = yaml.safe_load(story.policy_file.read_text(encoding="utf-8"))["spec"]
    for context in spec["contexts"]:
        weights = {task: change.get("weight", 0) for task, change in context["tasks"].items()}
        if context["name"] in CRITICAL:
            assert max(weights, key=lambda task: weights[task]) == CRITICAL[context["name"]]
            assert not context["tasks"][CRITICAL[context["name"]]].get("suspend")
    assert {task["name"] for task in spec["tasks"] if task.get("protected")} == set(PROTECTED)


@pytest.mark.parametrize(("story", "part"), [(HELD_OUT[0], 0.8), (PAPER[0], 0.25)], ids=["mission", "paper"])
def test_most_of_a_slow_processor_is_left_to_what_moves(story, part):
    """Floors that take up a load's capacity would leave nothing to contexts: they are of what is needed, with room."""
    spec = yaml.safe_load(story.policy_file.read_text(encoding="utf-8"))["spec"]
    left = 2000 - parse_cpu(Capacity(1, part).reserve(2, 1.0))
    assert sum(parse_cpu(task.get("min", "0")) for task in spec["tasks"]) <= left / 2


def test_nothing_is_tuned_on_what_is_held_out():
    assert not {story.name for story in TUNING} & {story.name for story in HELD_OUT}
    assert len(STORIES) == len(TUNING) + len(HELD_OUT) + len(PAPER)


@pytest.mark.parametrize("story", OWN, ids=lambda story: story.name)
def test_a_lidar_turns_about_evenly(story):
    """Two scans at once were one too many for a queue of one, under every division."""
    entries = [entry for entry in parse(timeline(scenario(story))).entries if entry.key == "robot/lidar/scan"]
    times = [one.at for entry in entries for one in entry.inputs()]
    assert min(after - before for before, after in pairwise(times)) > 0.04
