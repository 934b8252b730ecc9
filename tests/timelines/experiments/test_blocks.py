"""What is run, in which order, and how long the rest takes."""

from __future__ import annotations

from collections import Counter

from timelines.experiments.blocks import HEAVY, LIGHT, PLAN, START, part_of, seconds_left, trials
from timelines.experiments.configurations import ALONE, FACTORS, LINUX
from timelines.experiments.goals import GOALS
from timelines.experiments.stories import HELD_OUT, Use
from timelines.experiments.tasks import tasks_of

ALL = list(trials())


def test_every_block_has_every_configuration_once_per_story():
    for number, part in enumerate(PLAN):
        for block in range(part.blocks):
            cells = Counter((one.story, one.configuration) for one in ALL if (one.part, one.block) == (number, block))
            assert cells == Counter({(story, own): 1 for story in part.stories for own in part.configurations})


def test_blocks_have_orders_of_their_own_and_always_the_same_ones():
    assert list(trials()) == ALL
    orders = [
        [(one.story.name, one.configuration.name) for one in ALL if (one.part, one.block) == (1, block)]
        for block in range(10)
    ]
    assert len({tuple(order) for order in orders}) == 10


def test_nothing_is_reported_of_what_was_tuned_on():
    assert all(one.story.use is not Use.TUNING for one in ALL)
    assert {story.name for story in HELD_OUT} <= {one.story.name for one in ALL}


def test_a_quick_look_chooses():
    few = list(trials(stories=["library"], loads=[HEAVY], only=[LINUX.name], most=1))
    assert [str(one) for one in few] == ["library, heavy load, Linux default, block 1"]


def test_the_main_parts_take_about_what_was_asked_for():
    """About four hours for heavy and two for light, without the paper's experiments and the adaptive pair."""
    hours = {load: seconds_left({}, [one for one in ALL if one.part < 3 and one.load == load]) / 3600
             for load in (HEAVY, LIGHT)}  # fmt: skip
    assert hours[HEAVY] < 4.5
    assert hours[LIGHT] < 2.2


def test_the_rest_takes_what_the_runs_so_far_took_beside_their_inputs():
    left = list(trials(stories=["library"], loads=[HEAVY], only=[LINUX.name], most=2))
    assert seconds_left({}, left) == 2 * (60 + START)
    assert seconds_left({"a": (60, 80), "b": (60, 90)}, left) == 2 * (60 + 25)
    assert seconds_left({}, []) == 0


def test_alone_takes_as_many_times_as_there_are_tasks():
    (first, *_) = trials(only=[ALONE.name])
    assert first.seconds == len(tasks_of(first.story)) * 60


def test_each_task_is_run_alone_only_under_the_load_whose_goals_compare_with_it():
    compared = {goal.load for goal in GOALS if goal.against == ALONE.name}
    assert {part.load: part.blocks for part in PLAN if ALONE in part.configurations} == {HEAVY: 2}
    assert compared == {HEAVY}


def test_every_comparison_of_a_goal_is_within_a_part():
    """Of two configurations in different parts a block would have nothing in common but its number."""
    for goal in GOALS:
        if goal.against != ALONE.name:
            assert part_of(goal.load, goal.configuration) == part_of(goal.load, goal.against)


def test_files_are_named_by_block():
    one = ALL[0]
    assert one.group == "1-heavy-01"
    assert one.name == f"{one.story.name}-alone"


def test_both_kinds_of_gating_are_compared_under_every_division():
    for division in ("linux", "static", "weights", "limits"):
        assert {f"{division}", f"{division}-gated"} <= {one.name for one in FACTORS}


def test_a_run_is_found_in_its_part_again():
    assert all(part_of(one.load, one.configuration.name) == one.part for one in ALL)
