"""Quality follows need: it falls when results are late and comes back when they are in time; no share lowers it."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotkit.profile import Run
from robotkit.quality import LEAST, LONGEST_PATIENCE, PATIENCE, Quality

DEADLINE = 0.1


def result(seconds, wait=0.0, way=0.0):
    """An input that came some time after its stamp, waited, and then took some time."""
    return Run(round(-way * 1e9), 0, round(wait * 1e9), round((wait + seconds) * 1e9), 0)


def after(quality, times, work):
    """The qualities that a task takes whose result takes `work` seconds at full quality."""
    taken = []
    for _ in range(times):
        taken.append(quality.value)
        quality.done(result(work * quality.value))
    return taken


@pytest.mark.parametrize("share", [None, 2.0, 0.3, 0.01])
def test_a_small_share_on_an_idle_processor_costs_no_quality(share):
    quality = Quality(DEADLINE)
    quality.hint(share, 1.0)
    assert set(after(quality, 100, 0.05)) == {1.0}


def test_quality_falls_until_the_deadline_is_met():
    quality = Quality(DEADLINE)
    quality.hint(0.2, 1.0)
    taken = after(quality, 50, 0.3)
    assert taken[0] == 1.0
    assert all(0.3 * value < DEADLINE for value in taken[3:])
    assert min(taken) > 0.2  # and no less than it has to


def test_waiting_counts_as_well_as_working():
    quality = Quality(DEADLINE)
    quality.hint(0.1, 1.0)
    quality.done(result(0.03, wait=0.2))
    assert quality.value < 0.5


def test_one_late_result_of_a_task_with_its_full_share_costs_little():
    quality = Quality(DEADLINE)
    quality.hint(1.0, 1.0)
    quality.done(result(5.0))
    assert quality.value == pytest.approx(0.9)


def test_one_late_result_lowers_quality_at_most_to_the_share():
    quality = Quality(DEADLINE)
    quality.hint(0.4, 1.0)
    quality.done(result(5.0))
    assert quality.value == pytest.approx(0.4)
    quality.hint(0.4, 2.0)  # of two cores that it needs
    quality.done(result(5.0))
    assert quality.value == pytest.approx(0.2)


def test_quality_recovers_when_the_load_ends():
    quality = Quality(DEADLINE)
    quality.hint(0.2, 1.0)
    after(quality, 20, 0.5)
    assert quality.value < 0.3
    assert after(quality, 100, 0.02)[-1] == 1.0


@pytest.mark.parametrize("first", [0.095, 0.95])
@pytest.mark.parametrize(("takes", "within"), [(0.04, 30), (0.065, 200), (0.085, 300)])
def test_a_task_that_takes_the_same_at_any_quality_gets_it_back(first, takes, within):
    quality = Quality(DEADLINE)
    quality.hint(0.1, 1.0)
    quality.done(result(first))
    quality.hint(None, 1.0)
    for _ in range(within):
        quality.done(result(takes))
    assert quality.value == 1.0


def trials(quality, takes, times=4000):
    """Of the second half: how many results were late, and the mean quality. `takes` gets a number and the quality."""
    late, taken = 0, []
    for number in range(times):
        seconds = takes(number, quality.value)
        if 2 * number >= times:
            late += seconds > DEADLINE
            taken.append(quality.value)
        quality.done(result(seconds))
    return late, sum(taken) / len(taken)


@pytest.mark.parametrize("every", [1, 7, 30])
def test_a_quality_that_makes_results_late_is_tried_less_and_less_often(every):
    """Even if only one in 30 is late, which would be one every few seconds."""
    late, mean = trials(Quality(DEADLINE), lambda number, value: 0.2 if value > 0.95 and number % every == 0 else 0.04)
    assert late <= 1 + 2000 // LONGEST_PATIENCE
    assert mean > 0.85


@pytest.mark.parametrize(
    ("takes", "least"),
    [
        (lambda _, value: 0.3 * value, 0.25),
        (lambda _, value: 0.05 + 0.06 * value, 0.5),
        (lambda number, value: (0.12 if number % 10 == 0 else 0.04) * (0.3 + 0.7 * value), 0.5),  # keyframes
        (lambda number, value: (0.18 if number % 50 < 10 else 0.05) * value, 0.4),  # another task's load, periodically
    ],
)
def test_quality_settles_where_results_are_in_time(takes, least):
    late, mean = trials(Quality(DEADLINE), takes)
    assert late <= 1 + 2000 // LONGEST_PATIENCE
    assert mean > least


def test_late_results_that_no_quality_prevents_do_not_keep_it_down():
    late, mean = trials(Quality(DEADLINE), lambda number, _: 0.2 if number % 50 == 0 else 0.04)
    assert (late, mean > 0.7) == (40, True)


def test_a_larger_share_is_a_reason_to_try_again():
    quality = Quality(DEADLINE)
    quality.hint(0.2, 1.0)
    trials(quality, lambda _, value: 0.3 * value)
    low = quality.value
    for _ in range(PATIENCE):
        quality.done(result(0.03 * quality.value))
    assert quality.value == low  # it has learned to wait
    quality.hint(1.0, 1.0)
    assert after(quality, 40, 0.03)[-1] == 1.0


@pytest.mark.parametrize("behind", [0.15, -0.15, 30.0, -30.0, 7200.0])
def test_another_hosts_clock_changes_nothing(behind):
    quality = Quality(DEADLINE)
    for _ in range(100):
        quality.done(result(0.05, way=behind))
    assert quality.value == 1.0


def test_each_input_has_its_own_way():
    quality = Quality(DEADLINE)
    for _ in range(50):
        quality.done(result(0.05, way=0.15), "picture")
        quality.done(result(0.05, way=0.001), "imu")
    assert quality.value == 1.0


@pytest.mark.parametrize("behind", [0.0, 0.15])
def test_a_sample_that_was_longer_on_its_way_than_others_is_older(behind):
    quality = Quality(DEADLINE)
    quality.hint(0.1, 1.0)
    for way in (0.002, 0.001, 0.2):
        quality.done(result(0.02, way=behind + way))
    assert quality.value < 0.5


def test_without_a_deadline_or_when_it_is_switched_off_quality_is_full():
    for quality in (Quality(None), Quality(DEADLINE, adaptive=False)):
        quality.hint(0.01, 1.0)
        quality.done(result(100.0))
        assert (quality.value, quality.adaptive) == (1.0, False)


@given(st.lists(st.tuples(st.floats(-1, 10), st.floats(0, 10), st.floats(-100, 100)), max_size=50), st.floats(0, 4))
def test_quality_stays_within_its_bounds(results, share):
    quality = Quality(DEADLINE)
    quality.hint(share, 1.0)
    for took, wait, way in results:
        quality.done(result(took, wait, way))
        assert LEAST <= quality.value <= 1.0
