"""When a promotion is reverted: reports of misses in, a verdict out, second by second."""

from __future__ import annotations

import pytest

from contextpolicy.policy.spec import Shadow
from contextpolicy.shadow.probation import Probation

SHADOW = Shadow("robot", tolerance=0.05, patience=5.0)
STANDS, DRIVES = (), ("moving",)


def learned(seconds=60, **misses):
    """A minute in each context, with these misses of slam."""
    probation, now = Probation(), 0
    for contexts, part in misses.items():
        for _ in range(seconds):
            now += 1
            probation.learn("slam", part, DRIVES if contexts == "drives" else STANDS, now)
    return probation


def seconds_until_back(probation, misses, contexts=STANDS, most=3600):
    """None if the promotion stays; a report each second."""
    probation.restart()
    probation.rest("slam")
    for second in range(most):
        if probation.judge(SHADOW, "slam", misses, contexts, 1000 + second):
            return second
    return None


@pytest.mark.parametrize(("misses", "seconds"), [(1.0, 6), (0.5, 12), (0.18, 46), (0.07, None), (0.02, None)])
def test_more_misses_revert_sooner(misses, seconds):
    assert seconds_until_back(learned(stands=0.02), misses) == seconds


def test_usual_misses_of_a_context_do_not_revert():
    assert seconds_until_back(learned(stands=0.0, drives=0.3), 0.3, DRIVES) is None
    assert seconds_until_back(learned(stands=0.0, drives=0.3), 0.3, STANDS) is not None


def test_a_new_context_is_judged_by_the_worst_baseline():
    assert seconds_until_back(learned(stands=0.0, drives=0.3), 0.3, ("docking",)) is None
    assert seconds_until_back(learned(stands=0.0, drives=0.3), 0.5, ("docking",)) is not None


@pytest.mark.parametrize("before", [Probation(), learned(seconds=9, stands=0.5)], ids=["nothing", "too little"])
def test_a_promotion_without_a_baseline_allows_no_misses(before):
    assert seconds_until_back(before, 0.2) is not None


def test_a_task_that_recovers_starts_over():
    probation = learned(stands=0.0)
    probation.rest("slam")
    for second in range(600):
        starved = second % 80 < 4
        assert not probation.judge(SHADOW, "slam", 0.8 if starved else 0.0, STANDS, 1000 + second)


def test_each_task_has_its_own_misses():
    probation = learned(stands=0.0)
    probation.rest("slam")
    for second in range(4):
        assert not probation.judge(SHADOW, "slam", 1.0, STANDS, 1000 + second)
        assert not probation.judge(SHADOW, "signs", 1.0, STANDS, 1000 + second)


def test_time_suspended_does_not_count_as_misses():
    probation = learned(stands=0.0)
    probation.judge(SHADOW, "slam", 0.0, STANDS, 1000)
    probation.rest("slam")
    assert not probation.judge(SHADOW, "slam", 1.0, STANDS, 1500)


def test_a_late_report_counts_for_the_time_since_the_last():
    probation = learned(stands=0.0)
    probation.judge(SHADOW, "slam", 0.0, STANDS, 1000)
    assert probation.judge(SHADOW, "slam", 1.0, STANDS, 1006)


def test_a_restarted_operator_keeps_the_baseline():
    assert seconds_until_back(Probation({"slam": 0.3}), 0.3) is None
    assert seconds_until_back(Probation({"slam": 0.3}), 0.5) is not None
    assert Probation({"slam": 0.3}).before("slam") == 0.3


def test_a_task_that_is_no_longer_there_is_forgotten():
    probation = learned(stands=0.02)
    probation.learn("arm", 0.5, STANDS, 1000)
    probation.judge(SHADOW, "arm", 0.5, STANDS, 1001)
    probation.keep({"slam"})
    assert (probation.tasks, probation.since("arm")) == (["slam"], None)
    assert probation.before("slam") == pytest.approx(0.02)


def test_it_reports_misses_before_and_since():
    probation = learned(stands=0.0, drives=0.3)
    assert probation.before("slam") == pytest.approx(0.3)
    assert (probation.since("slam"), probation.before("signs")) == (None, None)
    seconds_until_back(probation, 0.1, most=10)
    assert probation.since("slam") == pytest.approx(0.1)
    assert probation.tasks == ["slam"]
