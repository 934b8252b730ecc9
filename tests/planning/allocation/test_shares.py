"""Properties of the division that hold for all weights and bounds, and an independent reference to compare with."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from contextpolicy.errors import ShareError
from contextpolicy.planning.allocation.shares import Demand, divide, floors_exceed

weights = st.one_of(st.just(0.0), st.floats(1e-6, 1e6), st.integers(1, 20).map(float))
"""Many equal ones: ties are where divisions go wrong."""


@st.composite
def claims(draw):
    """Claims of distinct names; a suspended one's ceiling is its floor, as `division` makes them."""
    names = draw(st.lists(st.text("abcdefgh", min_size=1, max_size=3), min_size=1, max_size=12, unique=True))
    made = []
    for name in names:
        floor = draw(st.integers(1, 40))
        weight = draw(weights)
        ceiling = floor + draw(st.integers(0, 200)) if weight > 0 else floor
        made.append(Demand(name, weight, floor, ceiling))
    return made


@st.composite
def divisible(draw):
    made = draw(claims())
    return draw(st.integers(len(made), 2000)), made


@st.composite
def crowded(draw):
    """Floors that together are more than there is."""
    made = draw(claims().filter(lambda made: sum(claim.floor for claim in made) > len(made)))
    return draw(st.integers(len(made), sum(claim.floor for claim in made) - 1)), made


@given(st.one_of(divisible(), crowded()))
def test_shares_sum_to_the_total_or_the_sum_of_ceilings(case):
    total, made = case
    assert sum(divide(total, made).values()) == min(total, sum(claim.ceiling for claim in made))


@given(st.one_of(divisible(), crowded()))
def test_bounds_hold(case):
    total, made = case
    parts = divide(total, made)
    assert parts.keys() == {claim.name for claim in made}
    for claim in made:
        least = 1 if floors_exceed(total, made) else claim.floor
        assert least <= parts[claim.name] <= claim.ceiling


@given(divisible())
def test_a_heavier_claim_with_no_tighter_bounds_gets_no_less(case):
    total, made = case
    assume(not floors_exceed(total, made))  # their own order rules where they are scaled down
    parts = divide(total, made)
    for heavy in made:
        for light in made:
            if heavy.weight >= light.weight > 0 and heavy.floor >= light.floor and heavy.ceiling >= light.ceiling:
                assert parts[heavy.name] >= parts[light.name] - (heavy.weight == light.weight)


@given(divisible(), st.sampled_from([0.5, 2.0, 1024.0, 2.0**-20]))
def test_only_the_ratio_of_weights_counts(case, factor):
    total, made = case
    scaled = [Demand(c.name, c.weight * factor, c.floor, c.ceiling) for c in made]
    assert divide(total, scaled) == divide(total, made)


@given(divisible(), st.randoms(use_true_random=False))
def test_the_order_of_claims_does_not_matter(case, random):
    total, made = case
    shuffled = random.sample(made, len(made))
    assert divide(total, shuffled) == divide(total, made)


@given(divisible())
def test_shares_are_the_fair_ones_rounded(case):
    """Against water filling by bisection in exact fractions, which shares no code with the division."""
    total, made = case
    assume(not floors_exceed(total, made))
    fair = reference(total, made)
    for name, part in divide(total, made).items():
        assert abs(part - fair[name]) < 1 + Fraction(1, 1000)


@given(st.integers(20, 6400), st.lists(st.integers(1, 100), min_size=2, max_size=12))
@example(195, [7, 19])
@example(1573, [7, 15])
@example(1904, [6, 46, 6, 6])
def test_fractions_go_to_the_largest_remainders_and_ties_to_the_heavier(total, numbers):
    made = [Demand(name, float(number), 0, total, 0) for name, number in zip("abcdefghijkl", numbers, strict=False)]
    fair = {c.name: total * Fraction(c.weight) / sum(numbers) for c in made}
    parts = {name: int(part) for name, part in fair.items()}
    order = sorted(made, key=lambda claim: (parts[claim.name] - fair[claim.name], -claim.weight, claim.name))
    for claim in order[: total - sum(parts.values())]:
        parts[claim.name] += 1
    assert divide(total, made) == parts


