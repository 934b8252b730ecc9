"""Which limits may be set now."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.resize.headroom import Holding, allowed


def holding(name, spec, wanted, peak=None):
    return Holding(name, spec, spec if peak is None else peak, wanted)


def test_decreases_are_always_allowed():
    assert allowed(100, [holding("a", 500, 300), holding("b", 500, 10)]) == {"a", "b"}


def test_increases_are_allowed_as_far_as_they_fit():
    assert allowed(1000, [holding("a", 400, 600), holding("b", 400, 400)]) == {"a", "b"}
    assert allowed(1000, [holding("a", 400, 601), holding("b", 400, 400)]) == {"b"}


def test_room_is_only_there_when_a_decrease_is_in_force():
    assert allowed(1000, [holding("a", 500, 800), holding("b", 500, 200)]) == {"b"}
    assert allowed(1000, [holding("a", 500, 800), holding("b", 200, 200, peak=500)]) == {"b"}
    assert allowed(1000, [holding("a", 500, 800), holding("b", 200, 200)]) == {"a", "b"}


def test_small_increases_go_first():
    holdings = [holding("big", 100, 600), holding("small", 100, 200), holding("medium", 100, 300)]
    assert allowed(600, holdings) == {"small", "medium"}


def test_back_up_to_a_peak_that_may_still_hold_takes_no_room():
    assert allowed(1000, [holding("a", 200, 500, peak=500), holding("b", 500, 500)]) == {"a", "b"}


def test_but_not_while_the_peaks_are_more_than_there_is():
    assert allowed(900, [holding("a", 200, 500, peak=500), holding("b", 400, 400, peak=500)]) == {"b"}


def test_nothing_claimed_nothing_allowed():
    assert allowed(1000, []) == set()


amounts = st.integers(1, 100).map(lambda n: n * 10)
sets_of_holdings = st.lists(st.tuples(amounts, amounts, amounts), max_size=8).map(
    lambda rows: [Holding(f"c{n}", spec, max(spec, peak), wanted) for n, (spec, peak, wanted) in enumerate(rows)]
)


@given(amounts, sets_of_holdings)
def test_what_is_allowed_never_takes_the_sum_above_the_capacity_or_any_higher(capacity, holdings):
    may = allowed(capacity, holdings)
    after = sum(max(h.peak, h.wanted) if h.id in may else h.peak for h in holdings)
    assert after <= max(capacity, sum(h.peak for h in holdings))


@given(sets_of_holdings)
def test_what_fits_as_a_whole_is_allowed_as_soon_as_the_decreases_are_in_force(holdings):
    capacity = sum(h.wanted for h in holdings)
    settled = [Holding(h.id, min(h.spec, h.wanted), min(h.spec, h.wanted), h.wanted) for h in holdings]
    assert allowed(capacity, settled) == {h.id for h in holdings}
