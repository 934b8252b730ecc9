"""Every input that was due ends in one way, and doing less never looks better."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from timelines.experiments.accounting import Ended, Ending, Heard, Tally, Timing, cpu_of_same, quantile, wanted
from timelines.experiments.due import NO_CONTEXT, ONSET, Due, Schedule, Window

S = 1_000_000_000
DRIVE = Window(0.0, 5.0, ("drive",), frozenset({"speech"}))
TALK = Window(5.0, 10.0, ("talk",), frozenset())
SCHEDULE = Schedule(
    10.0,
    {"robot/microphone": [0.5 * n for n in range(20)]},
    {"speech": {"audio": "robot/microphone"}},
    {"speech": 1.0},
    [DRIVE, TALK],
    [(6.0, 7.2)],
)


def heard(done, *, count=10, **options):
    """Ten inputs a second apart; `done` has (seconds it took, drops so far) by number."""
    timings = {n * S: Timing(n + took, 0.01, dropped) for n, (took, dropped) in done.items()}
    return [one.ending for one in Heard([n * S for n in range(count)], timings, **options).endings()]


def test_what_is_done_is_in_time_or_late():
    assert heard({0: (0.1, 0), 1: (0.3, 0)}, count=2, deadline=0.2) == [Ending.IN_TIME, Ending.LATE]


def test_without_a_deadline_nothing_is_late():
    assert heard({0: (9.0, 0)}, count=1) == [Ending.IN_TIME]


def test_what_the_task_counted_was_dropped_and_the_rest_was_lost():
    found = heard({0: (0.1, 0), 3: (0.1, 1)}, count=5, dropped=1)
    assert found == [Ending.IN_TIME, Ending.DROPPED, Ending.LOST, Ending.IN_TIME, Ending.LOST]


def test_drops_while_an_input_was_processed_explain_what_is_missing_after_it():
    """The counter of the first already has the two that came while it was processed."""
    assert heard({0: (2.5, 2), 3: (0.1, 2)}, count=4, dropped=2)[1:3] == [Ending.DROPPED] * 2


def test_what_comes_while_the_task_is_suspended_is_suspended_and_its_queue_was_dropped():
    found = heard({0: (0.1, 0), 5: (0.1, 0)}, count=6, away=[(1.5, 4.0)])
    assert found[1:5] == [Ending.DROPPED, Ending.SUSPENDED, Ending.SUSPENDED, Ending.LOST]  # the last: not yet resumed


def test_a_suspension_does_not_hide_what_was_done():
    assert heard({2: (0.1, 0)}, count=3, away=[(0.0, 9.0)])[2] is Ending.IN_TIME


fates = st.lists(st.sampled_from(list(Ending)), max_size=60)


@given(fates)
def test_the_five_classes_sum_to_what_was_due(endings):
    tally = Tally.of(endings)
    assert sum(tally.count(one) for one in Ending) == tally.due == len(endings)


@st.composite
def runs(draw):
    count = draw(st.integers(0, 30))
    numbers = draw(st.sets(st.integers(0, max(count - 1, 0)))) if count else set()
    drops = sorted(draw(st.lists(st.integers(0, 30), min_size=len(numbers), max_size=len(numbers))))
    took = draw(st.lists(st.floats(0, 3), min_size=len(numbers), max_size=len(numbers)))
    edges = sorted(draw(st.lists(st.floats(0, 30), max_size=4, unique=True)))
    done = {n * S: Timing(n + t, 0.01, d) for n, t, d in zip(sorted(numbers), took, drops, strict=True)}
    away = list(zip(edges[::2], edges[1::2], strict=False))
    return Heard([n * S for n in range(count)], done, away, draw(st.integers(0, 30)), draw(st.floats(0.1, 2)))


@given(runs())
def test_every_input_ends_once_and_what_was_done_is_never_counted_away(run):
    ended = run.endings()
    assert len(ended) == len(run.stamps)
    assert [one.response is not None for one in ended] == [stamp in run.done for stamp in run.stamps]
    tally = Tally.of(one.ending for one in ended)
    assert tally.count(Ending.IN_TIME, Ending.LATE) == len(run.done)


@given(runs(), st.floats(0, 30), st.floats(0, 30))
def test_gating_never_improves_a_rate(run, begin, length):
    """Suspend a task that its context wants for a while: what is not done then is missed, and stays in what was due."""
    due = [Due("audio", n, float(n), "talk", wanted=True, onset=False) for n in range(len(run.stamps))]
    away = (begin, begin + length)
    kept = {stamp: one for stamp, one in run.done.items() if not away[0] <= stamp / 1e9 < away[1]}
    gated = Heard(run.stamps, kept, sorted([*run.away, away]), run.dropped, run.deadline)
    before, after = (Tally.of(one.ending for one in wanted(due, each.endings())) for each in (run, gated))
    assert after.due == before.due
    if before.due:
        assert after.hit <= before.hit
        assert after.coverage <= before.coverage


def test_what_is_due_has_the_context_of_its_own_time():
    due = SCHEDULE.of("speech")
    assert [one.context for one in due] == ["drive"] * 10 + ["talk"] * 10
    assert [one.wanted for one in due] == [False] * 10 + [True] * 10
    assert [one.at for one in due if one.onset] == [0.0, 0.5, 5.0, 5.5]
    assert ONSET == 1


def test_an_input_of_another_tasks_context_is_not_asked_for():
    due = SCHEDULE.of("speech")
    ended = [Ended(Ending.SUSPENDED)] * 10 + [Ended(Ending.IN_TIME, 0.1, 0.01)] * 10
    assert Tally.of(one.ending for one in wanted(due, ended)).hit == 1
    assert len(wanted(due, ended, "talk", onset=True)) == 2
    assert len(wanted(due, ended, "talk", onset=False)) == 8
    assert wanted(due, ended, "drive") == []


def test_a_schedule_survives_its_file():
    again = Schedule.of_json(SCHEDULE.as_json())
    assert again.of("speech") == SCHEDULE.of("speech")
    assert again.stops == [(6.0, 7.2)]


def test_without_contexts_everything_is_wanted():
    plain = Schedule(1.0, {"k": [0.0]}, {"t": {"i": "k"}}, {}, [Window(0.0, 1.0, (), frozenset())])
    assert plain.of("t") == [Due("i", 0, 0.0, NO_CONTEXT, wanted=True, onset=True)]


def test_nothing_due_has_no_rate():
    assert math.isnan(Tally.of([]).hit)
    assert math.isnan(quantile([], 0.99))


def test_what_was_never_done_took_forever():
    done = [Ended(Ending.IN_TIME, 0.1 * n, 0.0) for n in range(1, 100)]
    assert quantile([*done, Ended(Ending.LOST)], 0.99) == pytest.approx(9.9)
    assert quantile([*done, Ended(Ending.LOST), Ended(Ending.LOST)], 0.99) == math.inf


def test_cpu_is_compared_on_what_both_did():
    before = [Ended(Ending.IN_TIME, 0.1, 0.02), Ended(Ending.LATE, 0.3, 0.04), Ended(Ending.DROPPED)]
    after = [Ended(Ending.IN_TIME, 0.1, 0.03), Ended(Ending.LOST), Ended(Ending.IN_TIME, 0.1, 0.9)]
    assert cpu_of_same(before, after) == (0.02, 0.03)
