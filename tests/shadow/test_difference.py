from __future__ import annotations

import pytest

from contextpolicy.shadow.difference import Stretch, difference


def plan(published, contexts=(), suspended=(), **shares):
    tasks = {name: {"share": share, "suspended": name in suspended} for name, share in shares.items()}
    return {"published": published, "until": None, "contexts": list(contexts), "tasks": tasks}


STANDS = plan(0.0, slam=0.5, speech=0.5)
DRIVES = plan(10.0, ["moving"], slam=0.8, speech=0.2)
OTHERWISE = plan(10.0, ["moving"], ["speech"], slam=0.99, speech=0.01)


def differing(policy, shadow, since, until):
    found = difference(policy, shadow, since, until)
    assert found is not None
    return found


def test_equal_plans_do_not_differ():
    found = differing([STANDS, DRIVES], [STANDS, DRIVES], 0.0, 20.0)
    assert (found.part, found.stretches) == (0.0, [])
    assert found.tasks["slam"].share == pytest.approx((0.65, 0.65))
    assert found.tasks["slam"].suspended == (0.0, 0.0)


def test_it_reports_when_and_where_shares_differ():
    found = differing([STANDS, DRIVES], [STANDS, OTHERWISE], 0.0, 20.0)
    assert found.part == 0.5
    shares = {"slam": (0.8, 0.99), "speech": (0.2, 0.01)}
    assert found.stretches == [Stretch(10.0, 20.0, (("moving",), ("moving",)), shares)]
    assert found.tasks["speech"].share == pytest.approx((0.35, 0.255))
    assert found.tasks["speech"].suspended == (0.0, 0.5)


def test_a_stretch_continues_while_only_weights_change():
    """Messages with new weights have the same shares."""
    again = [{**OTHERWISE, "published": at} for at in (10.0, 12.0, 15.0)]
    assert len(differing([STANDS, DRIVES], [STANDS, *again], 0.0, 20.0).stretches) == 1


@pytest.mark.parametrize(("since", "start"), [(-100.0, 5.0), (8.0, 8.0)])
def test_it_begins_when_both_had_a_plan(since, start):
    found = differing([STANDS], [{**STANDS, "published": 5.0}], since, 20.0)
    assert (found.start, found.end) == (start, 20.0)


@pytest.mark.parametrize(("policy", "shadow"), [([], [STANDS]), ([STANDS], []), ([STANDS], [plan(30.0)])])
def test_comparison_needs_plans_of_both(policy, shadow):
    assert difference(policy, shadow, 0.0, 20.0) is None


def test_a_pause_is_left_out_of_the_comparison():
    """From 10 to 16 the policy was paused: of the other 14 s the shares differ in 6 and 4."""
    other = plan(0.0, slam=0.3, speech=0.7)
    paused, resumed = {**STANDS, "until": 10.0}, {**STANDS, "published": 16.0}
    found = differing([paused, resumed], [STANDS, {**other, "published": 4.0}], 0.0, 20.0)
    assert found.part == pytest.approx(10 / 14)
    assert [(one.start, one.end) for one in found.stretches] == [(4.0, 10.0), (16.0, 20.0)]
    assert found.tasks["slam"].share == pytest.approx((0.5, 0.3 * 10 / 14 + 0.5 * 4 / 14))
    assert difference([paused], [plan(12.0)], 0.0, 20.0) is None


def test_a_task_that_only_one_of_them_has():
    found = differing([plan(0.0, slam=1.0)], [plan(0.0, slam=0.6, signs=0.4)], 0.0, 1.0)
    assert found.tasks["signs"].share == (0.0, 0.4)
    assert found.stretches[0].shares == {"signs": (0.0, 0.4), "slam": (1.0, 0.6)}
