from __future__ import annotations

import pytest

from contextpolicy.telemetry.token_bucket import TokenBucket

BURST, REFILL, START = 5, 30.0, 1e9


def spent(count, reserve=0):
    bucket = TokenBucket(BURST, REFILL)
    for _ in range(count):
        assert bucket.wait(START, reserve) == 0
        bucket.spend()
    return bucket


def test_a_burst_then_one_at_a_time():
    bucket = spent(BURST)
    assert bucket.wait(START) == REFILL
    assert bucket.wait(START + REFILL / 3) == pytest.approx(REFILL * 2 / 3)
    assert bucket.wait(START + REFILL) == 0


def test_a_reserve_is_left_to_others():
    bucket = spent(BURST - 2, reserve=2)
    assert bucket.wait(START, reserve=2) == REFILL
    assert bucket.wait(START) == 0


def test_no_more_than_a_burst_is_saved_up():
    bucket = spent(BURST)
    assert bucket.wait(2 * START, reserve=BURST) == REFILL


def test_a_clock_set_back_changes_no_tokens():
    bucket = spent(BURST - 1)
    assert bucket.wait(START - 1000) == 0
    bucket.spend()
    assert bucket.wait(START - 1000 + REFILL) == 0


def test_waiting_the_stated_time_suffices():
    for step in range(1000):
        bucket, now = TokenBucket(1, 300.0), step / 7
        bucket.spend()
        assert bucket.wait(now + bucket.wait(now)) == 0
