import itertools

import pytest

from tests.soak import story
from tests.soak.story import Coming, Flip, Killing, Trouble


@pytest.mark.parametrize("duration", [75, 3600])
def test_the_same_seed_gives_the_same_story(duration):
    assert story.story(7, duration) == story.story(7, duration)
    assert story.story(7, duration) != story.story(8, duration)


def test_contexts_come_twice_a_second_and_everything_is_in_order():
    reported = story.story(1, 600)
    assert sum(isinstance(event, Flip) for event in reported) == 1200
    assert all(one.at <= next_one.at for one, next_one in itertools.pairwise(reported))


def test_an_hour_kills_every_part_and_replaces_every_task():
    reported = story.story(1, 3600)
    assert {event.part for event in reported if isinstance(event, Killing)} == {*story.NODE, *story.PODS}
    assert {event.task for event in reported if isinstance(event, Coming)} == set(story.TASKS)


def test_an_hour_has_every_kind_of_trouble():
    events = story.story(1, 3600)
    assert {event.kind for event in events if isinstance(event, Trouble)} == set(story.TROUBLES)


def test_our_pods_are_not_killed_in_the_second_half():
    late = [event for event in story.story(1, 3600) if isinstance(event, Killing) and event.at > 1800]
    assert late
    assert not {event.part for event in late} & set(story.PODS)


def test_the_end_is_calm():
    assert max(event.at for event in story.story(1, 3600) if isinstance(event, Killing | Trouble)) < 3240
