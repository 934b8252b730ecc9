"""Stamps follow the code that they are set around."""

import pytest

from tests.bench.hops.stamps import AGENT, LAST, OPERATOR, found, legs

HOPS = (*OPERATOR, *AGENT)


@pytest.mark.parametrize("hop", HOPS, ids=lambda hop: hop.what)
def test_each_hop_is_a_function_of_the_running_code(hop):
    owner, name = found(hop.function)
    assert callable(getattr(owner, name))


def notes(*more):
    return [*((hop.what, 1_000_000 * number) for number, hop in enumerate(HOPS, 2)), *more]


def test_each_leg_lasts_from_the_hop_before_it():
    assert legs(notes(), began=1_000_000) == {hop.what: 1.0 for hop in HOPS}


def test_last_write_and_first_of_other_hops_count():
    late = 1_000_000 * (len(HOPS) + 3)
    reported = legs(notes((LAST, late), (HOPS[0].what, late)), began=1_000_000)
    assert reported is not None
    assert reported[LAST] == 3.0
    assert reported[HOPS[0].what] == 1.0


def test_missing_or_earlier_hop_is_a_miss():
    assert legs(notes()[1:], began=1_000_000) is None
    assert legs(notes(), began=2_500_000) is None