def test_a_half_goes_to_the_heavier():
    for light, heavy in combinations(range(1, 100, 2), 2):
        total = 11 * (light + heavy) // 2  # so that both parts end in a half
        made = [Demand("a", light / 100, 1, total), Demand("b", heavy / 100, 1, total)]
        assert divide(total, made) == {"a": 11 * light // 2, "b": (11 * heavy + 1) // 2}


@given(crowded())
def test_floors_beyond_the_total_are_scaled_down_in_their_own_proportion(case):
    total, made = case
    parts = divide(total, made)
    assert sum(parts.values()) == total
    for large in made:
        for small in made:
            if large.floor > small.floor:
                assert parts[large.name] >= parts[small.name]


@given(st.data(), claims())
def test_less_than_a_unit_each_is_refused(data, made):
    total = data.draw(st.integers(0, len(made) - 1))
    with pytest.raises(ShareError, match=f"{total} units cannot be divided over {len(made)}"):
        divide(total, made)


def test_dividing_among_no_claims_gives_an_empty_result():
    assert divide(100, []) == {}


@pytest.mark.parametrize(
    ("total", "made", "parts"),
    [
        pytest.param(100, [("a", 3, 1, 100), ("b", 1, 1, 100)], {"a": 75, "b": 25}, id="Eq. 1"),
        pytest.param(100, [("a", 1, 1, 100), ("b", 0, 1, 1)], {"a": 99, "b": 1}, id="suspended"),
        pytest.param(100, [("a", 99, 1, 50), ("b", 1, 1, 100)], {"a": 50, "b": 50}, id="ceiling passes the rest on"),
        pytest.param(100, [("a", 99, 1, 100), ("b", 1, 20, 100)], {"a": 80, "b": 20}, id="floor takes from others"),
        pytest.param(100, [("a", 99, 1, 95), ("b", 1, 20, 100)], {"a": 80, "b": 20}, id="floor before ceiling"),
        pytest.param(100, [("a", 1, 1, 20), ("b", 1, 1, 30)], {"a": 20, "b": 30}, id="more than wanted"),
        pytest.param(
            100, [("a", 1, 1, 100), ("b", 1, 1, 100), ("c", 1, 1, 100)], {"a": 34, "b": 33, "c": 33}, id="tie"
        ),
        pytest.param(10, [("a", 1, 20, 100), ("b", 1, 20, 100)], {"a": 5, "b": 5}, id="floors scaled down"),
        pytest.param(100, [("a", 1e-300, 1, 100), ("b", 1e300, 1, 100)], {"a": 1, "b": 99}, id="extreme ratio"),
        pytest.param(100, [("a", 5e-324, 1, 100), ("b", 5e-324, 1, 100)], {"a": 50, "b": 50}, id="smallest floats"),
        pytest.param(100, [("a", 1.7e308, 1, 100), ("b", 1.7e308, 1, 100)], {"a": 50, "b": 50}, id="largest floats"),
    ],
)
def test_examples(total, made, parts):
    assert (
        divide(total, [Demand(name, float(weight), floor, ceiling) for name, weight, floor, ceiling in made]) == parts
    )


def reference(total: int, made: list[Demand]) -> dict[str, Fraction]:
    """The level at which the clamped weights fill the total, found by halving."""
    suspended = {c.name: Fraction(c.floor) for c in made if c.weight == 0}
    active = [c for c in made if c.weight > 0]

    def filled(level: Fraction) -> dict[str, Fraction]:
        return {c.name: min(max(level * Fraction(c.weight), Fraction(c.floor)), Fraction(c.ceiling)) for c in active}

    left = min(Fraction(total), Fraction(sum(c.ceiling for c in made))) - sum(suspended.values())
    low, high = Fraction(0), Fraction(max((c.ceiling for c in active), default=1)) * 10**7
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if sum(filled(middle).values()) < left else (low, middle)
    return suspended | filled(high)
