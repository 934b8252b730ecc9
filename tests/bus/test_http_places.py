"""Which connections are closed when more come than are served."""

from __future__ import annotations

import pytest

from contextpolicy.bus.http_places import AT_ONCE, FOR_NEW_ADDRESSES, PER_ADDRESS, Places


def enter(places, address, number):
    """What is closed while so many connections from one address come."""
    return [places.enter(f"{address}-{own}", address) for own in range(number)]


def answer(places, address, number):
    """As many connections from one address as it can have answered; what is closed."""
    closed = enter(places, address, number)
    for own in range(number):
        places.answer(f"{address}-{own}")
    return closed


@pytest.fixture
def places():
    return Places()


def test_each_address_may_open_its_share(places):
    assert enter(places, "pod", PER_ADDRESS) == [None] * PER_ADDRESS
    assert enter(places, "node", PER_ADDRESS) == [None] * PER_ADDRESS


def test_address_over_its_share_loses_its_oldest_connection(places):
    assert enter(places, "pod", PER_ADDRESS + 2)[-2:] == ["pod-0", "pod-1"]
    assert places.enter("probe", "node") is None


def test_flooding_address_never_evicts_another(places):
    places.enter("probe", "node")
    assert "probe" not in enter(places, "pod", 100)


def test_no_address_evicts_one_with_fewer_connections(places):
    """As a kubelet's probe whose request has just come, while pods' requests are being answered."""
    places.enter("probe", "node")
    for pod in range(3):
        answer(places, f"pod-{pod}", 5)
    assert places.enter("more", "pod-0") == "more"
    assert places.answer("probe")


def test_several_connections_of_a_node_are_served_beside_a_flood_that_asks_for_nothing(places):
    """Of its probes of liveness and readiness, and of a scrape; each pod of the flood has fewer."""
    answer(places, "node", 2)
    for pod in range(AT_ONCE - 2):
        places.enter(f"pod-{pod}", f"pod-{pod}")
    assert enter(places, "later", 1) == ["pod-0"]
    assert places.enter("probe", "node") == "pod-1"


def test_full_server_evicts_from_the_busiest_address(places):
    places.enter("early", "node")
    enter(places, "pod", PER_ADDRESS)
    enter(places, "other", AT_ONCE - PER_ADDRESS - 1)
    assert places.enter("late", "node") == "pod-0"


def test_full_server_evicts_the_oldest_among_equal_addresses(places):
    for pod in range(AT_ONCE):
        places.enter(f"pod-{pod}", f"pod-{pod}")
    assert places.enter("probe", "node") == "pod-0"


def test_connection_being_answered_is_not_evicted(places):
    enter(places, "pod", PER_ADDRESS)
    assert places.answer("pod-0")
    assert places.enter("more", "pod") == "pod-1"


def test_address_without_a_connection_is_served_while_all_others_are_being_answered(places):
    """As a kubelet's beside two pods that ask without pause."""
    answer(places, "pod", PER_ADDRESS)
    answer(places, "other", AT_ONCE - PER_ADDRESS)
    assert places.enter("more", "other") == "more"
    assert places.enter("probe", "node") is None
    places.answer("probe")
    assert places.enter("next", "node") == "next"


def test_newcomer_is_refused_while_as_many_addresses_as_possible_are_being_answered(places):
    for pod in range(AT_ONCE + FOR_NEW_ADDRESSES):
        assert answer(places, f"pod-{pod}", 1) == [None]
    assert places.enter("probe", "node") == "probe"
    places.leave("pod-3-0")
    assert places.enter("probe", "node") is None


def test_evicted_connection_is_not_answered(places):
    assert enter(places, "pod", PER_ADDRESS + 1)[-1] == "pod-0"
    assert not places.answer("pod-0")
    places.wait("pod-0")
    places.leave("pod-0")
    assert places.enter("probe", "node") is None


def test_kept_alive_connection_waits_from_its_last_answer(places):
    enter(places, "pod", PER_ADDRESS)
    places.answer("pod-0")
    places.wait("pod-0")
    assert places.enter("more", "pod") == "pod-1"
