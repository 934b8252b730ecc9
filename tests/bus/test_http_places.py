"""Which connections are closed when more come than are served."""

from __future__ import annotations

import pytest

from contextpolicy.bus.http_places import AT_ONCE, PER_ADDRESS, Places


def enter(places, address, number):
    """What is closed while so many connections from one address come."""
    return [places.enter(f"{address}-{own}", address) for own in range(number)]


@pytest.fixture
def places():
    return Places()


def test_there_is_room_for_some(places):
    assert enter(places, "pod", PER_ADDRESS) == [None] * PER_ADDRESS
    assert enter(places, "node", PER_ADDRESS) == [None] * PER_ADDRESS


def test_an_address_that_has_its_part_loses_the_one_that_waits_longest(places):
    assert enter(places, "pod", PER_ADDRESS + 2)[-2:] == ["pod-0", "pod-1"]
    assert places.enter("probe", "node") is None


def test_an_address_never_takes_anothers_place_for_more_than_its_part(places):
    places.enter("probe", "node")
    assert "probe" not in enter(places, "pod", 100)


def test_when_all_is_full_the_address_that_has_the_most_loses_one(places):
    places.enter("early", "node")
    enter(places, "pod", PER_ADDRESS)
    enter(places, "other", AT_ONCE - PER_ADDRESS - 1)
    assert places.enter("late", "node") == "pod-0"


def test_many_addresses_with_one_each_lose_the_one_that_waits_longest(places):
    for pod in range(AT_ONCE):
        places.enter(f"pod-{pod}", f"pod-{pod}")
    assert places.enter("probe", "node") == "pod-0"


def test_what_is_being_answered_stays(places):
    enter(places, "pod", PER_ADDRESS)
    assert places.answer("pod-0")
    assert places.enter("more", "pod") == "pod-1"


def test_while_all_are_being_answered_the_newcomer_is_sent_away(places):
    for pod in range(AT_ONCE):
        places.enter(f"pod-{pod}", f"pod-{pod}")
        places.answer(f"pod-{pod}")
    assert places.enter("probe", "node") == "probe"
    places.leave("pod-3")
    assert places.enter("probe", "node") is None


def test_what_was_closed_is_not_answered(places):
    assert enter(places, "pod", PER_ADDRESS + 1)[-1] == "pod-0"
    assert not places.answer("pod-0")
    places.wait("pod-0")
    places.leave("pod-0")
    assert places.enter("probe", "node") is None


def test_one_that_is_answered_and_stays_open_waits_from_then_on(places):
    enter(places, "pod", PER_ADDRESS)
    places.answer("pod-0")
    places.wait("pod-0")
    assert places.enter("more", "pod") == "pod-1"
