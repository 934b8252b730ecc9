"""Quality follows need: it falls when results are late, rises when there is time; a small share changes nothing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotkit.profile import Run
from robotkit.quality import LEAST, LONGEST_PATIENCE, Quality

DEADLINE = 0.1


def result(seconds, wait=0.0):
    """An input that waited, and then took some time."""
    return Run(0, 0, round(wait * 1e9), round((wait + seconds) * 1e9), 0)


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


def test_quality_does_not_oscillate():
    """A step up that turns out too slow is tried again less and less often."""
    quality = Quality(DEADLINE)
    falls = 0
    for _ in range(1000):
        before = quality.value
        quality.done(result(0.04 if quality.value < 0.95 else 0.2))
        falls += quality.value < before
    assert falls <= 5 + 1000 // LONGEST_PATIENCE


def test_without_a_deadline_or_when_it_is_switched_off_quality_is_full():
    for quality in (Quality(None), Quality(DEADLINE, adaptive=False)):
        quality.hint(0.01, 1.0)
        quality.done(result(100.0))
        assert (quality.value, quality.adaptive) == (1.0, False)


@given(st.lists(st.tuples(st.floats(0, 10), st.floats(0, 10)), max_size=50), st.floats(0, 4))
def test_quality_stays_within_its_bounds(results, share):
    quality = Quality(DEADLINE)
    quality.hint(share, 1.0)
    for wait, took in results:
        quality.done(result(took, wait))
        assert LEAST <= quality.value <= 1.0
