"""What a neighbour can and can't take of a node, proved for all requests and limits."""

from __future__ import annotations

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from contextpolicy.cluster.parts import Stake, parts

AMOUNTS = st.integers(0, 4000)
STAKES = st.dictionaries(
    st.sampled_from("abcdef"),
    st.tuples(st.integers(1, 1500), AMOUNTS).map(lambda pair: Stake(pair[0], sum(pair))),
    min_size=1,
)
TOTALS = st.integers(0, 8000)


def requests(stakes):
    return sum(stake.request for stake in stakes.values())


@given(STAKES, TOTALS)
def test_part_covers_the_request_if_requests_fit(stakes, more):
    found = parts(requests(stakes) + more, stakes)
    assert all(found[name] >= stake.request for name, stake in stakes.items())


@given(STAKES, TOTALS)
def test_part_never_exceeds_the_limit(stakes, total):
    assert all(found <= stakes[name].limit for name, found in parts(total, stakes).items())


@given(STAKES, TOTALS)
def test_parts_sum_to_the_usable_total(stakes, total):
    usable = sum(stake.limit for stake in stakes.values())
    assert sum(parts(total, stakes).values()) == min(total, usable)


@given(STAKES, TOTALS)
def test_part_is_at_least_proportional_to_the_request(stakes, total):
    for name, found in parts(total, stakes).items():
        own = stakes[name]
        assert found >= min(own.limit, total * own.request // requests(stakes))


@given(STAKES, TOTALS, st.integers(0, 10**9), st.data())
def test_limits_of_a_neighbour_do_not_reduce_the_guaranteed_part(stakes, total, more, data):
    """However many cores a neighbour claims to be able to use."""
    rival = data.draw(st.sampled_from(sorted(stakes)))
    greedy = {**stakes, rival: Stake(stakes[rival].request, stakes[rival].limit + more)}
    for name, found in parts(total, greedy).items():
        if name != rival:
            assert found >= min(stakes[name].limit, total * stakes[name].request // requests(stakes))


@given(STAKES, TOTALS)
def test_unlimited_tasks_are_served_in_proportion(stakes, total):
    found = parts(total, stakes)
    open_ended = [name for name, stake in stakes.items() if found[name] < stake.limit]
    for one in open_ended:
        for other in open_ended:
            fair = Fraction(found[one] * stakes[other].request, stakes[one].request)
            assert abs(fair - found[other]) <= len(stakes) * (1 + Fraction(stakes[other].request, stakes[one].request))


def test_a_pod_without_requests_gets_idle_cpu():
    assert parts(1000, {"a": Stake(0, 500), "b": Stake(99, 300)}) == {"a": 500, "b": 300}
    assert parts(1000, {"a": Stake(0, 500), "b": Stake(999, 2000)}) == {"a": 1, "b": 999}
