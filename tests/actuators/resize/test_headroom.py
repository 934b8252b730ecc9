"""Which limits may be set now."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.actuators.resize.headroom import Holding, prompt, strict


def holding(name, spec, wanted, peak=None):
    return Holding(name, spec, spec if peak is None else peak, wanted)


def test_decreases_are_always_strict():
    assert strict(100, [holding("a", 500, 300), holding("b", 500, 10)]) == {"a", "b"}


def test_increases_are_allowed_as_far_as_they_fit():
    assert strict(1000, [holding("a", 400, 600), holding("b", 400, 400)]) == {"a", "b"}
    assert strict(1000, [holding("a", 400, 601), holding("b", 400, 400)]) == {"b"}


def test_decrease_frees_headroom_only_once_in_force():
    assert strict(1000, [holding("a", 500, 800), holding("b", 500, 200)]) == {"b"}
    assert strict(1000, [holding("a", 500, 800), holding("b", 200, 200, peak=500)]) == {"b"}
    assert strict(1000, [holding("a", 500, 800), holding("b", 200, 200)]) == {"a", "b"}


def test_small_increases_go_first():
    holdings = [holding("big", 100, 600), holding("small", 100, 200), holding("medium", 100, 300)]
    assert strict(600, holdings) == {"small", "medium"}


def test_increase_up_to_the_current_peak_needs_no_headroom():
    assert strict(1000, [holding("a", 200, 500, peak=500), holding("b", 500, 500)]) == {"a", "b"}


def test_increase_up_to_the_peak_waits_while_peaks_exceed_capacity():
    assert strict(900, [holding("a", 200, 500, peak=500), holding("b", 400, 400, peak=500)]) == {"b"}


def test_strict_allows_nothing_without_holdings():
    assert strict(1000, []) == set()


amounts = st.integers(1, 100).map(lambda n: n * 10)
sets_of_holdings = st.lists(st.tuples(amounts, amounts, amounts), max_size=8).map(
    lambda rows: [Holding(f"c{n}", spec, max(spec, peak), wanted) for n, (spec, peak, wanted) in enumerate(rows)]
)


@given(amounts, sets_of_holdings)
def test_strict_never_raises_the_sum_above_the_capacity(capacity, holdings):
    may = strict(capacity, holdings)
    after = sum(max(h.peak, h.wanted) if h.id in may else h.peak for h in holdings)
    assert after <= max(capacity, sum(h.peak for h in holdings))


@given(sets_of_holdings)
def test_strict_allows_a_plan_that_fits_once_decreases_are_in_force(holdings):
    capacity = sum(h.wanted for h in holdings)
    settled = [Holding(h.id, min(h.spec, h.wanted), min(h.spec, h.wanted), h.wanted) for h in holdings]
    assert strict(capacity, settled) == {h.id for h in holdings}


# prompt


def plan(*rows):
    """Rows of name, before, spec, wanted, stuck."""
    return [Holding(name, spec, max(spec, before), wanted, before, stuck) for name, before, spec, wanted, stuck in rows]


def test_prompt_applies_the_whole_plan_at_once():
    holdings = plan(("a", 500, 500, 800, False), ("b", 500, 500, 200, False))
    assert prompt(1000, holdings) == ({"a", "b"}, set())


def test_prompt_reverts_an_increase_whose_decrease_is_stuck():
    holdings = plan(("a", 300, 700, 700, False), ("b", 300, 300, 310, False), ("c", 400, 400, 100, True))
    go, back = prompt(1010, holdings)
    assert ("a" in back, "b" in go, "c" in go) == (True, True, True)


def test_prompt_holds_back_an_increase_whose_decrease_is_stuck():
    holdings = plan(("a", 300, 300, 700, False), ("c", 700, 700, 300, True))
    assert prompt(1000, holdings) == ({"c"}, set())


@given(amounts, sets_of_holdings, st.lists(st.tuples(amounts, st.booleans()), min_size=8, max_size=8))
def test_prompt_ends_within_capacity_apart_from_stuck_decreases(capacity, holdings, more):
    holdings = [replace(h, before=b, stuck=stuck) for h, (b, stuck) in zip(holdings, more, strict=False)]
    go, back = prompt(capacity, holdings)

    def after(h):
        if h.stuck and h.wanted <= h.before:
            return h.peak
        return h.wanted if h.id in go else h.before if h.id in back else min(h.spec, h.before)

    least = sum(h.before if h.wanted > h.before else h.peak if h.stuck else h.wanted for h in holdings)
    assert sum(after(h) for h in holdings) <= max(capacity, least)
    assert not go & back
